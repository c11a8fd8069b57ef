//! Runs the command as a user does.

use crate::root;
use std::process::{Command, Output};

fn torture(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_torture")).args(arguments).current_dir(root()).output().expect("torture runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn torture_run_prints_its_figures() {
    let output = torture(&["--ticks", "4000", "--goals", "1", "--seed", "5"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = String::from_utf8_lossy(&output.stdout);
    let kinds = ["position", "velocity", "acceleration", "jerk", "clearance", "hand speed", "torque"];
    let none = kinds.map(|kind| format!("{kind} 0")).join(", ");
    for part in
        [": 4000 ticks at 1500 Hz, seed 5, ", &none, "least clearance", "control tick      p50 ", "of 1 reached"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn run_without_a_proof_succeeds_only_if_it_finds_what_the_proof_prevents() {
    for (proof, nothing) in [("--no-certificate", "no collision"), ("--no-torque", "no motor was overloaded")] {
        let output = torture(&["--ticks", "20000", proof]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        // These ticks are too few to find anything. The command says that it showed nothing.
        let output = torture(&["--ticks", "2", proof]);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        assert!(stderr(&output).contains(nothing), "{}", stderr(&output));
    }
}

#[test]
fn invalid_option_or_path_is_refused_by_name() {
    for (arguments, code, words) in [
        (vec!["--ticks", "0"], 64, vec!["--ticks = 0", "1 to"]),
        (vec!["--threads", "0"], 64, vec!["--threads = 0", "1 to"]),
        (vec!["--robot", "no/such.toml"], 78, vec!["no/such.toml"]),
    ] {
        let output = torture(&arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        assert!(words.iter().all(|word| stderr(&output).contains(word)), "{arguments:?}: {}", stderr(&output));
    }
}

/// Users of trajectory controllers must not take the figures of another interface for theirs.
#[test]
fn interface_other_than_direct_is_refused() {
    let config = root().join("config").canonicalize().unwrap();
    let direct = std::fs::read_to_string(config.join("teleop.toml")).unwrap();
    let other = direct.replace("# interface = \"direct\"", "interface = \"jtc100\"");
    assert_ne!(other, direct);
    let other = other.replace("\"robots/", &format!("\"{}/robots/", config.display()));
    let other = other.replace("\"../weights/", &format!("\"{}/../weights/", config.display()));
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(&file, other).unwrap();
    let path = file.path().display().to_string();
    for arguments in [&["--ticks", "100", "--config"][..], &["stop-times", "--config"]] {
        let output = torture(&[arguments, &[&path]].concat());
        assert_eq!(output.status.code(), Some(78), "{}", stderr(&output));
        let words = [path.as_str(), "driver.interface = \"jtc100\"", "must be \"direct\""];
        assert!(words.iter().all(|word| stderr(&output).contains(word)), "{}", stderr(&output));
    }
}

#[test]
fn stop_times_print_their_figures() {
    let output = torture(&["stop-times", "--states", "1000"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).ends_with("; 0 beyond\n"), "{output:?}");
}
