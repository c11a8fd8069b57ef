//! Runs the command over real processes and real shared memory. The command's own default has more trials.

use serde_json::Value;
use std::process::{Command, Output};

fn chaos(arguments: &[&str]) -> Output {
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/teleop.toml");
    Command::new(env!("CARGO_BIN_EXE_chaos")).args(arguments).args(["--config", config]).output().expect("chaos runs")
}

/// Runs half of the faults. The other half runs on another instance at the same time, because most of the time
/// is waiting.
fn half(seed: u64) -> (Value, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, seed) = (folder.path().join("chaos.json"), seed.to_string());
    let output = chaos(&[
        "--kills",
        "12",
        "--suspends",
        "8",
        "--seed",
        &seed,
        "--engaged",
        "0.3",
        "--json",
        file.to_str().unwrap(),
    ]);
    let told = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{told}");
    let figures: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).expect("JSON");
    assert_eq!((&figures["kills"], &figures["suspends"]), (&12.into(), &8.into()));
    for kind in ["position", "velocity", "acceleration", "jerk", "clearance"] {
        assert_eq!(figures["violations_witnessed"][kind], 0, "{told}");
        assert_eq!(figures["violations_recorded"][kind], 0, "{told}");
    }
    for (kind, count) in figures["violations_of_true_motion"].as_object().expect("the judge's counts") {
        assert_eq!(count, 0, "{kind}: {told}");
    }
    assert_eq!(figures["robot_records"], 1, "{told}");
    assert_eq!(figures["moved_without_enable"], 0, "{told}");
    assert!(figures["states_witnessed"].as_u64() > Some(5_000), "{told}");
    (figures, told)
}

/// Kills every process, a client and an operator four times each, and suspends some more, at random moments
/// while the robot moves. It comes to rest by certified motion alone, and stays there until it is engaged
/// again.
#[test]
fn f036_f058_f067_f069_f070_f073_f074_robot_rests_after_faults() {
    let other = std::thread::spawn(|| half(4));
    let halves = [half(3), other.join().expect("the other half")];
    let told = || format!("{}\n{}", halves[0].1, halves[1].1);
    for victim in ["ingest", "retarget", "control", "sim", "client", "operator"] {
        let sum = |what: &str| halves.iter().filter_map(|half| half.0["victims"][victim][what].as_u64()).sum::<u64>();
        assert_eq!(sum("kills"), 4, "{victim}: {}", told());
        // Most faults must hit a moving robot, or they show nothing.
        assert!(sum("moving") >= 3, "{victim}: {}", told());
        assert!(victim == "sim" || sum("rests") >= 4, "{victim}: {}", told());
    }
}

#[test]
fn run_without_injections_is_refused_by_option_name() {
    let output = chaos(&["--kills", "0"]);
    assert_eq!(output.status.code(), Some(64));
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("--kills and --suspends 0 is outside [1, 1000000]"), "{told}");
}
