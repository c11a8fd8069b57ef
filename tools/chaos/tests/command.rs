//! Runs the command over real processes and real shared memory. The command's own default has more trials.

use harness::{assert_always, in_real_time};
use serde_json::Value;
use std::process::{Command, Output};
use std::sync::{Mutex, PoisonError};

/// The soak and the trials take turns. One instance is enough for a small machine, as `harness::Harness` has it.
static TURN: Mutex<()> = Mutex::new(());

fn chaos(arguments: &[&str]) -> Output {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/teleop.toml");
    Command::new(env!("CARGO_BIN_EXE_chaos")).args(arguments).args(["--config", config]).output().expect("chaos runs")
}

fn count(value: &Value, path: &str) -> u64 {
    value.pointer(path).and_then(Value::as_u64).unwrap_or_else(|| panic!("{path} is no count: {value:#}"))
}

/// Runs the faults on an instance. Returns the figures, the text, and true if the program succeeded.
fn trials(kills: u64, suspends: u64) -> (Value, String, bool) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("chaos.json");
    let (json, kills, suspends) = (file.to_str().expect("text"), kills.to_string(), suspends.to_string());
    let faults = ["--kills", &kills, "--suspends", &suspends, "--seed", "3", "--engaged", "0.5", "--json", json];
    let output = chaos(&faults);
    let printed = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let figures = std::fs::read_to_string(file).expect("figures");
    let figures = serde_json::from_str(&figures).unwrap_or_else(|cause| panic!("{cause}: {printed}"));
    (figures, printed, output.status.success())
}

fn assert_no_violations(figures: &Value, printed: &str) {
    for kind in ["position", "velocity", "acceleration", "jerk", "clearance"] {
        assert_always(figures["violations_witnessed"][kind] == 0, printed);
        assert_always(figures["violations_recorded"][kind] == 0, printed);
    }
    for (kind, count) in figures["violations_of_true_motion"].as_object().expect("the judge's counts") {
        assert_always(count == 0, format_args!("{kind}: {printed}"));
    }
    assert_eq!(figures["robot_records"], 1, "{printed}");
    assert_always(figures["moved_without_enable"] == 0, printed);
}

/// Kills every process, a client and an operator, and suspends some, at random moments while the robot moves. It comes to
/// rest by certified motion alone, and stays there until it is engaged again. `.ci/long` has 100 kills.
#[test]
fn f036_f058_f067_f069_f070_f073_f074_robot_rests_after_faults() {
    const TARGETS: [&str; 6] = ["ingest", "retarget", "control", "driver", "client", "operator"];
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    in_real_time(|| {
        let (figures, printed, succeeded) = trials(6, 2);
        assert_no_violations(&figures, &printed);
        assert!(succeeded, "{printed}");
        assert_eq!((&figures["kills"], &figures["suspends"]), (&6.into(), &2.into()));
        assert!(figures["states_witnessed"].as_u64() > Some(2_000), "{printed}");
        for target in TARGETS {
            let victim = &figures["victims"][target];
            assert_eq!(count(victim, "/kills"), 1, "{target}: {printed}");
            assert!(target == "driver" || count(victim, "/rests") >= 1, "{target}: {printed}");
        }
        // Most faults must hit a moving robot, or they show nothing.
        let moving: u64 = TARGETS.iter().map(|target| count(&figures["victims"][target], "/moving")).sum();
        assert!(moving >= 4, "{printed}");
    });
}

/// A short soak: all watched figures are present, and nothing grows. Stops that no fault explains depend on the
/// machine.
#[test]
fn f079_f090_short_soak_reports_every_figure_and_no_growth() {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("soak.json");
    let output = chaos(&["soak", "--hours", "0.006", "--strike-every", "8", "--json", json.to_str().unwrap()]);
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    let figures: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap())
        .unwrap_or_else(|error| panic!("{error}: {printed}"));
    let trials = &figures["trials"];
    assert!(count(trials, "/kills") + count(trials, "/suspends") >= 1, "{printed}");
    assert!(figures["engaged_s"].as_f64() > Some(1.0), "{printed}");
    for process in teleopd::PROCESSES {
        for what in ["descriptors", "threads"] {
            assert_eq!(count(&figures, &format!("/growth/{process}/{what}")), 0, "{figures:#}");
        }
        assert!(
            process == "ingest"
                || count(&figures, &format!("/processes/{process}/telemetry/metrics/wake_up/count")) > 0
        );
    }
    assert_eq!(count(&figures, "/segments/first"), count(&figures, "/segments/last"));
    assert_no_violations(trials, &printed);
    let complaints = figures["complaints"].as_array().expect("a list");
    let explained = figures["false_stops"].as_array().expect("a list").len();
    assert_eq!(complaints.len(), explained, "{figures:#}");
    assert_eq!(output.status.code(), Some(if complaints.is_empty() { 0 } else { 1 }), "{printed}");
}
