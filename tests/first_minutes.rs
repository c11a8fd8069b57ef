//! Tests the first experience of a new user: `up` and `engage`.

use harness::{Rig, SOON, in_real_time, interrupt, soon};
use messages::Mode;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::time::Instant;

fn teleopd() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_teleopd"));
    command.current_dir(harness::repository()).stdin(Stdio::null());
    command
}

/// Returns the output of `up` until READY, and its stderr until its end on an interrupt.
fn up(options: &[&str]) -> (Vec<String>, String) {
    let rig = Rig::empty();
    let mut command = teleopd();
    command.args(["up", "--run-dir"]).arg(rig.folder()).args(options);
    let mut up = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("up starts");
    let mut lines = BufReader::new(up.stdout.take().expect("a pipe")).lines();
    let mut opening = Vec::new();
    while opening.last().is_none_or(|line| line != "READY") {
        let line = lines.next().unwrap_or_else(|| panic!("no READY: {opening:#?}"));
        opening.push(line.expect("text"));
    }
    interrupt(&up);
    let last = lines.map_while(Result::ok).last();
    assert_eq!(last.as_deref(), Some("teleopd: released, at rest, and every process has ended"));
    let mut log = String::new();
    up.stderr.take().expect("a pipe").read_to_string(&mut log).expect("text");
    assert_eq!(up.wait().expect("it ends").code(), Some(130));
    (opening, log)
}

#[test]
fn up_prints_its_opening_lines_and_info_log_only_with_v() {
    let (opening, log) = up(&["--engage-without-realtime"]);
    let words: Vec<&str> = opening.iter().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(words, ["running", "robot", "publish", "engage", "stop", "READY"], "{opening:#?}");
    assert!(
        opening[1].contains("simulated tiago_dual") && opening[2].contains("builtin --loop --run-dir"),
        "{opening:#?}"
    );
    assert!(opening[3].contains("engage --run-dir") && opening[4].contains("Ctrl-C"), "{opening:#?}");
    assert!(!log.contains("granted") && !log.contains("INFO"), "{log}");
    let (verbose, log) = up(&["--engage-without-realtime", "-v"]);
    assert_eq!(verbose.len(), opening.len(), "{verbose:#?}");
    assert!(log.contains("INFO robot: ") && log.contains("timer slack"), "{log}");
    // Missing real-time features of this machine are no warning for a simulated robot.
    assert!(!log.lines().any(|line| line.contains("WARN") && line.contains("granted")), "{log}");
}

#[test]
fn up_with_missing_settings_is_refused_before_any_start() {
    let rig = Rig::idle("");
    let output = teleopd().args(["up", "--config", "/nowhere.toml", "--run-dir"]).arg(rig.folder()).output();
    let output = output.expect("it runs");
    let printed = harness::stderr(&output);
    assert!(
        output.status.code() == Some(78) && printed.lines().count() == 1 && printed.contains("--config"),
        "{printed}"
    );
    assert!(output.stdout.is_empty(), "{output:?}");
}

#[test]
fn engage_prints_each_mode_change_until_interrupted() {
    in_real_time(|| {
        let rig = Rig::whole();
        let operator = rig.operator_session();
        let client = rig.client(&motion::builtin(), 61);
        let give_up = Instant::now() + SOON;
        let printed = loop {
            operator.wait_free();
            let mut engage = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
            engage.args(["engage", "--run-dir"]).arg(rig.folder()).stdout(Stdio::piped());
            let engage = engage.spawn().expect("teleopctl runs");
            soon(|| operator.mode() == Some(Mode::Engaged));
            client.set_engaged(true);
            interrupt(&engage);
            let output = engage.wait_with_output().expect("it ends");
            let printed = harness::stdout(&output);
            // A busy machine may hold before it follows.
            if printed.contains("engaged: ") || Instant::now() > give_up {
                break printed;
            }
        };
        let events: Vec<&str> =
            printed.lines().filter_map(|line| line.split_once(" s  ").map(|(_, words)| words)).collect();
        assert_eq!(events.first(), Some(&"the enable is held; Ctrl-C releases it"), "{printed}");
        let at = |what: &str| {
            events.iter().position(|words| words.starts_with(what)).unwrap_or_else(|| panic!("{what}: {printed}"))
        };
        assert!(at("engaging: ") < at("engaged: ") && at("engaged: ") < at("released: "), "{printed}");
        let times: Vec<f64> = printed.lines().filter_map(|line| line.split_whitespace().next()?.parse().ok()).collect();
        assert!(times.len() == events.len() && times.is_sorted(), "{printed}");
        operator.wait_mode(Mode::Disengaged);
    });
}
