//! Tests `teleopd doctor` on machines and instances that are really broken.

use harness::{Rig, assert_ends, holds_for, wait_until};
use instance::Instance;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// EX_CONFIG of sysexits(3).
const EX_CONFIG: i32 = 78;
/// Fine for the simulator, not ready for a robot.
const SIMULATOR_ONLY: i32 = 3;
/// Exit code of a demo that the machine held back by a pause.
const HELD: i32 = 2;

/// Copies of the repository's settings, robot and weights for the tests to damage, and a run folder.
struct Patient {
    folder: tempfile::TempDir,
    config: PathBuf,
    run_dir: PathBuf,
}

impl Patient {
    fn new() -> Self {
        let folder = tempfile::Builder::new().prefix("td").tempdir().expect("a temporary folder");
        let (config, run_dir) = (folder.path().join("teleop.toml"), folder.path().join("run"));
        let shipped = std::fs::read_to_string(harness::config()).expect("the shipped settings");
        let robots = format!("\"{}/config/robots/", harness::repository().display());
        let text = shipped.replace("\"robots/", &robots).replace("\"../weights/", "\"weights/");
        std::fs::write(&config, text).expect("settings");
        std::fs::create_dir(folder.path().join("weights")).expect("a folder");
        for name in [
            "tiago_dual.toml",
            "tiago_dual.safetensors",
            "prediction.toml",
            "prediction.safetensors",
            "lifter.toml",
            "lifter.safetensors",
        ] {
            let from = harness::repository().join("weights").join(name);
            std::fs::copy(from, folder.path().join("weights").join(name)).expect("weights");
        }
        Self { folder, config, run_dir }
    }

    fn command(&self) -> String {
        let (program, config, run_dir) = (env!("CARGO_BIN_EXE_teleopd"), self.config.display(), self.run_dir.display());
        format!("exec {program} doctor --config {config} --run-dir {run_dir} --engage-without-realtime")
    }

    fn shell(&self, before: &str, after: &str) -> Output {
        let line = format!("{before} {} {after}", self.command());
        Command::new("sh").arg("-c").arg(line).output().expect("a shell")
    }

    /// Returns every finding. Checks that the exit code agrees.
    fn findings(&self, before: &str) -> Vec<Value> {
        let output = self.shell(before, "--json");
        let all: Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{error}: {}", harness::stderr(&output)));
        let (simulator, robot) = (all["simulator"] == true, all["robot"] == true);
        let all = all["findings"].as_array().expect("an array").clone();
        for finding in &all {
            let keys: Vec<_> = finding.as_object().expect("an object").keys().collect();
            assert_eq!(keys, ["check", "level", "found", "advice"]);
        }
        let any = |level: &str| all.iter().any(|finding| finding["level"] == level);
        let code = match (any("problem"), any("robot")) {
            (true, _) => EX_CONFIG,
            (false, true) => SIMULATOR_ONLY,
            (false, false) => 0,
        };
        assert_eq!(output.status.code(), Some(code), "{all:#?}");
        assert_eq!((simulator, robot), (code != EX_CONFIG, code == 0), "{all:#?}");
        all
    }

    fn finding(&self, check: &str, before: &str) -> Value {
        let all = self.findings(before);
        all.iter().find(|finding| finding["check"] == check).unwrap_or_else(|| panic!("no {check}: {all:#?}")).clone()
    }

    /// Checks that the finding of `check` has `level` and contains `words`.
    fn shows(&self, check: &str, level: &str, words: &[&str], before: &str) {
        let finding = self.finding(check, before);
        assert_eq!(finding["level"], level, "{finding:#}");
        for word in words {
            assert!(finding.to_string().contains(word), "{word}: {finding:#}");
        }
    }
}

fn files_below(folder: &Path) -> BTreeSet<PathBuf> {
    glob::glob(&folder.join("**/*").display().to_string()).expect("a pattern").flatten().collect()
}

#[test]
fn doctor_finds_no_problem_in_a_sound_setup_and_writes_nothing() {
    let patient = Patient::new();
    let before = files_below(patient.folder.path());
    let all = patient.findings("");
    for check in ["settings", "robot", "weights", "stages", "run folder", "instance", "shared memory", "open files"] {
        let finding = all.iter().find(|finding| finding["check"] == check).expect(check);
        assert_eq!(finding["level"], "ok", "{finding:#}");
    }
    assert_eq!(files_below(patient.folder.path()), before, "it looked, no more");
    let words = patient.shell("", "");
    let text = harness::stdout(&words);
    assert!(text.contains("\nfine for the simulator\n"), "{text}");
    assert!(text.contains("\nready for a robot") || text.contains("\nnot ready for a robot: "), "{text}");
    // Other instances may start and stop between the two runs.
    for finding in all.iter().filter(|finding| finding["check"] != "other instances") {
        assert!(text.contains(finding["advice"].as_str().expect("text")), "{finding:#}\n{text}");
    }
}

