//! Runs the command as a user does: figures of a short run on any machine, and its exit codes.

use latency::figures::HOPS;
use serde_json::Value;
use std::process::{Command, Output};
use std::sync::{Mutex, MutexGuard, PoisonError};
use teleopd::PROCESSES;

/// Runs one instance at a time. Four real-time processes are enough for a small machine.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

fn config() -> String {
    format!("{}/../../config/teleop.toml", env!("CARGO_MANIFEST_DIR"))
}

fn latency(arguments: &[&str]) -> Output {
    command(arguments).output().expect("the program runs")
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_latency"));
    command.args(arguments).args(["--config", &config()]);
    command
}

fn number(value: &Value, path: &str) -> f64 {
    let found = value.pointer(path).and_then(Value::as_f64);
    found.filter(|number| number.is_finite()).unwrap_or_else(|| panic!("{path} is no finite number: {value:#}"))
}

fn count(value: &Value, path: &str) -> u64 {
    value.pointer(path).and_then(Value::as_u64).unwrap_or_else(|| panic!("{path} is no count: {value:#}"))
}

/// Checks that the quantiles are in order, and that something was counted.
fn assert_ordered(row: &Value, name: &str) {
    let figures = ["/p50", "/p99", "/p99_9", "/p99_99", "/max"].map(|path| number(row, path));
    assert!(figures[0] >= 0.0 && figures.windows(2).all(|pair| pair[0] <= pair[1]), "{name}: {row}");
    assert!(count(row, "/count") > 0, "{name}: {row}");
}

#[test]
fn short_run_reports_every_figure_and_they_agree() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("latency.json");
    let arguments = ["--seconds", "5", "--json", json.to_str().unwrap()];
    // If the machine pauses, the driver latches or the person comes late, and there is nothing to measure.
    let paused = |output: &Output| {
        let stderr = String::from_utf8_lossy(&output.stderr);
        let paused =
            output.status.code() == Some(1) && (stderr.contains("DriverFault") || stderr.contains("InputStale"));
        if paused {
            println!("again: {stderr}");
        }
        paused
    };
    let output = (0..3).map(|_| latency(&arguments)).find(|output| !paused(output)).expect("a run without a pause");
    let (words, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(words.starts_with("ratios"), "{words}");
    assert!(HOPS.iter().all(|(hop, _)| words.contains(&hop.replace('_', " "))), "{words}");
    let report: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    for ratio in ["wakeup_p50_vs_cyclictest", "wakeup_p99_vs_cyclictest", "skeleton_to_command_vs_polled"] {
        assert!(number(&report, &format!("/ratios/{ratio}")) > 0.0, "{ratio}");
    }
    for key in ["allocations_after_ready", "transport_allocations_after_ready", "major_faults_after_ready"] {
        count(&report, &format!("/{key}"));
    }
    for quantile in ["p50", "p99"] {
        number(&report, &format!("/target_to_command_beyond_work_us/{quantile}"));
    }
    assert!(["cyclictest", "own probe"].contains(&report["reference"]["name"].as_str().unwrap()));
    assert_ordered(&report["reference"]["probe"], "probe");
    for key in ["host", "kernel", "preemption", "governor", "load_average_before", "load_average_after", "policy"] {
        assert!(report["machine"][key].as_str().is_some_and(|text| !text.is_empty()), "machine.{key}");
    }
    assert_agreement(&report, &report["events"], "events");
    assert_eq!(
        count(&report, "/missed_deadlines"),
        ["retarget", "control", "driver"]
            .map(|name| count(&report, &format!("/events/missed_deadlines/{name}")))
            .iter()
            .sum::<u64>()
    );
    assert_agreement(&report["polled"], &report["polled"], "polled");
}

/// Checks relations of counts and durations that hold on every machine.
fn assert_agreement(figures: &Value, rest: &Value, variant: &str) {
    for (hop, _) in HOPS {
        assert_ordered(&figures["hops_us"][hop], &format!("{variant}: {hop}"));
    }
    for name in ["retarget", "control", "driver"] {
        assert_ordered(&figures["wake_up_us"][name], &format!("{variant}: wake-up of {name}"));
    }
    for name in PROCESSES {
        assert!(number(rest, &format!("/processes/{name}/cpu")) > 0.0, "{variant}: {name}");
        assert!(number(rest, &format!("/processes/{name}/ready_after_ms")) > 0.0, "{variant}: {name}");
        assert_eq!(count(rest, &format!("/processes/{name}/ring_dropped")), 0, "{variant}: {name}");
    }
    let of = |hop: &str| count(&figures["hops_us"], &format!("/{hop}/count"));
    let (published, accepted) = (count(rest, "/skeletons_published"), count(rest, "/skeletons_accepted"));
    assert!(accepted <= published, "{variant}: {accepted} of {published}");
    assert!(of("published_to_ingest") >= accepted && of("published_to_ingest") <= published, "{variant}: {figures}");
    assert_eq!(of("ingest_work"), accepted, "{variant}: each accepted skeleton is timed once");
    // Only the newest skeleton is taken, and only one command is the first of an origin.
    assert!(of("ingest_to_retarget") <= accepted, "{variant}");
    assert!(of("skeleton_to_command") <= of("ingest_to_retarget"), "{variant}");
    let ticks = |name: &str| count(rest, &format!("/ticks/{name}"));
    assert!(of("target_to_command") <= ticks("driver"), "{variant}: more commands than ticks");
    assert!(of("target_to_command") <= of("control_work"), "{variant}: a command comes of a tick of control");
    assert!(of("target_to_control") <= of("retarget_work"), "{variant}: a target comes of a tick of retarget");
    // A path is never shorter than one of its hops.
    let median = |hop: &str| number(&figures["hops_us"], &format!("/{hop}/p50"));
    let longest = |hop: &str| number(&figures["hops_us"], &format!("/{hop}/max"));
    assert!(longest("skeleton_to_command") >= median("retarget_work") + median("control_work"), "{variant}");
    assert!(longest("target_to_command") >= median("control_work"), "{variant}");
}

#[test]
fn invalid_options_exit_with_the_usage_code() {
    for arguments in [
        ["--seconds", "1"],
        ["--seconds", "NaN"],
        ["--seconds", "x"],
        ["--rate-hz", "29"],
        ["--load", "2000"],
        ["--pin", "first"],
        ["--policy", "idle"],
    ] {
        let output = latency(&arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(64), "{arguments:?}: {stderr}");
        assert!(stderr.contains(arguments[0]), "{stderr}");
    }
    assert_eq!(Command::new(env!("CARGO_BIN_EXE_latency")).arg("--help").output().unwrap().status.code(), Some(0));
}

#[test]
fn requested_cyclictest_missing_is_refused_with_package_name() {
    let folder = tempfile::tempdir().unwrap();
    let output = command(&["--compare", "cyclictest"]).env("PATH", folder.path()).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(69), "{stderr}");
    assert!(stderr.contains("rt-tests"), "{stderr}");
}

#[test]
fn unreadable_config_and_unwritable_json_are_refused_by_path() {
    let output = latency(&["--json", "/nowhere/latency.json"]);
    assert_eq!(output.status.code(), Some(73));
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/latency.json"));
    let missing = ["--config", "/nowhere/teleop.toml"];
    let output = Command::new(env!("CARGO_BIN_EXE_latency")).args(missing).output().unwrap();
    assert_eq!(output.status.code(), Some(78));
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/teleop.toml"));
}
