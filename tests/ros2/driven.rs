//! The peer's own tests, and a robot that is driven for minutes on a machine that does other things.

use super::{DOMAINS, Peer, drive, python, rig, took_all};
use harness::repository;
use std::process::Command;
use std::time::Duration;

/// Largest acceleration of a setpoint between two updates, as a share of the limit. A stop that begins between two updates
/// adds to it.
const ACCELERATION_SHARE_MAX: f64 = 1.1;

/// Controllers that stand for longer count as switched off, ms: `CONTROLLER_SILENT_NS` in `crates/ros2`. What such a robot does
/// then is its own.
const CONTROLLER_SILENT_MS: f64 = 100.0;

#[test]
#[ignore = "tests the peer, not a program of ours: .ci/long"]
fn peer_passes_its_own_tests() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => return println!("skipped: no peer on ROS 2: {why}"),
    };
    let peer = repository().join("tools/peer");
    let tests = Command::new(python)
        .args(["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "tests"])
        .current_dir(peer)
        .output();
    let tests = tests.expect("it runs");
    let printed = harness::stdout(&tests);
    assert!(tests.status.success(), "{printed}");
    printed.lines().filter_map(|line| line.strip_prefix("SKIPPED")).for_each(|why| println!("note: not run: {why}"));
}

#[test]
fn robot_on_ros2_is_driven_whatever_the_machine_does() {
    assert_driven_for(Duration::from_secs(20));
}

#[test]
#[ignore = "takes ten minutes: .ci/long"]
fn robot_on_ros2_is_driven_for_minutes_whatever_the_machine_does() {
    assert_driven_for(Duration::from_secs(600));
}

fn assert_driven_for(length: Duration) {
    let Some(peer) = Peer::start(DOMAINS[7], &[]) else { return };
    let (stops, whys, report) = drive(peer, rig(DOMAINS[7]), length);
    let Some(report) = report else {
        return println!("note: ends here, because this machine let the peer's controllers stand for a second");
    };
    println!("{stops} stops, because of {whys:?}; late by {} ms at most", report["late_max_ms"]);
    assert_eq!(report["command"]["position_excess"]["exceeded_updates"], 0, "{report:#}");
    assert!(report["moving_s"].as_f64() > Some(1.0), "it never moved: {report:#}");
    if report["late_max_ms"].as_f64() > Some(CONTROLLER_SILENT_MS) {
        return println!("note: ends here, because this machine let the peer's controllers stand for too long");
    }
    assert!(took_all(&report), "{report:#}");
    let acceleration = report["command"]["acceleration_share"]["worst"].as_f64().expect("a number");
    assert!(acceleration <= ACCELERATION_SHARE_MAX, "{acceleration} of the limit: {report:#}");
}
