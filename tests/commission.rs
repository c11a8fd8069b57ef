//! `teleopd commission` as a program: its answers, its log, its exit codes, and the built-in simulator from end to end.

use harness::Rig;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

/// The steps.
const STEPS: usize = 5;

fn commission(rig: &Rig, log: &str) -> (Command, PathBuf) {
    let log = rig.folder().join(log);
    let mut command = Command::new(env!("CARGO_BIN_EXE_teleopd"));
    command.args(["commission", "--engage-without-realtime", "--config"]).arg(&rig.place.config);
    command.arg("--run-dir").arg(rig.folder().join("run")).arg("--log").arg(&log);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    (command, log)
}

/// Answers every question with Enter or y, and presses the simulated button when asked to.
fn answer(child: &mut Child) -> Vec<String> {
    let mut input = child.stdin.take().expect("piped");
    let (mut robot, mut lines) = (String::new(), Vec::new());
    for line in BufReader::new(child.stdout.take().expect("piped")).lines().map_while(Result::ok) {
        if let Some((_, after)) = line.split_once("kill -USR1 ") {
            robot = after.split(' ').next().expect("an id").to_owned();
            signal("USR1", &robot);
        } else if line.starts_with("Release the emergency stop") {
            signal("USR2", &robot);
        }
        // A run that has ended reads no answer.
        if line.ends_with("(Enter, or n to end)") {
            let _ = writeln!(input);
        } else if line.ends_with("(y/n)") {
            let _ = writeln!(input, "y");
        }
        lines.push(line);
    }
    lines
}

fn signal(name: &str, id: &str) {
    assert!(Command::new("kill").args(["-s", name, id]).status().expect("kill(1) runs").success());
}

#[test]
fn answers_for_a_real_robot_must_come_from_a_terminal() {
    let rig = Rig::idle("driver.kind = \"robot\"\ndriver.program = \"/bin/true\"\ndriver.interface = \"jtc100\"");
    let (mut command, log) = commission(&rig, "log");
    let Output { status, stderr, .. } = command.output().expect("it runs");
    let printed = String::from_utf8_lossy(&stderr);
    assert_eq!(status.code(), Some(64), "{printed}");
    assert!(printed.contains("driver.kind = \"robot\"") && printed.contains("its input is no terminal"), "{printed}");
    assert!(!log.exists(), "nothing began");
}

#[test]
fn robot_whose_stop_cannot_be_seen_is_refused_before_anything_begins() {
    let blind = "driver.program = \"teleopd-ros2\"\ndriver.interface = \"jtc100\"\nros2.emergency_stop_topic = \"\"";
    for (settings, named) in [(blind, "ros2.emergency_stop_topic"), ("ros2.setpoints = \"arm_sdk\"", "arm_sdk")] {
        let rig = Rig::idle(settings);
        let (mut command, log) = commission(&rig, "log");
        let Output { status, stderr, .. } = command.output().expect("it runs");
        let printed = String::from_utf8_lossy(&stderr);
        assert!(status.code() == Some(78) && printed.contains(named) && !log.exists(), "{printed}");
    }
}

#[test]
fn refused_step_ends_the_run_and_is_named_in_the_log() {
    let rig = Rig::empty();
    for (input, why) in [("n\n", "the person refused"), ("", "the standard input ended before an answer")] {
        let (mut command, log) = commission(&rig, &format!("log{}", input.len()));
        let mut child = command.spawn().expect("it starts");
        child.stdin.take().expect("piped").write_all(input.as_bytes()).expect("it reads");
        let Output { status, stderr, .. } = child.wait_with_output().expect("it ends");
        let expected = format!("ended at step 1 of {STEPS}, Preflight: {why}");
        assert_eq!(status.code(), Some(1));
        assert!(String::from_utf8_lossy(&stderr).contains(&expected));
        let text = std::fs::read_to_string(log).expect("a log");
        assert!(text.lines().last().is_some_and(|line| line.ends_with(&expected)), "{text}");
        let timed =
            |line: &str| line.as_bytes()[4] == b'-' && line.split(' ').next().is_some_and(|at| at.ends_with('Z'));
        assert!(text.lines().all(timed), "every line has its time: {text}");
    }
}

#[test]
#[ignore = "it takes more than two minutes: cargo test --release --test system commission -- --ignored"]
fn simulated_robot_passes_every_step() {
    harness::in_real_time(|| {
        let rig = Rig::empty();
        let (mut command, log) = commission(&rig, "log");
        let mut child = command.spawn().expect("it starts");
        let lines = answer(&mut child);
        let Output { status, stderr, .. } = child.wait_with_output().expect("it ends");
        let text = std::fs::read_to_string(log).expect("a log");
        assert!(status.success(), "{}{text}", String::from_utf8_lossy(&stderr));
        assert_eq!(lines.iter().filter(|line| line.starts_with("passed: step")).count(), STEPS);
        let joints = rig.place.load().expect("settings").model.count;
        assert_eq!(lines.iter().filter(|line| line.contains("You should have seen this")).count(), joints);
        assert_eq!(lines.iter().filter(|line| line.trim_start().starts_with("kill -9 of")).count(), 2 * 4);
        for line in lines.iter().filter(|line| !line.is_empty()) {
            assert!(text.contains(line.as_str()), "the log lacks a line: {line}");
        }
        let measured = lines.iter().filter(|line| line.contains("from command to measurement")).count();
        assert!(measured == 2 && text.contains("measured_age_max_ms = "), "{text}");
    });
}
