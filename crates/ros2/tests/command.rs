//! The program's command line.

use std::process::Command;

/// The shipped settings are those of the built-in simulator. `tests/ros2.rs` has a domain without a robot.
#[test]
fn settings_that_the_driver_refuses_are_refused_by_the_preflight() {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/teleop.toml");
    let mut program = Command::new(env!("CARGO_BIN_EXE_teleopd-ros2"));
    let output = program.args(["preflight", "--config", config]).output().expect("it runs");
    let error = String::from_utf8_lossy(&output.stderr);
    let sentence = "driver.interface = \"direct\", must be \"jtc100\"";
    assert!(output.status.code() == Some(78) && error.contains(sentence), "{error}");
}

#[test]
fn unknown_option_and_missing_settings_are_refused() {
    for (arguments, code) in [(["preflight", "--nonsense"], 2), (["preflight", "--config=/nonexistent.toml"], 78)] {
        let output = Command::new(env!("CARGO_BIN_EXE_teleopd-ros2")).args(arguments).output().expect("it runs");
        assert_eq!(output.status.code(), Some(code), "{}", String::from_utf8_lossy(&output.stderr));
    }
}
