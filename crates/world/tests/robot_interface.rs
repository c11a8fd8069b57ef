//! The built-in motion through every stage on robots other than the one of the shipped settings: one that takes
//! trajectory points, and one with other hands.

use crate::support::{shipped, write_settings};
use client::PlayOptions;
use config::{Interface, Loaded, Overrides};
use std::path::Path;
use world::{Offline, OfflineEnd, OfflineReport, certify};

fn load(config: &Path, interface: Option<Interface>) -> Loaded {
    config::load(config, Overrides { interface, ..Overrides::default() }).unwrap_or_else(|error| panic!("{error}"))
}

/// Plays the whole motion, from the enable to rest.
fn replay(loaded: &Loaded) -> OfflineReport {
    let options = PlayOptions { speed: 1.0, looped: false, calibration: motion::CalibrationMode::First10s };
    let mut run = Offline::new(loaded, &motion::builtin(), options).expect("every stage takes the robot");
    assert_eq!(run.play(|_| ()), OfflineEnd::AtRest);
    run.report().clone()
}

/// Only how long it stands at the end depends on the robot's body.
#[test]
fn certified_commands_are_those_of_a_robot_with_a_body() {
    for interface in [None, Some(Interface::Jtc100)] {
        let (loaded, mut motion) = (load(&shipped("teleop.toml"), interface), motion::builtin());
        motion.frames.truncate(300);
        let calibration = motion::CalibrationMode::First10s;
        let options = PlayOptions { speed: 1.0, looped: false, calibration };
        let (mut played, mut certified) = (Vec::new(), Vec::new());
        let mut run = Offline::new(&loaded, &motion, options).expect("every stage takes the robot");
        let end = run.play(|tick| played.extend(tick.row.map(|row| (row.command, row.target))));
        assert_eq!(end, OfflineEnd::AtRest);
        let report = certify(&loaded, &motion, calibration, 1, |row| {
            certified.push((row.q, row.target));
            Ok::<_, ()>(())
        });
        assert_eq!(report.expect("a certified motion").violations.values().sum::<u64>(), 0);
        let same = played.iter().zip(&certified).take_while(|(one, other)| one == other).count();
        assert!(same > 8000 && same == played.len().min(certified.len()), "{same} of {}", played.len());
        let longer = if played.len() > certified.len() { &played } else { &certified };
        assert!(longer[same..].iter().all(|row| row.0 == longer[same - 1].0), "the robot stands at the end");
    }
}

fn assert_clean(report: &OfflineReport) {
    println!(
        "{} rows, least clearance {:.1} mm, limb error {:.2} deg, of the robot {:.2} deg",
        report.rows, report.min_clearance_mm, report.limb_error_deg_mean, report.limb_error_measured_deg_mean
    );
    assert_eq!(report.violations.values().sum::<u64>(), 0, "{:?}", report.violations);
    assert!(report.rows > 10_000);
}

#[test]
fn trajectory_controllers_follow_builtin_motion_without_fault() {
    let config = shipped("teleop.toml");
    let [direct, points] = [None, Some(Interface::Jtc100)].map(|interface| load(&config, interface));
    assert_ne!(direct.hash, points.hash, "processes started for different interfaces cannot engage");
    assert_clean(&replay(&points));
}

/// The person's hands are faster than the bound. The robot's hands stay below it, and follow as fast as they may.
#[test]
fn hands_at_reduced_speed_follow_without_violation() {
    let mut loaded = load(&shipped("teleop.toml"), None);
    loaded.settings.safety.hand_speed_reduced = true;
    assert_eq!(loaded.settings.safety.hand_speed_m_per_s(), 0.25);
    let report = replay(&loaded);
    println!("{:?}, limb error {:.2} deg", report.violations, report.limb_error_deg_mean);
    assert_eq!(report.violations.values().sum::<u64>(), 0, "{:?}", report.violations);
    assert!(report.violations.contains_key("hand speed"), "{:?}", report.violations);
}

#[test]
fn robot_with_grippers_follows_builtin_motion() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = write_settings(folder.path(), |text| text.replace("tiago_dual.toml\"", "tiago_dual_pal_gripper.toml\""));
    assert_clean(&replay(&load(&path, None)));
}
