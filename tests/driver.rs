//! A driver's own program in place of the simulated robot: the example of docs/src/drivers.md, compiled and run.

use harness::{DRIVER, Rig, assert_ends, in_real_time};
use messages::Mode;
use serde_json::Value;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::Command;

/// Lines of a complete driver, as the book promises.
const LINES_MAX: usize = 80;

/// The example, which cargo builds with the tests.
fn example() -> PathBuf {
    let program = PathBuf::from(env!("CARGO_BIN_EXE_teleopd")).with_file_name("examples").join("driver");
    assert!(program.exists(), "{}: build it with cargo build --release --example driver", program.display());
    program
}

fn with_program(kind: &str, program: &str) -> Rig {
    let interface = "driver.interface = \"direct\"";
    Rig::with_settings(&format!("driver.kind = {kind:?}\ndriver.program = {program:?}\n{interface}"))
}

#[test]
fn example_driver_moves_its_robot_within_all_limits() {
    in_real_time(|| {
        let mut rig = with_program("sim", &example().display().to_string());
        let (operator, mut observer, _client) = rig.follow_builtin(0.1);
        let moved = observer.wait("there", |_| true);
        let away = moved.q.iter().zip(&moved.q_measured).map(|(q, measured)| (q - measured).abs()).fold(0.0, f64::max);
        assert!(away > 0.0 && away < 0.05, "measured {away} from the setpoint: its own servos follow");
        operator.release();
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        let figures = rig.end(DRIVER);
        let violations = figures["violations"].as_object().expect("the driver's counts");
        assert!(violations.len() > 5 && violations.values().all(|count| *count == 0), "{violations:?}");
        assert!(figures["commands_accepted"].as_u64() > Some(1000) && figures["first_latch"].is_null(), "{figures}");
        assert_eq!(figures["robot"]["looks"], Value::Null, "the simulated body judges nothing");
    });
}

/// The kind and the program of a driver, a command, and what it prints.
#[test]
fn program_or_interface_of_a_driver_that_cannot_be_is_refused() {
    let script = tempfile::Builder::new().suffix(".sh").tempfile().expect("a file");
    let text = format!("#!/bin/sh\nexec {} driver \"$@\"\n", env!("CARGO_BIN_EXE_teleopd"));
    std::fs::write(script.path(), text).expect("a script");
    std::fs::set_permissions(script.path(), PermissionsExt::from_mode(0o755)).expect("its mode");
    let script = script.into_temp_path();
    let (example, script) = (example().display().to_string(), script.display().to_string());
    let up = &["up", "--engage-without-realtime"][..];
    let ended =
        &["driver.program = \"/bin/true\" ended before it was ready (exit status: 0)", "docs/src/drivers.md"][..];
    // The example declares that its robot takes every setpoint. A real robot may take fewer.
    for (kind, program, command, code, sentences) in [
        ("sim", "/none/driver", &["driver"][..], 78, &["driver.program = \"/none/driver\"", "No such file"][..]),
        ("robot", "", &["control"], 78, &["driver.kind = \"robot\" needs driver.program"]),
        ("robot", &example, &["demo"], 78, &["demo moves a simulated robot only"]),
        ("sim", &script, &["driver"], 78, &["starts `teleopd driver` again"]),
        ("sim", "/bin/true", up, 70, ended),
        ("sim", &example, &["driver", "--interface", "jtc100"], 78, &["interface = \"jtc100\", must be \"direct\""]),
        ("robot", &example, &["check", "--interface", "jtc100"], 0, &[]),
        ("robot", &example, &["check", "--interface", "jtc100-restart"], 78, &["(--interface jtc100-restart sets it)"]),
    ] {
        let rig = with_program(kind, program);
        let mut called = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        called.args(command).arg("--config").arg(&rig.place.config);
        if command[0] != "check" {
            called.arg("--run-dir").arg(rig.folder());
        }
        assert_ends(&mut called, code, sentences);
    }
}

#[test]
fn driver_of_real_robot_without_realtime_ends_before_ready() {
    let mut driver = Command::new("timeout");
    let rig = with_program("robot", &example().display().to_string());
    driver.args(["10", env!("CARGO_BIN_EXE_teleopd"), "driver", "--config"]).arg(rig.folder().join("teleop.toml"));
    let output = driver.arg("--run-dir").arg(rig.folder()).arg("--engage-without-realtime").output().expect("it runs");
    if output.status.code() == Some(124) {
        println!("skipped: this machine grants real-time scheduling");
        return;
    }
    let printed = harness::stderr(&output);
    assert_eq!(output.status.code(), Some(69), "{printed}");
    assert!(printed.contains("driver.kind = \"robot\"") && printed.contains("needs real-time scheduling"), "{printed}");
}

#[test]
fn example_driver_stays_short() {
    let text =
        std::fs::read_to_string(harness::repository().join("crates/teleopd/examples/driver.rs")).expect("the example");
    assert!(text.lines().count() <= LINES_MAX, "{} lines", text.lines().count());
}
