//! `collision limits` as a user runs it: what it finds, it says, and ends with.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots")
}

fn limits(robot: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_collision"));
    command.arg("limits").arg(robot).args(arguments).output().expect("collision runs")
}

/// What it said, on both streams.
fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|stream| String::from_utf8_lossy(stream).into_owned()).join("\n")
}

/// So few states miss the worst: climbing finds it, and that counts.
#[test]
fn a_torque_that_only_climbing_finds_counts() {
    let robot = robots().join("tiago_dual.toml");
    let few = ["--states", "1000", "--seed", "3", "--share"];
    let output = limits(&robot, &[&few[..], &["0.847"]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let wanted =
        "arm_left_2_joint: no state that was sampled exceeds 0.847 of the effort limit, one climbed to asks 0.84";
    assert!(said(&output).contains(wanted), "{}", said(&output));
    // The share that the file claims holds.
    let output = limits(&robot, &[&few[..], &["0.85"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    assert!(!said(&output).contains("climbed to asks"), "{}", said(&output));
}

#[test]
fn what_cannot_be_written_is_said() {
    let folder = std::env::temp_dir().join(format!("collision_command_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["tiago_dual.toml", "tiago_dual.urdf"] {
        std::fs::copy(robots().join(name), folder.join(name)).unwrap();
    }
    let robot = folder.join("tiago_dual.toml");
    let before = std::fs::read_to_string(&robot).unwrap();
    // No accelerations hold at the URDF's own velocities.
    let infeasible = limits(&robot, &["--states", "200", "--speed-share", "1", "--write"]);
    let without = limits(&robot, &["--states", "200", "--write"]);
    let after = std::fs::read_to_string(&robot).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(infeasible.status.code(), Some(1), "{}", said(&infeasible));
    for words in ["NOT FEASIBLE", "nothing was written", "tiago_dual.toml", "--speed-share 1 "] {
        assert!(said(&infeasible).contains(words), "{words}: {}", said(&infeasible));
    }
    assert_eq!(without.status.code(), Some(2), "{}", said(&without));
    assert!(said(&without).contains("--speed-share"), "{}", said(&without));
    assert_eq!(before, after);
}
