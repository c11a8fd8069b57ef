//! Tests exhausted resources: shared memory, disk, file descriptors. Each test uses its own small file system
//! instead of a full one. If the system does not allow the mount, the test says so and ends.

use harness::{Operator, Rig, assert_ends, config, in_real_time, wait_until};
use messages::Mode;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

/// Starts a process of teleopd with its own file system of `size` at `place`. `None` if it cannot be mounted.
fn with_small_files_at(place: &Path, size: &str, arguments: &[&str]) -> Option<Child> {
    let script = "mount -t tmpfs -o mode=755,size=\"$1\" small \"$2\" || exit 99; shift 2; exec \"$@\"";
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", script, "sh", size]).arg(place).arg(env!("CARGO_BIN_EXE_teleopd"));
    command.args(arguments).arg("--config").arg(config());
    let probe = Command::new("unshare").args(["--mount", "sh", "-c", "mount -t tmpfs small /mnt"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        println!("skipped: no file system can be mounted here");
        return None;
    }
    Some(command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("unshare runs"))
}

/// Fills the file system of `folder`, as the process `id` sees it.
fn fill(id: u32, folder: &Path) {
    let path = Path::new("/proc").join(id.to_string()).join("root").join(folder.strip_prefix("/").unwrap());
    let mut file = File::create(path.join("fill")).expect("a file in the process's own file system");
    let block = [7; 4096];
    let mut written = 0_u64;
    while file.write_all(&block).is_ok() {
        written += 4096;
        assert!(written < 100 << 20, "this is not the small file system");
    }
}

fn end(child: Child) -> (Output, String) {
    let output = child.wait_with_output().expect("the process ends");
    let printed = format!("{}{}", harness::stdout(&output), harness::stderr(&output));
    (output, printed)
}

#[test]
fn f085_process_without_room_in_shared_memory_does_not_start() {
    let rig = Rig::empty();
    let folder = rig.folder().to_str().unwrap().to_owned();
    let Some(child) = with_small_files_at(Path::new("/dev/shm"), "1m", &["driver", "--run-dir", &folder]) else {
        return;
    };
    let (output, printed) = end(child);
    assert_eq!(output.status.code(), Some(69), "{printed}");
    assert!(printed.contains("/dev/shm: 1048576 bytes are free"), "{printed}");
}

#[test]
fn f085_shared_memory_filled_later_disturbs_no_process() {
    in_real_time(|| {
        let rig = Rig::empty();
        let run_dir = rig.folder().join("run");
        let report = rig.folder().join("report.json");
        let (folder, file) = (run_dir.to_str().unwrap().to_owned(), report.to_str().unwrap().to_owned());
        let arguments = ["demo", "--seconds", "2", "--report", &file, "--run-dir", &folder];
        let Some(child) = with_small_files_at(Path::new("/dev/shm"), "24m", &arguments) else { return };
        wait_until("an operator socket", || run_dir.join("operator.sock").exists());
        let operator = Operator::connect(run_dir.join("operator.sock")).expect("control answers");
        wait_until("engaged", || operator.mode() == Some(Mode::Engaged));
        fill(child.id(), Path::new("/dev/shm"));
        let (output, printed) = end(child);
        assert!(output.status.success(), "{printed}");
        let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
        for kind in ["position", "velocity", "acceleration", "jerk", "clearance"] {
            assert_eq!(report["violations"][kind], 0, "{report:#}");
        }
    });
}

#[test]
fn f084_full_disk_loses_the_figures_but_not_the_stop() {
    let rig = Rig::empty();
    let run_dir = rig.folder().join("run");
    std::fs::create_dir(&run_dir).unwrap();
    let folder = run_dir.to_str().unwrap().to_owned();
    let arguments = ["up", "--engage-without-realtime", "--run-dir", &folder];
    let Some(child) = with_small_files_at(&run_dir, "2m", &arguments) else { return };
    let seen = Path::new("/proc").join(child.id().to_string()).join("root").join(run_dir.strip_prefix("/").unwrap());
    wait_until("an operator socket", || seen.join("operator.sock").exists());
    // What else `up` writes while it starts comes within 2 s.
    let operator = Operator::connect(seen.join("operator.sock")).expect("control answers");
    wait_until("ticking for 2 s", || operator.status().is_some_and(|status| status.ticks > 2 * messages::TICK_HZ));
    fill(child.id(), &run_dir);
    rt::terminate(child.id());
    let (output, printed) = end(child);
    assert_eq!(output.status.code(), Some(1), "figures that could not be written are no success: {printed}");
    assert!(printed.contains("ingest.json: No space left"), "{printed}");
}

#[test]
fn f081_running_processes_open_no_more_descriptors() {
    in_real_time(|| {
        let rig = Rig::whole();
        let operator = rig.operator_session();
        let _client = rig.shared_memory_client();
        operator.engage_until(Mode::Engaging);
        for name in teleopd::PROCESSES {
            let id = rig.id(name).to_string();
            let open = std::fs::read_dir(format!("/proc/{id}/fd")).expect("its descriptors").count();
            let limit = Command::new("prlimit").args(["--pid", &id, &format!("--nofile={open}")]).status();
            assert!(limit.expect("prlimit runs").success(), "{name} takes a limit of {open} descriptors");
        }
        operator.wait_mode(Mode::Engaged);
        operator.release();
        operator.wait_mode(Mode::Disengaged);
    });
}

#[test]
fn f081_too_few_descriptors_are_refused_at_the_start() {
    let rig = Rig::idle("");
    let mut driver = Command::new("prlimit");
    driver.args(["--nofile=12", env!("CARGO_BIN_EXE_teleopd"), "driver", "--config"]).arg(config());
    let few = "12 open files are allowed, 256 are needed";
    assert_ends(driver.arg("--run-dir").arg(rig.folder()), 69, &[few]);
}

#[test]
fn f077_busy_cores_break_no_limit_and_the_robot_comes_to_rest() {
    let (mut rig, operator, mut observer, _client) = Rig::moving(Rig::shared_memory_client);
    let busy = std::sync::atomic::AtomicBool::new(true);
    let threads = 4 * std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while busy.load(std::sync::atomic::Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        operator.wait_control(Duration::from_secs(2));
        busy.store(false, std::sync::atomic::Ordering::Relaxed);
    });
    operator.release();
    operator
        .wait("released", |status| [Mode::Disengaged, Mode::Faulted].iter().any(|&mode| status.mode == mode as u32));
    observer.wait_at_rest();
    rig.end_without_violations();
}
