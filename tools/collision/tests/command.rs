//! Runs `collision limits` as a user does: its results, its output and its exit code.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots")
}

fn limits(robot: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_collision"));
    command.arg("limits").arg(robot).args(arguments).output().expect("collision runs")
}

/// Returns the output of both streams.
fn stderr(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|stream| String::from_utf8_lossy(stream).into_owned()).join("\n")
}

/// With so few states, sampling misses the worst one. Climbing finds it, and that counts.
#[test]
fn worst_torque_found_only_by_climbing_fails_the_check() {
    let robot = robots().join("tiago_dual.toml");
    let few = ["--states", "1000", "--seed", "3"];
    // The purpose of the file is met, and the worst posture is found for each joint, including the second of an arm.
    let output = limits(&robot, &[&few[..], &["--share", "0.85"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let words = stderr(&output);
    let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap_or_default().to_owned();
    assert!(last.starts_with("holds: with 0 kg in each hand, none of 1000 postures"), "{last}");
    let rest = words.split_once("At rest:").expect("two tables").1;
    let row = rest.lines().find(|line| line.starts_with("arm_left_2_joint ")).expect("a row of the joint");
    let shares: Vec<f64> = row.split_whitespace().skip(5).take(2).map(|word| word.parse().unwrap()).collect();
    assert!(shares[0] < shares[1] - 2e-4, "climbing finds more: {row}");
    let between = format!("{}", 0.5 * (shares[0] + shares[1]));
    let output = limits(&robot, &[&few[..], &["--share", &between]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let printed = stderr(&output);
    assert!(printed.contains("arm_left_2_joint: no posture that was sampled needs more"), "{printed}");
}

/// A load in the hands that cannot be held is reported.
#[test]
fn payload_beyond_the_effort_limit_is_reported() {
    let robot = robots().join("tiago_dual.toml");
    let output = limits(&robot, &["--states", "1000", "--payload-kg", "2"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("of the postures need more than 0.85 of the effort limit"), "{}", stderr(&output));
    let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap_or_default().to_owned();
    assert!(last.starts_with("DOES NOT HOLD: with 2 kg in each hand"), "{last}");
    assert!(last.contains("arm_left_2_joint"), "{last}");
}

/// A reader such as `head -1` closes the pipe before the end.
#[test]
fn closed_pipe_does_not_end_the_program_with_a_panic() {
    let robot = robots().join("tiago_dual.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_collision"));
    // The quickest command. The lint of `main.rs` keeps the others from `println`, which panics.
    command.arg("cover").arg(robot).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("collision runs");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    // The boxes of this URDF are for drawing, so they stick out.
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
}

#[test]
fn missing_files_are_named_with_what_to_do() {
    let output = limits(Path::new("no.toml"), &[]);
    assert_eq!(output.status.code(), Some(65), "{}", stderr(&output));
    let printed = stderr(&output);
    assert!(printed.contains("collision: no.toml: there is no such file. Check the path"), "{printed}");
}

/// An upper arm without any shape would collide unseen. The error names its links and what to do, and no step is repeated.
#[test]
fn arm_without_shapes_is_refused_by_its_links() {
    let folder = tempfile::tempdir().expect("a folder");
    let (toml, urdf) = (folder.path().join("openarm_v10.toml"), folder.path().join("openarm_v10.urdf"));
    std::fs::copy(robots().join("openarm_v10.toml"), &toml).expect("copied");
    let shape = "<collision><geometry><box size=\"0.02 0.02 0.02\"/></geometry></collision>";
    let text = std::fs::read_to_string(robots().join("openarm_v10.urdf")).expect("there");
    let shaped = ["left", "right"]
        .into_iter()
        .flat_map(|side| [5, 7].map(|n| format!("openarm_{side}_link{n}")))
        .fold(text, |text, link| {
            text.replace(&format!("<link name=\"{link}\">"), &format!("<link name=\"{link}\">{shape}"))
        });
    std::fs::write(&urdf, shaped).expect("written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_collision"));
    let output =
        command.arg("fit").arg("--urdf").arg(&urdf).arg("--robot").arg(&toml).output().expect("collision runs");
    assert_eq!(output.status.code(), Some(65), "{}", stderr(&output));
    for part in ["the left upper arm (openarm_left_link1", "the right upper arm", "a second --urdf"] {
        assert!(stderr(&output).contains(part), "{part}: {}", stderr(&output));
    }
}