/// Returns a command whose reader closes the pipe before the first output.
fn unheard(program: &str) -> Command {
    let gone = || {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        writer
    };
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).stdout(gone()).stderr(gone()).current_dir(harness::repository());
    command
}

#[test]
fn closed_output_pipe_ends_no_program() {
    let teleopd = env!("CARGO_BIN_EXE_teleopd");
    let run = |command: &mut Command| command.status().expect("it runs").code();
    assert_eq!(run(unheard(teleopd).arg("check")), Some(0));
    assert_eq!(run(unheard(teleopd).args(["check", "--config", "/nowhere"])), Some(EX_CONFIG));
    let doctor = run(unheard(teleopd).args(["doctor", "--engage-without-realtime"]));
    assert!(matches!(doctor, Some(0 | SIMULATOR_ONLY | EX_CONFIG)), "{doctor:?}");
    let rig = Rig::empty();
    let report = rig.folder().join("report.json");
    let demo = run(unheard(teleopd).args(["demo", "--seconds", "0.5", "--report"]).arg(&report));
    assert!(matches!(demo, Some(0 | HELD)), "{demo:?}");
    assert!(std::fs::read_to_string(report).expect("a report").contains("min_clearance_mm"));
    let place = rig.folder().to_str().expect("UTF-8");
    let mut up = unheard(teleopd).args(["up", "--engage-without-realtime", "--run-dir", place]).spawn().expect("up");
    wait_until("ready", || {
        assert!(up.try_wait().expect("its state").is_none(), "up has ended");
        run(unheard(env!("CARGO_BIN_EXE_teleopctl")).args(["status", "--run-dir", place])) == Some(0)
    });
    // By then the last process runs, and `ready in` is printed or lost.
    assert!(holds_for(Duration::from_millis(500), || up.try_wait().expect("its state").is_none()), "up has ended");
    rt::terminate(up.id());
    assert_eq!(up.wait().expect("it ends").code(), Some(0));
}

/// A demo that cannot be says so in one sentence. It starts nothing, and replaces no file.
#[test]
fn refused_demo_starts_and_replaces_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = |name: &str| folder.path().join(name).display().to_string();
    let kept = "of yesterday";
    for (name, text) in [("walk.json", kept), ("run.mcap", kept), ("bad.bvh", "no motion"), ("arms.csv", "t_s\n")] {
        std::fs::write(place(name), text).expect("a file");
    }
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("its address").port().to_string();
    for (arguments, code, parts) in [
        (["--motion", &place("bad.bvh"), "--report", &place("walk.json")], 66, ["bad.bvh"; 2]),
        (["--motion", &place("bad.bvh"), "--report", &place("new.json")], 66, ["bad.bvh"; 2]),
        (["--motion", &place("arms.csv"), "--report", &place("walk.json")], 66, ["arms.csv", "`replay` plays .csv"]),
        (["--quiet", "--view", "--view-port", &port], 69, ["--view-port 0", &port]),
        (["--seconds", "6", "--record", &place("run.mcap")], 73, ["exists already, and is not replaced"; 2]),
        (["--seconds", "6", "--record", &place("none/run.mcap")], 73, ["there is no folder"; 2]),
    ] {
        let mut demo = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        demo.arg("demo").args(arguments).args(["--run-dir", &place("run")]).current_dir(harness::repository());
        assert_ends(&mut demo, code, &parts);
        assert!(!Path::new(&place("run/driver.log")).exists(), "{arguments:?}: a process was started");
    }
    for name in ["walk.json", "run.mcap"] {
        assert_eq!(std::fs::read_to_string(place(name)).expect("still there"), kept);
    }
    assert!(!Path::new(&place("new.json")).exists());
}

#[test]
fn settings_copied_alone_are_refused_by_key_and_path() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = folder.path().join("mine.toml");
    std::fs::copy(harness::config(), &config).expect("settings");
    let refused = |parts: &[&str]| {
        let mut check = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        assert_ends(check.arg("check").arg("--config").arg(&config), EX_CONFIG, parts);
    };
    refused(&["tiago_dual.toml: there is no such file", "robot.file in ", "mine.toml", "relative to that file"]);
    let robots = format!("\"{}/config/robots/", harness::repository().display());
    let text = std::fs::read_to_string(&config).expect("settings").replace("\"robots/", &robots);
    std::fs::write(&config, text).expect("settings");
    refused(&["weights.file in ", "tiago_dual.toml: there is no such file"]);
}

#[test]
fn doctor_reports_dangling_link_pipe_and_limit_without_blocking() {
    let patient = Patient::new();
    std::os::unix::fs::symlink("/nowhere/at/all", &patient.run_dir).expect("a link");
    patient.shows("run folder", "problem", &["dangling link"], "");
    patient.shows("open files", "problem", &["64 at most", "ulimit -n"], "ulimit -n 64;");
    // Opening a pipe without a writer would block.
    std::fs::remove_file(&patient.config).expect("it was there");
    let made = Command::new("mkfifo").arg(&patient.config).status().expect("mkfifo");
    assert!(made.success());
    patient.shows("settings", "problem", &["is not a regular file"], "");
}

