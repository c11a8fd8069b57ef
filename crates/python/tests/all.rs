//! The package in a virtual environment: its examples, the same numbers as the program `replay`, and other libraries.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// The package, laid out once.
static PACKAGE: LazyLock<PathBuf> = LazyLock::new(package);

/// Lays the package out in a folder below the target folder, as an installation has it, and returns the folder.
fn package() -> PathBuf {
    let tree = harness::repository();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-package");
    let _ = std::fs::remove_dir_all(&folder);
    let copies = [("crates/python/teleopd", "teleopd"), ("tools/clients/python/teleopd_client", "teleopd/client")];
    for (from, to) in copies {
        std::fs::create_dir_all(folder.join(to)).expect("a folder");
        let files = std::fs::read_dir(tree.join(from)).expect("a folder").map(|entry| entry.expect("an entry").path());
        for file in files.filter(|file| file.is_file()) {
            std::fs::copy(&file, folder.join(to).join(file.file_name().expect("a name"))).expect("copied");
        }
    }
    let program = std::env::current_exe().expect("a test is a program");
    // A build beside the tests may replace one of the two at any time.
    let mut built = program.ancestors().skip(1).take(2).map(|folder| folder.join("lib_native.so"));
    let native = built.find(|native| native.exists()).expect("lib_native.so is built with the tests");
    std::fs::copy(native, folder.join("teleopd/_native.abi3.so")).expect("copied");
    folder
}

/// Runs a script of this folder with the package. Prints the reason if this machine cannot. lerobot has an environment of its own.
fn run(script: &str, packages: &[&str], arguments: &[&Path]) {
    let name = if packages[0].starts_with("lerobot") { "lerobot-venv" } else { "python-venv" };
    let venv = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let python = match harness::python(&venv, packages) {
        Ok(python) => python,
        Err(why) => return println!("skipped: no {} for Python: {why}", packages.join(", ")),
    };
    let version = Command::new(&python).args(["-c", "import sys; sys.exit(sys.version_info < (3, 10))"]).status();
    if !version.expect("it starts").success() {
        return println!("skipped: python3 is older than 3.10");
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(script);
    let mut command = Command::new(python);
    command.arg(script).args(arguments).env("PYTHONPATH", &*PACKAGE).current_dir(harness::repository());
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{}{}", String::from_utf8_lossy(&output.stdout), harness::stderr(&output));
    print!("{}", String::from_utf8_lossy(&output.stdout));
}

/// Runs a script with a folder that has the clip `in/clip.bvh`, and with the program `replay`.
fn run_beside_replay(script: &str, packages: &[&str], more: &[&str]) {
    let replay = std::env::current_exe().expect("a test is a program");
    let replay = replay.ancestors().nth(2).expect("a folder").join("replay");
    if !replay.exists() {
        return println!("skipped: replay is not built (cargo build --release -p replay)");
    }
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("in")).expect("a folder");
    let mut clip = motion::builtin();
    clip.frames = clip.frames[400..560].to_vec();
    clip.first = clip.frames.first().copied();
    motion::save_bvh(&clip, &folder.path().join("in/clip.bvh")).expect("saved");
    let more = more.iter().map(Path::new);
    run(script, packages, &[folder.path(), &replay].into_iter().chain(more).collect::<Vec<_>>());
}

#[test]
fn python_library_runs_its_examples_and_equals_replay() {
    run("examples.py", &["numpy", "matplotlib", "pyarrow"], &[]);
    run_beside_replay("equal.py", &["numpy"], &[]);
}

#[test]
fn folder_of_motions_becomes_files_that_other_libraries_read() {
    run_beside_replay("datasets_folder.py", &["numpy", "pyarrow", "pandas", "polars", "duckdb", "datasets"], &[]);
}

#[test]
fn recordings_become_a_lerobot_dataset() {
    run_beside_replay("lerobot_files.py", &["numpy", "pyarrow"], &[]);
}

/// Needs Python 3.12, and 5 GB.
#[test]
#[ignore = "installs lerobot"]
fn lerobot_reloads_the_dataset() {
    run_beside_replay("lerobot_files.py", &["lerobot[dataset]==0.6.1"], &["--reload"]);
}

/// LeRobot's own programs, with a person, and leading the robot. ACT learns for two minutes of one core.
#[test]
#[ignore = "installs lerobot"]
fn programs_of_lerobot_and_its_act_lead_the_robot() {
    let packages = ["lerobot[dataset]==0.6.1", "iceoryx2==0.10.0"];
    run_beside_replay("lerobot_programs.py", &packages, &[]);
    run_beside_replay("act_policy.py", &packages, &[]);
}

#[test]
fn robots_play_their_trajectories_in_mujoco() {
    run("mujoco_plays.py", &["numpy", "mujoco==4.0.0"], &[]);
}

/// Takes minutes on a busy machine.
#[test]
#[ignore = "installs Ray"]
fn killed_worker_of_ray_loses_no_motion() {
    run_beside_replay("ray_workers.py", &["numpy", "pyarrow", "ray[data]==2.60.0"], &[]);
}
