//! Tests the units in config/systemd/. systemd's own checks examine them. A real systemd runs them if one can be
//! booted. On every machine, a stand-in with systemd's protocol observes the processes.

mod machine;
mod stand_in;

use client::{PlayOptions, Player, Publisher, Transport};
use instance::Instance;
use machine::{Machine, Manager, OPERATOR};
use motion::CalibrationMode;
use std::path::{Path, PathBuf};
use std::process::Command;
use teleopd::PROCESSES;

/// Highest exposure that `systemd-analyze security` may report for a system unit, of 10.
const EXPOSURE_MAX: f64 = 2.0;
/// Largest number of faults of a busy computer before the robot is engaged (assumption).
const RESETS_MAX: u32 = 3;

fn unit(process: &str) -> String {
    format!("teleop@{process}.service")
}

/// Copies the units, with the built program in ExecStart=.
fn copy_of_units(manager: &str, to: &Path) {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/systemd").join(manager);
    copy(&from, to);
    let template = to.join("teleop@.service");
    let text = std::fs::read_to_string(&template).expect("the template");
    let built = text.replace("ExecStart=/usr/bin/teleopd", &format!("ExecStart={}", env!("CARGO_BIN_EXE_teleopd")));
    assert_ne!(text, built, "the template starts /usr/bin/teleopd");
    std::fs::write(&template, built).expect("a copy");
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("units").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("a copy");
        }
    }
}

/// Runs systemd-analyze on the copy in `units`, which precedes the machine's own units. It does not look into
/// home folders.
fn analyze(units: &Path, arguments: &[&str]) -> Option<std::process::Output> {
    let mut path = units.as_os_str().to_owned();
    path.push(":");
    let mut command = Command::new("systemd-analyze");
    command.args(arguments).args(PROCESSES.map(unit)).env("SYSTEMD_UNIT_PATH", path);
    command.env("XDG_RUNTIME_DIR", units).env("HOME", units).env_remove("XDG_CONFIG_HOME").env_remove("XDG_DATA_HOME");
    command.env("SYSTEMD_COLORS", "0").output().ok()
}

/// Adds examples/metrics.conf to a copy of the units, with its settings uncommented.
fn open_the_loopback(units: &Path) {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/systemd/examples/metrics.conf");
    let text = std::fs::read_to_string(example).expect("the drop-in");
    let settings = text.lines().filter_map(|line| line.strip_prefix("# ")).filter(|line| line.contains(['=', '[']));
    let settings = settings.skip_while(|line| *line != "[Service]").collect::<Vec<_>>().join("\n");
    assert!(settings.contains("PrivateNetwork=no"), "{settings}");
    let folder = units.join("teleop@.service.d");
    std::fs::create_dir(&folder)
        .and_then(|()| std::fs::write(folder.join("metrics.conf"), settings))
        .expect("a drop-in");
}

/// Adds examples/driver.conf to a copy of the units.
fn open_the_driver(units: &Path) {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/systemd/examples/driver.conf");
    std::fs::copy(example, units.join("teleop@driver.service.d/driver.conf")).expect("a drop-in");
}

#[test]
fn systemd_analyze_verifies_the_units_without_a_warning() {
    for (manager, option, opened) in
        [("system", "--system", false), ("system", "--system", true), ("user", "--user", false)]
    {
        let folder = tempfile::tempdir().expect("a folder");
        copy_of_units(manager, folder.path());
        if opened {
            open_the_loopback(folder.path());
            open_the_driver(folder.path());
        }
        let Some(output) = analyze(folder.path(), &[option, "--man=no", "verify", "teleop.target"]) else {
            return println!("skipped: there is no systemd-analyze");
        };
        let printed = harness::stderr(&output) + &harness::stdout(&output);
        assert!(output.status.success() && printed.trim().is_empty(), "{manager}: {}: {printed}", output.status);
    }
}

