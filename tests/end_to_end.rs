//! Tests real processes over real shared memory: the user's view, and the death of a process.

use harness::{Rig, assert_ends, assert_no_violations, config, in_real_time, modes, wait_until};
use messages::{Fault, Faults, Mode, state_flag};
use std::process::Command;
use std::time::Duration;

/// Time in which an operator's thread sends an order: five heartbeats.
const SENDS: Duration = Duration::from_millis(100);

#[test]
fn robot_engages_follows_and_stops_at_rest() {
    in_real_time(|| {
        let mut rig = Rig::empty();
        let (operator, mut observer, _client) = rig.follow_builtin(0.5);
        operator.wait_control(Duration::from_secs(1));
        operator.release();
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        let control = rig.end("control");
        let driver = rig.end_without_violations();
        let step = driver["engage"]["max_step_rad"].as_f64().unwrap();
        assert!(step < 1e-4, "the first step of engaging was {step} rad");
        let ratio = driver["engage"]["first_second_velocity_ratio"].as_f64().unwrap();
        assert!(ratio > 0.0 && ratio <= 0.05, "the first second ran at {ratio} of the velocity limit");
        let modes = modes(&control);
        assert_eq!(modes[0], "Engaging");
        assert!(modes.iter().any(|mode| mode == "Engaged"), "{modes:?}");
        assert_eq!(modes[modes.len() - 2..], ["Holding", "Disengaged"], "{modes:?}");
        // Disengaged occurs once: nothing else released the robot.
        assert_eq!(modes.iter().position(|mode| mode == "Disengaged"), Some(modes.len() - 1), "{modes:?}");
        assert!(!modes.contains(&"Faulted".to_owned()), "{modes:?}");
    });
}

/// Any connection may stop the robot. Only a robot at rest whose enable was released is reset. `teleopctl` says so.
#[test]
fn emergency_stop_latches_in_every_moving_mode() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        operator.wait("without input", |status| Faults(status.faults).has(Fault::InputStale));
        let (code, printed) = teleopctl(&rig, "engage");
        assert!(code == Some(1) && printed.contains("says who holds the lease"), "{printed}");
        let client = rig.shared_memory_client();
        operator.engage_until(Mode::Engaging);
        let (code, printed) = teleopctl(&rig, "engage");
        assert!(
            code == Some(1) && printed.contains("another operator") && printed.contains("teleopctl release"),
            "{printed}"
        );
        operator.wait_control(Duration::from_millis(300));
        let other = rig.operator_session();
        other.estop();
        operator.wait_mode(Mode::Faulted);
        observer.wait_at_rest();
        assert!(operator.raised(Fault::EmergencyStop) > 0);
        // The enable is still held, so a reset does nothing.
        let (code, printed) = teleopctl(&rig, "reset");
        assert!(code == Some(1) && printed.contains("teleopctl release"), "{printed}");
        operator.assert_stays(Mode::Faulted, Duration::from_millis(300));
        operator.release();
        operator.wait_control(SENDS);
        operator.wait("measured at rest", |status| status.moving == 0);
        other.reset();
        operator.wait_mode(Mode::Disengaged);
        // A reset right after the stop waits for rest.
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        observer.wait_moving();
        assert_eq!(teleopctl(&rig, "estop").0, Some(0));
        operator.release();
        operator.wait_control(SENDS);
        let (code, printed) = teleopctl(&rig, "reset");
        assert!(code == Some(0) && printed.contains("reset: Disengaged"), "{printed}");
        operator.wait_mode(Mode::Disengaged);
        rig.end_without_violations();
    });
}

/// Runs `teleopctl` like an operator.
fn teleopctl(rig: &Rig, command: &str) -> (Option<i32>, String) {
    let mut called = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
    let output = called.arg(command).arg("--run-dir").arg(rig.folder()).output().expect("it runs");
    (output.status.code(), harness::stdout(&output))
}

#[test]
fn dead_input_process_causes_hold_and_then_disengage() {
    in_real_time(|| {
        for (process, fault) in [("ingest", Fault::InputStale), ("retarget", Fault::TargetStale)] {
            let (mut rig, operator, mut observer, _client) = Rig::moving(Rig::shared_memory_client);
            rig.kill(process);
            operator.wait_mode(Mode::Holding);
            observer.wait_at_rest();
            // Without real-time scheduling, a dead retarget first shows as stale input, and later as a stale target.
            operator.wait("faulted for the stale stream", |status| status.fault_counts[fault.index()] > 0);
            operator.wait_mode(Mode::Disengaged);
            // A restart alone never engages, even while the enable is held.
            rig.start(process);
            operator.assert_stays(Mode::Disengaged, Duration::from_secs(1));
            rig.end_without_violations();
        }
    });
}

