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

/// The built-in motion up to hanging arms, which then stay while the person crouches and stands up.
fn hanging() -> Motion {
    let mut motion = motion::builtin();
    let from = (7.0 * motion.frame_rate_hz) as usize;
    let last = motion.frames[from];
    motion.frames.truncate(from);
    for i in 0..(14.0 * motion.frame_rate_hz) as usize {
        let mut frame = last;
        let phase = i as f32 / (14.0 * motion.frame_rate_hz as f32);
        crouch(&mut frame, 0.35 * (3.0 * (std::f32::consts::PI * phase).sin()).min(1.0));
        // A tracker never gives the same numbers twice.
        frame.positions.iter_mut().for_each(|at| at[1] += 1e-3 * (i as f32 / 30.0).sin());
        motion.frames.push(frame);
    }
    motion
}

/// A command while Engaged.
#[derive(Clone, Copy, Debug)]
struct Seen {
    lift_m: f64,
    clearance_m: f64,
    limb_error_deg: f64,
}

/// Plays it.
fn play(motion: &Motion, follows: bool) -> Vec<Seen> {
    let mut loaded = loaded();
    loaded.settings.retarget.lift_follows = follows;
    let lift = loaded.model.lift.expect("a lift");
    let v_max = loaded.model.limits[lift].v_max;
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let mut offline = Offline::new(&loaded, motion, options).expect("stages");
    let mut seen: Vec<Seen> = Vec::new();
    let end = offline.play(|tick| {
        let Some(control) = &tick.moment.control else { return };
        let Some(command) = control.command.filter(|_| control.status.mode == Mode::Engaged as u32) else { return };
        let status = &control.status;
        let now = Seen {
            lift_m: command.q[lift],
            clearance_m: status.clearance_command_m,
            limb_error_deg: status.limb_error_measured_rad.to_degrees(),
        };
        if let Some(before) = seen.last() {
            let speed = (now.lift_m - before.lift_m).abs() / TICK_S;
            assert!(speed <= 0.55 * v_max, "{speed} m/s is not slow");
        }
        seen.push(now);
    });
    assert_eq!(end, OfflineEnd::AtRest);
    assert_eq!(offline.report().violations.values().sum::<u64>(), 0);
    seen
}

#[test]
fn lift_follows_a_crouch_only_if_it_is_set() {
    let home_m = loaded().model.home[0];
    let still = play(&crouching(), false);
    assert!(still.iter().all(|now| (now.lift_m - home_m).abs() < 1e-6), "it moved without the setting");
    let followed = play(&crouching(), true);
    let lowest_m = followed.iter().fold(f64::INFINITY, |least, now| least.min(now.lift_m));
    assert!((0.03..0.3).contains(&(home_m - lowest_m)), "{lowest_m} m");
    assert!(followed.len() as u64 > 15 * TICK_HZ, "{} ticks", followed.len());
    let last = followed.last().expect("a command");
    assert!((last.lift_m - home_m).abs() < 0.02, "it did not come up again: {last:?}");
}

#[test]
fn lift_goes_down_as_slowly_for_a_person_who_crouches_from_the_start() {
    let mut motion = motion::builtin();
    motion.frames.iter_mut().for_each(|frame| crouch(frame, CROUCH_M));
    let followed = play(&motion, true);
    let home_m = loaded().model.home[0];
    assert!(followed.iter().any(|now| now.lift_m < home_m - 0.03), "it stays at home");
}

#[test]
fn hanging_arms_hang_on_while_the_lift_goes_down() {
    let followed = play(&hanging(), true);
    let lowest = followed.iter().min_by(|a, b| a.lift_m.total_cmp(&b.lift_m)).expect("a command");
    assert!(lowest.lift_m < 0.05, "{lowest:?}");
    // Hands that come down to the floor turn away, and the limbs stay the person's.
    assert!(lowest.clearance_m < 0.02 && lowest.limb_error_deg < 1.0, "{lowest:?}");
    assert!(followed.iter().all(|now| now.clearance_m >= 0.01), "too near");
}
