//! The program's command line, in a domain without a robot.

use std::process::Command;

#[test]
fn preflight_without_a_robot_says_what_to_do() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/teleop.toml");
    let mut program = Command::new(env!("CARGO_BIN_EXE_teleopd-ros2"));
    let output = program.args(["preflight", "--config", config]).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for sentence in [
        "no joint_states arrived: check ros2.domain_id",
        "controller `arm_left_controller` publishes no state: activate it",
        "no /robot_description arrived",
        "no message on ros2.emergency_stop_topic",
    ] {
        assert!(said.contains(sentence), "{sentence}: {said}");
    }
}

#[test]
fn unknown_option_and_missing_settings_are_refused() {
    for (arguments, code) in [(["preflight", "--nonsense"], 2), (["preflight", "--config=/nonexistent.toml"], 78)] {
        let output = Command::new(env!("CARGO_BIN_EXE_teleopd-ros2")).args(arguments).output().expect("it runs");
        assert_eq!(output.status.code(), Some(code), "{}", String::from_utf8_lossy(&output.stderr));
    }
}