#[test]
fn f070_f073_restarted_process_with_held_enable_moves_nothing() {
    in_real_time(|| {
        let mut rig = Rig::empty();
        let (operator, mut observer, _client) = rig.follow_builtin(0.1);
        let before = operator.wait_mode(Mode::Engaged).transition_count as usize;
        rig.kill("retarget");
        operator.wait_mode(Mode::Holding);
        // Restart well before the hold times out. The person is visible again, and the enable is still held.
        rig.start("retarget");
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        operator.assert_stays(Mode::Disengaged, Duration::from_secs(1));
        assert_eq!(modes(&rig.end("control"))[before..], ["Holding", "Disengaged"]);
        rig.end_without_violations();
    });
}

/// SIGABRT has the effect of a panic (`rt::abort_on_panic`).
#[test]
fn f058_f073_f075_dead_control_leaves_robot_on_its_certified_stop() {
    in_real_time(|| {
        for signal in ["KILL", "ABRT"] {
            let (mut rig, operator, mut observer, _client) = Rig::moving(Rig::shared_memory_client);
            rig.signal("control", signal);
            rig.ended("control");
            let latched = observer.wait("latched", |state| state.flags & state_flag::DRIVER_FAULT != 0);
            assert!(latched.plan_ticks_played >= 15, "{}", latched.plan_ticks_played);
            observer.wait_at_rest();
            drop(operator);
            // A new control takes over the resting robot. It stays faulted until a reset.
            rig.start("control");
            let operator = rig.operator_session();
            operator.wait_mode(Mode::Faulted);
            assert!(operator.raised(Fault::DriverFault) > 0);
            operator.wait("measured at rest", |status| status.moving == 0);
            operator.reset();
            operator.wait_mode(Mode::Disengaged);
            observer.wait("unlatched", |state| state.flags & state_flag::DRIVER_FAULT == 0);
            rig.end_without_violations();
        }
    });
}

/// Two ticks: the age of the oldest command that may still be executed.
const OLDEST_US: f64 = 2e6 / messages::TICK_HZ as f64;

#[test]
fn f074_suspended_process_stops_robot_and_sends_nothing_old() {
    in_real_time(|| {
        // The driver latches the silence of a suspended control. Control latches the silence of a suspended driver.
        for (process, fault) in [("control", Fault::DeadlineMissed), ("driver", Fault::StateStale)] {
            let (mut rig, operator, mut observer, _client) = Rig::moving(Rig::shared_memory_client);
            rig.signal(process, "STOP");
            // Longer than every stale time, which are relaxed without real-time scheduling (20 x 20 ms). The length of the
            // suspension is the test's input.
            std::thread::sleep(Duration::from_millis(700));
            if process != "driver" {
                observer.wait_at_rest();
            }
            rig.signal(process, "CONT");
            operator.wait("faulted", |status| status.fault_counts[fault.index()] > 0);
            operator.wait_mode(Mode::Faulted);
            observer.wait_at_rest();
            let figures = rig.end_without_violations();
            if process == "driver" {
                // Its figures show the pause, although it executes no command again: nobody takes it for a broken robot.
                let runs: Vec<(u64, u64)> = serde_json::from_value(figures["timeline"]["runs"].clone()).expect("runs");
                assert!(runs.windows(2).any(|pair| pair[1].0 - pair[0].0 - pair[0].1 > 900), "{runs:?}");
            }
            let age = &figures["oldest_command_us"];
            assert!(
                age.as_f64().is_some_and(|us| us <= OLDEST_US),
                "{process}: a command was executed {age} us after its deadline"
            );
        }
    });
}

/// A pause of the simulation is no fault of a robot: it latches nothing, and the robot goes on by itself.
#[test]
fn f051_paused_simulation_holds_and_goes_on() {
    in_real_time(|| {
        let (mut rig, operator, _observer, _client) = Rig::moving(Rig::shared_memory_client);
        if operator.status().is_some_and(|status| status.realtime == 1) {
            return println!("skipped: in real time the simulated robot is as strict as a real one");
        }
        rig.signal("robot", "STOP");
        // Longer than the watchdog of the simulated drives, and shorter than what counts as stale (20 x 20 ms). The length is the
        // test's input.
        std::thread::sleep(Duration::from_millis(250));
        rig.signal("robot", "CONT");
        operator.wait_control(Duration::from_millis(500));
        operator.wait_mode(Mode::Engaged);
        for fault in [Fault::DriverFault, Fault::FeedbackInvalid, Fault::StateStale] {
            assert_eq!(operator.raised(fault), 0, "{fault:?}");
        }
        rig.end_without_violations();
    });
}

#[test]
fn silent_operator_disengages_the_robot() {
    in_real_time(|| {
        let (mut rig, operator, mut observer, _client) = Rig::moving(Rig::shared_memory_client);
        let other = rig.operator_session();
        operator.fall_silent();
        other.wait_mode(Mode::Disengaged);
        assert!(other.raised(Fault::OperatorSilent) > 0);
        observer.wait_at_rest();
        rig.end_without_violations();
    });
}

#[test]
fn f083_control_without_driver_or_person_does_not_engage() {
    for (partners, missing) in [(&["control"][..], Fault::NoRobotState), (&teleopd::PROCESSES[..], Fault::InputStale)] {
        let mut rig = Rig::empty();
        partners.iter().for_each(|name| rig.start(name));
        let operator = rig.operator_session();
        operator.wait("without a partner", |status| Faults(status.faults).has(missing));
        operator.enable();
        let status = operator.wait_control(Duration::from_millis(300));
        let engaging = status.transitions.iter().any(|one| one.to == Mode::Engaging as u32);
        assert!(!engaging, "{missing:?}: {:?}", operator.mode());
    }
}

