//! Runs the command as a user does.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn torture(arguments: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_torture")).args(arguments).current_dir(root).output().expect("torture runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(path: &PathBuf) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn torture_run_prints_and_writes_its_figures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.json");
    let output = torture(&["--ticks", "4000", "--goals", "1", "--seed", "5", "--json", &path.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("least clearance"));
    let figures = json(&path);
    assert_eq!((&figures["ticks"], &figures["seed"], &figures["goals"]), (&4000.into(), &5.into(), &1.into()));
    for kind in ["position", "velocity", "acceleration", "jerk", "clearance", "hand speed", "torque"] {
        assert_eq!(figures["violations"][kind], 0);
    }
    for key in ["p50", "p99", "p99_99", "max"] {
        assert!(figures["tick_us"][key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert!(figures["min_clearance_mm"].as_f64().unwrap() >= 10.0 - 1e-6);
    for key in [
        "fallbacks",
        "goals_reached",
        "worst_stop_ms",
        "denials",
        "rollouts",
        "travelled_rad",
        "torque_share_max",
        "fallbacks_for_torque",
    ] {
        assert!(figures[key].is_number(), "{key}");
    }
}

#[test]
fn run_without_certificate_succeeds_only_with_a_collision() {
    let output = torture(&["--ticks", "20000", "--no-certificate"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    // These ticks are too few for a collision. The command says that it showed nothing.
    let output = torture(&["--ticks", "2", "--no-certificate"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("no collision"), "{}", stderr(&output));
}

#[test]
fn run_without_torque_proof_succeeds_only_with_an_overload() {
    let output = torture(&["--ticks", "20000", "--no-torque"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let output = torture(&["--ticks", "2", "--no-torque"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("no motor was overloaded"), "{}", stderr(&output));
}

#[test]
fn invalid_option_or_path_is_refused_by_name() {
    for (arguments, code, words) in [
        (vec!["--rate", "1000"], 64, vec!["--rate = 1000", "1500"]),
        (vec!["--ticks", "0"], 64, vec!["--ticks = 0", "1 to"]),
        (vec!["--threads", "0"], 64, vec!["--threads = 0", "1 to"]),
        (vec!["--robot", "no/such.toml"], 78, vec!["no/such.toml"]),
        (vec!["motions", "no/such"], 66, vec!["no/such"]),
        (vec!["motions", "crates"], 66, vec!["crates", "no motion files"]),
        (vec!["--ticks", "10", "--goals", "0", "--json", "no/such/folder.json"], 73, vec!["no/such/folder.json"]),
    ] {
        let output = torture(&arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        assert!(words.iter().all(|word| stderr(&output).contains(word)), "{arguments:?}: {}", stderr(&output));
    }
}

/// Users of trajectory controllers must not take the figures of another interface for theirs.
#[test]
fn interface_other_than_direct_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").canonicalize().unwrap();
    let direct = std::fs::read_to_string(config.join("teleop.toml")).unwrap();
    let place = |name: &str, text: &str| {
        let text = text.replace("\"robots/", &format!("\"{}/robots/", config.display()));
        let text = text.replace("\"../weights/", &format!("\"{}/../weights/", config.display()));
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let short = ["--ticks", "100", "--goals", "0", "--config"];
    let same = place("direct.toml", &direct);
    let output = torture(&[&short[..], &[&same]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let other = direct.replace("# interface = \"direct\"", "interface = \"jtc100\"");
    assert_ne!(other, direct);
    let other = place("jtc100.toml", &other);
    for arguments in [&short[..], &["stop-times", "--states", "10", "--config"], &["bench", "--config"]] {
        let output = torture(&[arguments, &[&other]].concat());
        assert_eq!(output.status.code(), Some(78), "{}", stderr(&output));
        let words = ["jtc100.toml", "driver.interface = \"jtc100\"", "must be \"direct\""];
        assert!(words.iter().all(|word| stderr(&output).contains(word)), "{}", stderr(&output));
    }
}

#[test]
fn stop_times_and_bench_write_their_figures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.json");
    let json_path = path.display().to_string();
    let output = torture(&["stop-times", "--states", "1000", "--json", &json_path]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let figures = json(&path);
    assert_eq!(figures["exceeded"], 0);
    assert!(figures["worst_stop_ms"].as_f64().unwrap() <= figures["bound_ms"].as_f64().unwrap() + 1e-6);
    let output = torture(&["bench", "--ticks", "2000", "--json", "-"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on standard output");
    assert!(figures["smooth_us"]["p50"].as_f64().unwrap() > 0.0);
}