#[test]
fn system_units_stay_within_the_exposure_limit() {
    for opened in [false, true] {
        let folder = tempfile::tempdir().expect("a folder");
        copy_of_units("system", folder.path());
        if opened {
            open_the_loopback(folder.path());
        }
        let Some(output) = analyze(folder.path(), &["security", "--offline=true", "--no-pager"]) else {
            return println!("skipped: there is no systemd-analyze");
        };
        let printed = harness::stdout(&output);
        if !output.status.success() && printed.is_empty() {
            return println!("skipped: this systemd-analyze has no --offline: {}", harness::stderr(&output).trim());
        }
        for process in PROCESSES {
            let start = format!("Overall exposure level for {}: ", unit(process));
            let level = printed.lines().find_map(|line| line.split_once(&start)?.1.split_whitespace().next());
            let level: Option<f64> = level.and_then(|level| level.parse().ok());
            let level = level.unwrap_or_else(|| panic!("no level for {process}: {printed}"));
            println!("{process}: exposure {level}{}", if opened { " with the loopback open" } else { "" });
            assert!(level <= EXPOSURE_MAX, "{process}: {level}: {printed}");
        }
    }
}

/// Boots a machine and starts teleop.target. `None` if this computer cannot run one.
fn started() -> Option<Machine> {
    let unbooted = |reason| println!("skipped: no real systemd: {reason}; the stand-in's test is what remains");
    let machine = Machine::boot().map_err(unbooted).ok()?;
    machine.run(&[], &["systemctl", "start", "teleop.target"]);
    for process in PROCESSES {
        // `start` returns when every process of the target has reported READY, or has failed.
        let state = machine.property(&Manager::system(), &unit(process), "SubState");
        assert_eq!(state, "running", "{}", machine.console());
    }
    Some(machine)
}

fn mode(machine: &Machine, run_dir: &str) -> String {
    let output = machine.output(&OPERATOR, &["/usr/bin/teleopctl", "--run-dir", run_dir, "status", "--json"]);
    let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    status["mode"].as_str().unwrap_or("").to_owned()
}

/// client.service runs this in the machine, with the drop-in proposed for clients. It publishes until it is stopped.
#[test]
#[ignore = "a part of the tests with a machine, started by its systemd"]
fn client_publishes_until_stopped() {
    let Some(run_dir) = std::env::var_os("TELEOP_TEST_CLIENT").map(PathBuf::from) else { return };
    let instance = Instance::unmade(&run_dir);
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let player = Player::new(&motion::builtin(), play, 1, rt::incarnation());
    let way = Transport::Socket(instance.skeleton_socket());
    let publisher = Publisher::start_on(way, player, rt::now).expect("a client");
    publisher.set_engaged(true);
    loop {
        std::thread::park();
    }
}

#[test]
fn target_starts_all_and_its_stop_brings_the_robot_to_rest() {
    harness::in_real_time(|| {
        let Some(machine) = started() else { return };
        let system = Manager::system();
        machine.run(&[], &["systemctl", "start", "client.service"]);
        let run_dir = "/run/teleop";
        let teleopctl = |word| ["/usr/bin/teleopctl", "--run-dir", run_dir, word];
        // On a busy computer a process may be late while all start or the robot engages, which is a fault that stays.
        let mut resets = 0;
        let mut is_in = |mode: &str| {
            let status = harness::stdout(&machine.output(&OPERATOR, &teleopctl("status")));
            if status.contains("mode              Faulted") {
                resets += 1;
                assert!(resets <= RESETS_MAX, "faults too often: {}", machine.console());
                machine.output(&OPERATOR, &teleopctl("reset"));
            }
            status.contains(&format!("mode              {mode}")) && !status.contains("\nfault ")
        };
        machine.wait_until("a valid skeleton", || is_in("Disengaged"));
        let null = std::process::Stdio::null;
        let engage = || machine.command(&OPERATOR, &teleopctl("engage")).stdout(null()).spawn().expect("an operator");
        let mut operator = engage();
        machine.wait_until("engaged", || {
            // The first attempt may be refused.
            if operator.try_wait().is_ok_and(|ended| ended.is_some()) {
                operator = engage();
            }
            is_in("Engaged")
        });
        // The shared memory belongs to the instance. Nothing of it is where every user of the machine can see it.
        assert_eq!(std::fs::read_dir(machine.inside("dev/shm")).expect("a folder").count(), 0);
        assert!(std::fs::read_dir(machine.inside("run/teleop/shm")).expect("a folder").count() > 0);

        // The command from README. It returns when all processes are gone, so no wait is needed here.
        machine.run(&[], &["systemctl", "stop", "teleop.target", "teleop@*"]);
        for process in PROCESSES {
            assert_eq!(machine.property(&system, &unit(process), "ActiveState"), "inactive", "{process}");
            assert_eq!(machine.property(&system, &unit(process), "Result"), "success");
        }
        let _ = operator.wait();
        // A process writes its figures when it ends: input first, the driver last.
        let ends = PROCESSES.map(|process| {
            let figures = machine.inside(&format!("run/teleop/{process}.json"));
            std::fs::metadata(&figures).and_then(|metadata| metadata.modified()).expect("figures")
        });
        assert!(ends.is_sorted_by(|earlier_start, later_start| earlier_start >= later_start), "{ends:?}");
        let driver = machine.figures("run/teleop/driver.json");
        assert_eq!(driver["ended_at_rest"], true, "{driver:#}");
        let violations = driver["violations"].as_object().expect("violations");
        harness::assert_always(violations.values().all(|count| *count == 0), format!("{violations:?}"));
        let control = machine.figures("run/teleop/control.json");
        let modes = control["mode_transitions"].as_array().expect("transitions");
        assert!(modes.iter().any(|one| one["to"] == "Engaged"), "the robot was in motion: {control:#}");
    });
}

