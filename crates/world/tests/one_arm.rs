//! An arm that the operator leaves out, through every stage.

use crate::support::loaded;
use crate::support::scene::{Scene, player};
use messages::{JOINTS_MAX, Mode, TICK_HZ};

/// Largest motion of a joint that only yields to the other arm, rad.
const STILL_RAD: f64 = 1e-6;

/// Ankles, feet and knees, which the person's height does not move.
const FEET: [usize; 6] = [4, 5, 7, 8, 10, 11];

#[test]
fn arm_that_is_left_out_stays_and_the_other_one_follows() {
    let mut loaded = loaded();
    loaded.settings.retarget.lift_follows = true;
    let mut motion = motion::builtin();
    // A person with bent knees, whom the lift would follow.
    for frame in &mut motion.frames {
        for (joint, at) in frame.positions.iter_mut().enumerate() {
            at[2] -= if FEET.contains(&joint) { 0.0 } else { 0.2 };
        }
    }
    // The right arm.
    let out = 1;
    let mut scene = Scene::with(&loaded, player(&motion, 1.0, 1), 1);
    let mut first: Option<[f64; JOINTS_MAX]> = None;
    let (mut engaged, mut moved) = (0, [0.0_f64; 2]);
    // Half of the time without the arm. Then the enable is released, and pressed again for both.
    for k in 0..24 * TICK_HZ {
        let alone = k < 12 * TICK_HZ;
        if [TICK_HZ, 14 * TICK_HZ].contains(&k) {
            scene.press_enable();
        } else if k == 12 * TICK_HZ {
            (scene.hand.release_edge, scene.hand.enable_level) = (true, false);
        }
        scene.hand.left_out = std::array::from_fn(|side| alone && side == out);
        let control = scene.step().control.expect("control runs");
        let Some(command) = control.command else { continue };
        let first = first.get_or_insert(command.q);
        for (moved, arm) in moved.iter_mut().zip(&loaded.model.arms) {
            *moved = arm.range().map(|j| (command.q[j] - first[j]).abs()).fold(*moved, f64::max);
        }
        engaged += u64::from(alone && scene.mode == Mode::Engaged);
        if k == 12 * TICK_HZ {
            assert!(engaged > 5 * TICK_HZ, "{engaged} ticks");
            let lift = loaded.model.lift.expect("a lift");
            assert!((command.q[lift] - first[lift]).abs() < STILL_RAD, "it carries the arm");
            assert!(moved[out] < STILL_RAD && moved[1 - out] > 0.3, "arm {out} is left out: {moved:?} rad");
        }
    }
    assert!(moved[out] > 0.3, "it follows once it is enabled: {moved:?} rad");
    assert_eq!(scene.world.report().violations_total(), 0);
}
