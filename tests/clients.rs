//! Clients in other languages, from the folder that users get, against the real processes.

mod rig;

use messages::Mode;
use rig::{Rig, assert_no_violations, repository};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Ended with the test, whatever its outcome.
struct Client(Child);

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The interpreter of a virtual environment with the client in it, or why there is none.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-client");
    let python = folder.join("bin/python");
    let run = |command: &mut Command| match command.output() {
        Ok(done) if done.status.success() => Ok(()),
        Ok(done) => Err(format!("{command:?}: {}", String::from_utf8_lossy(&done.stderr).trim())),
        Err(error) => Err(format!("{command:?}: {error}")),
    };
    if !python.exists() {
        run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    }
    let package = repository().join("tools/clients/python");
    run(Command::new(&python)
        .args(["-m", "pip", "install", "--quiet", "--retries", "1", "--timeout", "10"])
        .arg(package))?;
    Ok(python)
}

#[test]
fn a_python_script_moves_the_robot() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => return println!("skipped: no Python client: {why}"),
    };
    let mut rig = Rig::whole();
    let (hand, mut eyes) = (rig.hand(), rig.eyes());
    let before = eyes.wait_at_rest();
    let script = Command::new(&python)
        .args(["-m", "replay_publish", "--run-dir"])
        .arg(rig.folder())
        .current_dir(rig.folder())
        .stdin(Stdio::null())
        .spawn();
    let script = Client(script.expect("it starts"));
    hand.engage_until(Mode::Engaged);
    eyes.wait_moved(&before, 0.5);
    // A script that ends is silence.
    drop(script);
    hand.wait_mode(Mode::Disengaged);
    eyes.wait_at_rest();
    assert_no_violations(&rig.end("sim"));
    let figures = rig.end("ingest");
    assert!(figures["accepted"].as_u64() > Some(60) && figures["dropped"] == serde_json::json!({}), "{figures:#}");
}

#[test]
fn a_python_script_without_a_daemon_says_so() {
    let Ok(python) = python() else { return println!("skipped: no Python client; the other test says why") };
    let rig = Rig::empty();
    let done =
        Command::new(python).args(["-m", "replay_publish", "--run-dir"]).arg(rig.folder()).output().expect("it starts");
    let told = String::from_utf8_lossy(&done.stderr);
    assert!(!done.status.success() && told.contains("teleopd up") && !told.contains("Traceback"), "{told}");
}