#[test]
fn f082_watchdog_ends_hung_process_and_control_stays_ended() {
    let Some(machine) = started() else { return };
    let system = Manager::system();
    let invocations = || PROCESSES.map(|process| machine.property(&system, &unit(process), "InvocationID"));
    let before = invocations();
    machine.run(&[], &["systemctl", "kill", "--signal=STOP", &unit("retarget")]);
    machine.wait(&system, &unit("retarget"), "NRestarts", "1");
    machine.wait(&system, &unit("retarget"), "SubState", "running");
    let after = invocations();
    for (index, process) in PROCESSES.iter().enumerate() {
        assert_eq!(before[index] != after[index], *process == "retarget", "{process}: one restart, and of one process");
    }

    machine.run(&[], &["systemctl", "kill", "--signal=STOP", &unit("control")]);
    machine.wait(&system, &unit("control"), "ActiveState", "failed");
    assert_eq!(machine.property(&system, &unit("control"), "Result"), "watchdog");
    assert_eq!(machine.property(&system, &unit("control"), "NRestarts"), "0");

    let ingest = |property| machine.property(&system, &unit("ingest"), property);
    for end in 1..=4 {
        // The third end within 60 s is one too many, because three starts are allowed.
        machine.wait_until("ended or returned", || ingest("SubState") != "auto-restart");
        if ingest("ActiveState") == "failed" {
            assert!(end > 3, "ingest was given up after {} ends", end - 1);
            break;
        }
        machine.wait(&system, &unit("ingest"), "SubState", "running");
        let before = ingest("InvocationID");
        machine.run(&[], &["systemctl", "kill", "--signal=KILL", &unit("ingest")]);
        // Another process may run a second later.
        machine.wait_until("gone", || ingest("SubState") != "running" || ingest("InvocationID") != before);
    }
    machine.wait(&system, &unit("ingest"), "ActiveState", "failed");
    machine.run(&[], &["systemctl", "stop", "teleop.target"]);
    machine.wait(&system, &unit("driver"), "ActiveState", "inactive");
    assert_eq!(machine.figures("run/teleop/driver.json")["ended_at_rest"], true);
}

#[test]
fn user_without_root_starts_and_stops_every_process() {
    harness::in_real_time(|| {
        let unbooted = |reason| println!("skipped: no real systemd: {reason}");
        let Ok(machine) = Machine::boot().map_err(unbooted) else { return };
        let user = Manager::user();
        machine.run(&[], &["systemctl", "start", "user-manager.service"]);
        machine.run(&OPERATOR, &["systemctl", "--user", "start", "teleop.target"]);
        for process in PROCESSES {
            assert_eq!(machine.property(&user, &unit(process), "SubState"), "running", "{}", machine.console());
        }
        // On a busy computer control may be late while all start, which is a fault that stays.
        machine
            .wait_until("an answer", || ["Disengaged", "Faulted"].contains(&&*mode(&machine, "/run/user/1000/teleop")));
        machine.run(&OPERATOR, &["systemctl", "--user", "stop", "teleop.target"]);
        for process in PROCESSES {
            machine.wait(&user, &unit(process), "ActiveState", "inactive");
            assert_eq!(machine.property(&user, &unit(process), "Result"), "success");
        }
        assert_eq!(machine.figures("run/user/1000/teleop/driver.json")["ended_at_rest"], true);
    });
}
