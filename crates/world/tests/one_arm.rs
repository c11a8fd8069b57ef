//! An arm that the operator leaves out, through every stage.

use crate::support::loaded;
use client::{PlayOptions, Player};
use messages::{JOINTS_MAX, Mode, TICK_HZ};
use motion::CalibrationMode;
use safety::engage::OperatorView;
use world::{Links, Running, World, WorldConfig};

/// Largest motion of a joint that only yields to the other arm, rad.
const STILL_RAD: f64 = 1e-6;

/// Ankles, feet and knees, which the person's height does not move.
const FEET: [usize; 6] = [4, 5, 7, 8, 10, 11];

#[test]
fn arm_that_is_left_out_stays_and_the_other_one_follows() {
    let mut loaded = loaded();
    loaded.settings.retarget.lift_follows = true;
    let config = WorldConfig::new(&loaded).expect("the shipped settings");
    let mut motion = motion::builtin();
    // A person with bent knees, whom the lift would follow.
    for frame in &mut motion.frames {
        for (joint, at) in frame.positions.iter_mut().enumerate() {
            at[2] -= if FEET.contains(&joint) { 0.0 } else { 0.2 };
        }
    }
    // The right arm.
    let out = 1;
    let options = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let mut player = Player::new(&motion, options, 1, 1);
    let mut world = World::new(&config, 1, Links::default());
    let (mut mode, mut first): (Mode, Option<[f64; JOINTS_MAX]>) = (Mode::Disengaged, None);
    let (mut engaged, mut moved) = (0, [0.0_f64; 2]);
    // Half of the time without the arm. Then the enable is released, and pressed again for both.
    for k in 0..24 * TICK_HZ {
        let now = world.now();
        if let Some((_, raw)) = player.due(now, mode == Mode::Engaged) {
            world.publish(&raw);
        }
        let alone = k < 12 * TICK_HZ;
        let pressed = [TICK_HZ, 14 * TICK_HZ].contains(&k);
        let operator = OperatorView {
            connected: true,
            enable_level: (TICK_HZ..12 * TICK_HZ).contains(&k) || k >= 14 * TICK_HZ,
            enable_edge: pressed,
            release_edge: k == 12 * TICK_HZ,
            left_out: std::array::from_fn(|side| alone && side == out),
            heartbeat_received: now,
            ..OperatorView::default()
        };
        let moment = world.step(&config, &operator, Running::ALL);
        let control = moment.control.expect("control runs");
        mode = Mode::from_u32(control.status.mode).expect("a mode");
        let Some(command) = control.command else { continue };
        let first = first.get_or_insert(command.q);
        for (moved, arm) in moved.iter_mut().zip(&loaded.model.arms) {
            *moved = arm.range().map(|j| (command.q[j] - first[j]).abs()).fold(*moved, f64::max);
        }
        engaged += u64::from(alone && mode == Mode::Engaged);
        if k == 12 * TICK_HZ {
            assert!(engaged > 5 * TICK_HZ, "{engaged} ticks");
            let lift = loaded.model.lift.expect("a lift");
            assert!((command.q[lift] - first[lift]).abs() < STILL_RAD, "it carries the arm");
            assert!(moved[out] < STILL_RAD && moved[1 - out] > 0.3, "arm {out} is left out: {moved:?} rad");
        }
    }
    assert!(moved[out] > 0.3, "it follows once it is enabled: {moved:?} rad");
    assert_eq!(world.report().violations_total(), 0);
}
