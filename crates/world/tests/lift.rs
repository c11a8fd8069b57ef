//! The lift goes down as the person crouches, through every stage.

use crate::support::loaded;
use client::PlayOptions;
use messages::{Mode, Smpl, TICK_HZ, TICK_S};
use motion::{CalibrationMode, Frame, Motion};
use world::{Offline, OfflineEnd};

/// How far the person goes down, m.
const CROUCH_M: f32 = 0.3;

/// Lowers the person with the feet where they are.
fn crouch(frame: &mut Frame, down: f32) {
    let feet = [Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot].map(|joint| joint as usize);
    let knees = [Smpl::LeftKnee as usize, Smpl::RightKnee as usize];
    for (joint, at) in frame.positions.iter_mut().enumerate() {
        if knees.contains(&joint) {
            // Half as far down, and in front, so that both bones keep their length of 0.43 m.
            let half = down / 2.0;
            (at[2], at[0]) = (at[2] - half, at[0] + (0.43_f32.powi(2) - (0.43 - half).powi(2)).sqrt());
        } else if !feet.contains(&joint) {
            at[2] -= down;
        }
    }
}

/// The built-in motion of a person who crouches in its middle third.
fn crouching() -> Motion {
    let mut motion = motion::builtin();
    let count = motion.frames.len() as f32;
    for (i, frame) in motion.frames.iter_mut().enumerate() {
        let phase = (i as f32 / count - 1.0 / 3.0) * 3.0;
        crouch(frame, CROUCH_M * (std::f32::consts::PI * phase.clamp(0.0, 1.0)).sin());
    }
    motion
}

/// Returns the lift's positions in the commands while Engaged, m.
fn play(motion: &Motion, follows: bool) -> Vec<f64> {
    let mut loaded = loaded();
    loaded.settings.retarget.lift_follows = follows;
    let lift = loaded.model.lift.expect("a lift");
    let v_max = loaded.model.limits[lift].v_max;
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let mut offline = Offline::new(&loaded, motion, options).expect("stages");
    let mut seen: Vec<f64> = Vec::new();
    let end = offline.play(|tick| {
        let Some(control) = &tick.moment.control else { return };
        let Some(command) = control.command.filter(|_| control.status.mode == Mode::Engaged as u32) else { return };
        if let Some(before) = seen.last() {
            let speed = (command.q[lift] - before).abs() / TICK_S;
            assert!(speed <= 0.55 * v_max, "{speed} m/s is not slow");
        }
        seen.push(command.q[lift]);
    });
    assert_eq!(end, OfflineEnd::AtRest);
    assert_eq!(offline.report().violations.values().sum::<u64>(), 0);
    seen
}

#[test]
fn lift_follows_a_crouch_only_if_it_is_set() {
    let home_m = loaded().model.home[0];
    let still = play(&crouching(), false);
    assert!(still.iter().all(|lift_m| (lift_m - home_m).abs() < 1e-6), "it moved without the setting");
    let followed = play(&crouching(), true);
    let lowest_m = followed.iter().fold(f64::INFINITY, |least, lift_m| least.min(*lift_m));
    assert!((0.03..0.3).contains(&(home_m - lowest_m)), "{lowest_m} m");
    assert!(followed.len() as u64 > 15 * TICK_HZ, "{} ticks", followed.len());
    let last = followed.last().expect("a command");
    assert!((last - home_m).abs() < 0.02, "it did not come up again: {last} m");
}