#[test]
fn f087_run_folder_of_another_user_is_refused_by_its_path() {
    use std::os::unix::process::CommandExt;
    let rig = Rig::empty();
    let folder = rig.folder().join("theirs");
    std::fs::DirBuilder::new().create(&folder).unwrap();
    let (program, settings) = (rig.folder().join("teleopd"), config());
    if !std::fs::metadata("/proc/1/environ").is_ok_and(|_| std::fs::File::open("/proc/1/environ").is_ok()) {
        return println!("skipped: only root can become another user");
    }
    // The build folder may be closed to other users, so the test copies the program to an open folder.
    std::fs::copy(env!("CARGO_BIN_EXE_teleopd"), &program).unwrap();
    for path in [rig.folder(), folder.as_path()] {
        std::fs::set_permissions(path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    }
    let refused = |run_dir: &std::path::Path, parts: &[&str]| {
        let mut driver = Command::new(&program);
        driver.args(["driver", "--engage-without-realtime", "--config"]).arg(&settings).arg("--run-dir").arg(run_dir);
        assert_ends(driver.uid(65534).gid(65534), 69, parts);
    };
    refused(&folder.join("inside"), &[folder.to_str().unwrap(), "Permission denied"]);
    // In the folder of an instance that already exists.
    std::fs::DirBuilder::new().create(folder.join("core")).unwrap();
    let whose = "this instance belongs to user 0, and this program runs as user 65534";
    refused(&folder, &[whose, "sudo -u '#0'", "skeleton.sock"]);
}

#[test]
fn f073_f084_killed_supervisor_leaves_the_robot_at_rest() {
    in_real_time(|| {
        let mut rig = Rig::empty();
        rig.start_up();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let client = rig.shared_memory_client();
        operator.engage_until(Mode::Engaged);
        client.set_engaged(true);
        observer.wait_moving();
        rig.kill("up");
        let driver = rig.figures("driver");
        assert_eq!(driver["ended_at_rest"], true, "{driver:#}");
        assert_no_violations(&driver);
        rig.figures("control");
    });
}

#[test]
fn f092_second_writer_of_the_core_domain_is_refused() {
    let mut rig = Rig::empty();
    rig.start("driver");
    rig.start("control");
    let running = format!("teleopd: an instance already runs in {}", rig.folder().display());
    let expected = [
        ("driver", "driver is already running"),
        ("control", "operator.sock"),
        ("driver", running.as_str()),
        ("up", &running),
    ];
    for (name, printed) in expected {
        rig.assert_ends(name, 75, &[printed]);
    }
}

#[test]
fn metrics_are_served_on_the_loopback_where_a_port_is_set() {
    use std::io::{Read, Write};
    // The driver has the last of four consecutive ports.
    let other = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = other.local_addr().unwrap().port();
    let mut rig = Rig::with_settings(&format!("metrics.port = {}", port - 3));
    rig.assert_ends("driver", 75, &["metrics.port"]);
    drop(other);
    rig.start("driver");
    let scrape = || {
        let mut stream = std::net::TcpStream::connect(("127.0.0.1", port)).expect("the driver listens");
        stream.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        assert!(text.starts_with("HTTP/1.1 200 OK"), "{text}");
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix("teleop_ticks_total{process=\"driver\"} ").map(str::to_owned));
        line.unwrap_or_else(|| panic!("no ticks in {text}")).parse::<u64>().expect("a number")
    };
    let before = scrape();
    wait_until("a later tick in the metrics", || scrape() > before);
}

#[test]
fn f097_f098_bad_setting_is_refused_with_its_key() {
    for (changes, code, parts) in [
        ("", 0, &[][..]),
        ("safety.hold_timeout_s = 5.0", 78, &["hold_timeout_s"]),
        ("safety.tracking_error_rad = 0.4", 78, &["tracking_error_rad"]),
        ("safety.target_stale_ms = nan", 78, &["target_stale_ms"]),
        ("control.grace_us = 500.0", 78, &["is below 500, control.grace_us"]),
        ("sim.watchdog_ms = 100.0", 78, &["sim.reaction = \"play\""]),
        ("driver.program = \"/usr/bin/nonesuch\"", 78, &["driver.program"]),
        ("doors.operator_group = \"nogroup_x\"", 78, &["doors.operator_group"]),
        ("doors.skeleton_group = \"no-such-group\"", 78, &["teleop.toml", "doors.skeleton_group", "no-such-group"]),
        ("ingest.authority_timeout_ms = 500.0", 78, &["ingest.authority_timeout_ms = 500 is below 600"]),
    ] {
        let rig = Rig::idle(changes);
        let mut check = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        println!("{changes}");
        assert_ends(check.arg("check").arg("--config").arg(&rig.place.config), code, parts);
    }
}
