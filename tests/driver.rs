//! A driver's own program in place of the simulated robot: the example of docs/src/drivers.md, compiled and run.

use harness::{DRIVER, Rig, in_real_time};
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
        rig.start_all();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let before = observer.wait("there", |_| true);
        let client = rig.client(&motion::builtin(), 1);
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        let moved = observer.wait_moved(&before, 0.1);
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

#[test]
fn demo_moves_a_simulator_of_the_users_own_and_no_real_robot() {
    in_real_time(|| {
        let program = example().display().to_string();
        for (kind, code) in [("sim", 0), ("robot", 78)] {
            let rig = with_program(kind, &program);
            let report = rig.folder().join("report.json");
            let mut demo = Command::new(env!("CARGO_BIN_EXE_teleopd"));
            demo.args(["demo", "--quiet", "--seconds", "1", "--config"]).arg(rig.folder().join("teleop.toml"));
            let output = demo.arg("--report").arg(&report).output().expect("it runs");
            let printed = harness::stderr(&output);
            assert_eq!(output.status.code(), Some(code), "{printed}");
            if code != 0 {
                assert!(printed.contains("demo moves a simulated robot only"), "{printed}");
                continue;
            }
            let report: Value = serde_json::from_slice(&std::fs::read(&report).expect("written")).expect("JSON");
            assert!(
                report["robot"].is_null() && report["limb_error_deg"]["measured"]["mean"].is_number(),
                "{report:#}"
            );
        }
    });
}

#[test]
fn missing_program_is_refused_by_key_and_name() {
    let rig = with_program("sim", "/nonexistent/driver");
    let output = rig.run("driver");
    let printed = harness::stderr(&output);
    assert_eq!(output.status.code(), Some(78), "{printed}");
    assert!(
        printed.contains("driver.program = \"/nonexistent/driver\"") && printed.contains("No such file"),
        "{printed}"
    );
}

/// The example declares that its robot takes every setpoint.
#[test]
fn interface_that_the_program_does_not_declare_is_refused() {
    let rig = with_program("sim", &example().display().to_string());
    for interface in ["jtc100", "jtc100-restart"] {
        let mut driver = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        driver.args(["driver", "--interface", interface, "--config"]).arg(rig.folder().join("teleop.toml"));
        let output = driver.arg("--run-dir").arg(rig.folder()).output().expect("it runs");
        let error = harness::stderr(&output);
        let sentence = format!("driver.interface = \"{interface}\", must be \"direct\"");
        assert!(output.status.code() == Some(78) && error.contains(&sentence), "{error}");
    }
}

#[test]
fn program_that_ends_before_ready_is_named_by_up() {
    let rig = with_program("sim", "/bin/true");
    let mut up = Command::new(env!("CARGO_BIN_EXE_teleopd"));
    up.args(["up", "--config"]).arg(rig.folder().join("teleop.toml"));
    let output = up.arg("--run-dir").arg(rig.folder()).arg("--engage-without-realtime").output().expect("it runs");
    let printed = harness::stderr(&output);
    assert_eq!(output.status.code(), Some(70), "{printed}");
    let sentence = "driver.program = \"/bin/true\" ended before it was ready (exit status: 0)";
    assert!(printed.contains(sentence) && printed.contains("docs/src/drivers.md"), "{printed}");
}

#[test]
fn real_robot_without_a_program_is_refused() {
    let rig = with_program("robot", "");
    let output = rig.run("control");
    let printed = harness::stderr(&output);
    assert_eq!(output.status.code(), Some(78), "{printed}");
    assert!(printed.contains("driver.kind = \"robot\" needs driver.program"), "{printed}");
}

#[test]
fn interface_of_a_real_robot_is_checked_after_the_options() {
    let rig = with_program("robot", &example().display().to_string());
    for (interface, code) in [("jtc100", 0), ("jtc100-restart", 78)] {
        let mut check = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        let check = check.args(["check", "--interface", interface, "--config"]).arg(rig.folder().join("teleop.toml"));
        let output = check.output().expect("it runs");
        let error = harness::stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{interface}: {error}");
        assert_eq!(error.contains("(--interface jtc100-restart sets it)"), code != 0, "{error}");
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
fn program_that_starts_the_driver_again_is_refused() {
    let script = tempfile::Builder::new().suffix(".sh").tempfile().expect("a file");
    let text = format!("#!/bin/sh\nexec {} driver \"$@\"\n", env!("CARGO_BIN_EXE_teleopd"));
    std::fs::write(script.path(), text).expect("a script");
    std::fs::set_permissions(script.path(), PermissionsExt::from_mode(0o755)).expect("its mode");
    let script = script.into_temp_path();
    let output = with_program("sim", &script.display().to_string()).run("driver");
    let printed = harness::stderr(&output);
    assert!(output.status.code() == Some(78) && printed.contains("starts `teleopd driver` again"), "{printed}");
}

#[test]
fn example_driver_stays_short() {
    let text =
        std::fs::read_to_string(harness::repository().join("crates/teleopd/examples/driver.rs")).expect("the example");
    assert!(text.lines().count() <= LINES_MAX, "{} lines", text.lines().count());
}
