//! Reduced speed through the whole chain: a clean motion is never slowed, a target that jumps is, and no limit breaks.

use crate::support::scene::{Scene, player};
use crate::support::{Bench, JOINTS, loaded, random_posture};
use messages::{JOINTS_MAX, Mode, TICK_HZ, reduced_flag};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Plays the first seconds of the built-in motion at a frame rate. Returns the number of engaged ticks.
fn clean(frame_rate_hz: f64) -> u64 {
    let mut motion = motion::builtin();
    let step = (motion.frame_rate_hz / frame_rate_hz).max(1.0) as usize;
    motion.frames = motion.frames.into_iter().step_by(step).collect();
    motion.frame_rate_hz /= step as f64;
    // A camera faster than the motion's own rate shows the motion faster.
    let speed = frame_rate_hz / motion.frame_rate_hz;
    let mut scene = Scene::with(&loaded(), player(&motion, speed, 1), 1);
    let (mut engaged, mut fastest) = (0, 0.0_f64);
    let mut last: Option<[f64; JOINTS_MAX]> = None;
    for k in 0..14 * TICK_HZ {
        if k == TICK_HZ {
            scene.press_enable();
        }
        let moment = scene.step();
        let status = scene.status;
        assert_eq!(status.reduced, 0, "{frame_rate_hz} Hz, tick {k}");
        engaged += u64::from(scene.mode == Mode::Engaged && status.speed_scale == 1.0);
        if let (Some(target), Some(last)) = (moment.target, last) {
            let speed = |j: usize| (target.q[j] - last[j]).abs() * TICK_HZ as f64;
            fastest = (3..JOINTS).map(speed).fold(fastest, f64::max);
        }
        last = moment.target.filter(|target| target.valid_mask != 0).map(|target| target.q);
    }
    println!("{frame_rate_hz} Hz: {engaged} ticks engaged, fastest joint of a target {fastest:.1} rad/s");
    assert_eq!(scene.world.report().violations_total(), 0);
    engaged
}

#[test]
fn f020_f034_f035_clean_motion_at_30_to_120_hz_is_never_slowed() {
    for frame_rate_hz in [30.0, 60.0, 120.0] {
        assert!(clean(frame_rate_hz) > 8 * TICK_HZ);
    }
}

#[test]
fn f022_f034_f048_jumping_target_is_reached_without_overshoot() {
    let mut rng = Pcg64Mcg::seed_from_u64(22);
    let mut slowed = 0;
    for seed in 0..8 {
        let mut bench = Bench::engaged(seed);
        // The person is lost for less than 10 ms of targets and comes back elsewhere: small jumps, and flips of an
        // elbow.
        let mut far = bench.model().home;
        if seed % 2 == 0 {
            far = random_posture(bench.model(), &mut rng, 0.0);
        } else {
            for joint in [5, 7] {
                let limits = &bench.model().limits[joint];
                far[joint] = (far[joint] + std::f64::consts::PI).clamp(limits.q_min, limits.q_max);
            }
        }
        for _ in 0..rng.random_range(1..10) {
            bench.target = None;
            bench.step();
        }
        bench.target = Some(far);
        let from = bench.commanded().q;
        let mut past = 0.0_f64;
        for _ in 0..4 * TICK_HZ {
            bench.step();
            slowed += u64::from(bench.status.reduced & reduced_flag::TARGET_JUMPED != 0);
            for j in 0..JOINTS {
                let limits = &bench.model().limits[j];
                let aim = far[j].clamp(limits.q_min, limits.q_max);
                // A joint that has already arrived may make room for the others.
                if (aim - from[j]).abs() < 0.01 {
                    continue;
                }
                past = past.max((bench.commanded().q[j] - aim) * (aim - from[j]).signum());
            }
        }
        println!("seed {seed}: {past:.4} rad beyond the target");
        // A joint that makes room for another pair may pass its own target. That is no overshoot of tracking.
        assert!(past < 1e-2 || bench.status.clearance_command_m < 0.05, "seed {seed}: {past} beyond the target");
        bench.assert_no_violations(&format!("seed {seed}"));
    }
    assert!(slowed > 0);
}
