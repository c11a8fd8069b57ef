//! The executable acts by its name, and by its first argument.

use std::os::unix::process::CommandExt;
use std::process::Command;

/// Returns the name that the program gives itself with `--version`.
fn version_of(name: &str, arguments: &[&str]) -> String {
    let mut program = Command::new(env!("CARGO_BIN_EXE_bundle"));
    let output = program.arg0(name).args(arguments).arg("--version").output().expect("it starts");
    assert!(output.status.success(), "{name} {arguments:?}: {output:?}");
    String::from_utf8_lossy(&output.stdout).split_whitespace().next().unwrap_or_default().to_owned()
}

#[test]
fn executable_is_the_program_of_its_name_or_of_its_first_argument() {
    for (name, expected) in [
        ("teleopd", "teleopd"),
        ("/opt/bin/bundle", "teleopd"),
        ("teleopctl", "teleopctl"),
        ("venv/bin/record", "record"),
        ("teleop-replay", "replay"),
        ("teleop-batch", "batch"),
        ("say", "say"),
    ] {
        assert_eq!(version_of(name, &[]), expected, "{name}");
    }
    for program in ["teleopctl", "record", "replay"] {
        assert_eq!(version_of("teleopd", &[program]), program);
    }
}