#[test]
fn f086_doctor_names_live_instance_and_leftovers_of_dead_one() {
    let mut rig = Rig::whole();
    let mut patient = Patient::new();
    patient.run_dir = rig.folder().to_path_buf();
    let control = rig.id("control");
    patient.shows("instance", "note", &[&format!("process {control} ")], "");
    patient.shows("shared memory", "ok", &["all in use"], "");
    for name in ["ingest", "retarget", "control", "driver", "robot"] {
        rig.kill(name);
    }
    patient.shows("instance", "ok", &[], "");
    let prefix = Instance::unmade(rig.folder()).core_domain().prefix;
    patient.shows("shared memory", "note", &[&prefix, "a dead instance", "rm /dev/shm/teleop_core_"], "");
    patient.run_dir = patient.folder.path().join("elsewhere");
    patient.shows("other instances", "note", &[&prefix, "dead instance", "rm /dev/shm/teleop_core_"], "");
    patient.run_dir = rig.folder().to_path_buf();
    rig.instance.retire();
    patient.shows("shared memory", "ok", &["nothing is left behind"], "");
}

/// Returns the names in /dev/shm that belong to the rig's instance.
fn shared_memory(rig: &Rig) -> Vec<String> {
    let files = rig.instance.shared_memory();
    files.filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned())).collect()
}

#[test]
fn f086_leftovers_of_killed_processes_are_gone_after_next_run() {
    let mut rig = Rig::empty();
    rig.start_up();
    let up = rig.id("up").to_string();
    let children = || std::fs::read_to_string(format!("/proc/{up}/task/{up}/children")).expect("its children");
    // The last of the five processes opens its socket once it has created everything.
    let are_started = || children().split_whitespace().count() == 5 && rig.instance.skeleton_socket().exists();
    wait_until("five processes", are_started);
    let children = children();
    let processes: Vec<&str> = std::iter::once(up.as_str()).chain(children.split_whitespace()).collect();
    assert_eq!(processes.len(), 6, "{processes:?}");
    assert!(Command::new("kill").arg("-9").args(&processes).status().expect("kill").success());
    rig.ended("up");
    let left: BTreeSet<String> =
        shared_memory(&rig).into_iter().filter(|name| !name.ends_with(".global_mgmt")).collect();
    assert!(left.len() > 20, "{left:?}");
    // A cleaner of /tmp removes the transport's own list of its resources.
    std::fs::remove_dir_all(rig.folder().join("core")).expect("the core's folder");
    rig.start_all();
    let again: Vec<_> = shared_memory(&rig).into_iter().filter(|name| left.contains(name)).collect();
    assert_eq!(again, Vec::<String>::new(), "the start has collected it");
    for name in ["ingest", "retarget", "control", "driver"] {
        rig.end(name);
    }
    assert_eq!(shared_memory(&rig), Vec::<String>::new());
    rig.start_up();
    rig.end_up();
    assert_eq!(shared_memory(&rig), Vec::<String>::new());
    let own = rig.folder().join(format!("ready-{}.sock", std::process::id()));
    let sockets =
        files_below(rig.folder()).into_iter().filter(|path| path.extension().is_some_and(|end| end == "sock"));
    assert_eq!(sockets.collect::<Vec<_>>(), [own], "only that of this test is left");
}

/// Hands that hang would stand in the floor, because the file lacks the height of the base. The file loads.
#[test]
fn doctor_of_a_robot_fails_where_following_would() {
    let patient = Patient::new();
    let robots = harness::repository().join("config/robots");
    std::fs::copy(robots.join("unitree_g1.urdf"), patient.folder.path().join("unitree_g1.urdf")).expect("a URDF");
    let file = patient.folder.path().join("own.toml");
    let text = std::fs::read_to_string(robots.join("unitree_g1.toml")).expect("a robot file");
    for (height_m, level) in [("0.7919", "ok"), ("0.1", "problem")] {
        let text = text.replace("base_height_m = 0.7919", &format!("base_height_m = {height_m}"));
        std::fs::write(&file, text).expect("a robot file");
        let output = patient.shell("", &format!("--robot {}", file.display()));
        let page = harness::stdout(&output);
        let line = page.lines().find(|line| line.contains(" hanging hands ")).unwrap_or_else(|| panic!("{page}"));
        assert!(line.starts_with(level) && line.contains("mm between "), "{line}");
        let fails = page.contains("not fine for the simulator: ");
        assert_eq!(
            (fails, output.status.code() == Some(EX_CONFIG)),
            (level == "problem", level == "problem"),
            "{page}"
        );
    }
}
