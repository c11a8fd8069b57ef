//! Tests clients in other languages, from the folder that users get, against the real processes.

use harness::{Killed, Rig, SHORT_HOLD, in_real_time, repository, soon, wait_until};
use messages::{Mode, source_flag};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Returns the interpreter of a virtual environment with the client and these packages in it. Prints the reason if there
/// is none.
fn python_with(packages: &[&str]) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("python-client");
    let client = repository().join("tools/clients/python");
    let all = [&[client.to_str().expect("UTF-8")], packages].concat();
    harness::python(&folder, &all).map_err(|why| println!("skipped: no Python client: {why}")).ok()
}

fn python_or_skip() -> Option<PathBuf> {
    python_with(&[])
}

#[test]
fn python_example_publishes_until_interrupted() {
    in_real_time(|| {
        let example = repository().join("tools/clients/python/examples/own.py");
        let text = std::fs::read_to_string(&example).expect("the example");
        assert!(text.lines().count() <= 27 && !text.contains("numpy"), "it is a first example");
        let Some(python) = python_or_skip() else { return };
        let rig = Rig::whole();
        let operator = rig.operator_session();
        // Tests in the background of a shell ignore Ctrl-C, and so would the script.
        let mut script = Command::new("env");
        script.arg("--default-signal=INT").arg(&python).arg(&example).arg(rig.folder());
        script.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut script = Killed(script.spawn().expect("it starts"));
        // Nothing inhibits engaging once a plausible person is visible.
        operator.wait_free();
        harness::interrupt(&script);
        let (mut printed, mut wrong) = (String::new(), String::new());
        script.stdout.take().expect("a pipe").read_to_string(&mut printed).expect("its words");
        script.stderr.take().expect("a pipe").read_to_string(&mut wrong).expect("its words");
        let expected = format!("publishing 60 frames a second to {}; Ctrl-C ends\n", rig.folder().display());
        let ended = script.wait().expect("it ends");
        assert!(ended.success() && printed == expected && wrong.is_empty(), "{printed}{wrong}");
    });
}

/// Each client says in one line what to start, with a folder that is empty, and with one that an instance left.
#[test]
fn python_client_without_an_instance_fails_with_advice() {
    let Some(python) = python_or_skip() else { return };
    let rig = Rig::idle("");
    let example = repository().join("tools/clients/python/examples/own.py");
    let fails = |arguments: &[&str]| {
        let done = Command::new(&python).args(arguments).arg(rig.folder()).stdin(Stdio::null()).output();
        let done = done.expect("it starts");
        let printed = harness::stderr(&done);
        assert!(!done.status.success() && !printed.contains("Traceback"), "{printed}");
        printed
    };
    let example = [example.to_str().expect("UTF-8")];
    let printed = fails(&example);
    assert!(printed.lines().count() == 1, "{printed}");
    assert!(printed.contains("no such folder: is `teleopd up --run-dir "), "{printed}");
    assert!(fails(&["-m", "replay_publish", "--run-dir"]).contains("teleopd up"));
    std::fs::create_dir(rig.folder().join("input")).expect("a folder");
    let printed = fails(&example);
    assert!(printed.contains("no instance of teleopd runs in ") && printed.contains("start `teleopd up"), "{printed}");
    let printed = fails(&["-m", "mediapipe_camera", "--model", "none.task", "--run-dir"]);
    assert!(printed.contains("none.task: no such file"), "{printed}");
}

/// Uses a video of a drawn figure. It covers everything of the camera's client except MediaPipe's model.
#[test]
fn camera_client_with_a_video_moves_the_robot() {
    in_real_time(|| {
        let Some(python) = python_with(&["opencv-python-headless"]) else { return };
        let rig = Rig::whole();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let script = Command::new(&python)
            .arg(repository().join("tests/camera.py"))
            .args([rig.folder(), rig.folder()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn();
        let _script = Killed(script.expect("it starts"));
        operator.engage_until(Mode::Engaging);
        observer.wait_moving();
    });
}

/// A second policy, which sends more than its quota.
const SECOND: &str = include_str!("clients/second.py");

/// The first program of the book's chapter on policies leads an arm. A second one changes nothing, and reads why. The end of
/// the first one stops the robot.
#[test]
fn f138_policy_of_the_book_leads_until_it_ends() {
    let program = crate::policies::book_block("python", 0);
    let program = format!("import sys\n{}", program.replace("Policy(joints", "Policy(sys.argv[1], joints"));
    in_real_time(|| {
        let Some(python) = python_or_skip() else { return };
        let mut rig = Rig::whole();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let script = Command::new(&python).args(["-c", &program]).arg(rig.folder()).stdin(Stdio::null()).spawn();
        let script = Killed(script.expect("it starts"));
        operator.engage_until(Mode::Engaged);
        let before = observer.wait("there", |_| true);
        observer.wait_moved(&before, 0.05);
        let both = source_flag::POLICY[0] | source_flag::POLICY[1];
        operator.wait("led by the policy", |status| status.sources == both);
        let second = Command::new(&python).args(["-c", SECOND]).arg(rig.folder()).output().expect("it runs");
        let printed = String::from_utf8_lossy(&second.stdout).replace('"', "'");
        let refused = ["['lease', 'lease', 'quota']\n", "['lease', 'quota', 'quota']\n"];
        assert!(refused.contains(&&*printed), "{printed}{}", harness::stderr(&second));
        operator.wait("led by the first one", |status| status.sources == both);
        drop(script);
        operator.wait_mode(Mode::Holding);
        let mut takeover = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
        takeover.args(["takeover", "--run-dir"]).arg(rig.folder());
        let printed = String::from_utf8(takeover.output().expect("it runs").stdout).expect("text");
        assert!(printed.contains("the person leads"), "{printed}");
        operator.wait_stopped();
        rig.end("control");
        rig.end_without_violations();
        let figures = rig.end("ingest");
        let chunks = |path: &str| figures.pointer(path).and_then(serde_json::Value::as_u64).unwrap_or_default();
        let dropped = chunks("/chunks/dropped/lease") + chunks("/chunks/dropped/quota");
        assert!(chunks("/chunks/accepted") > 20 && dropped > 100, "{figures:#}");
    });
}

#[test]
fn python_script_in_the_background_ends_on_sigint() {
    let Some(python) = python_or_skip() else { return };
    let rig = Rig::whole();
    let heard = rig.folder().join("heard");
    // Background jobs of a script ignore SIGINT from the start.
    let line = format!(
        "{} -m replay_publish --run-dir {} > {} & child=$!; \
         for i in $(seq 200); do grep -q publishing {} && break; sleep 0.1; done; kill -s INT $child; wait $child",
        python.display(),
        rig.folder().display(),
        heard.display(),
        heard.display()
    );
    let mut shell = Killed(Command::new("sh").arg("-c").arg(line).spawn().expect("a shell"));
    wait_until("ended", || shell.try_wait().expect("its state").is_some());
    let printed = std::fs::read_to_string(&heard).expect("what it printed");
    let expected = format!("publishing to {}; Ctrl-C ends\n", rig.folder().display());
    assert_eq!(printed, expected);
}

/// The status and the log say why frames are dropped.
#[test]
fn status_and_log_say_why_all_frames_of_a_client_are_dropped() {
    let rig = Rig::whole();
    let operator = rig.operator_session();
    let mut small = motion::builtin();
    for frame in &mut small.frames {
        frame.positions.iter_mut().flatten().for_each(|metres| *metres *= 0.3);
    }
    let client = rig.client(&small, 51);
    operator.wait("a reason", |status| status.input_drop == skeleton::DropReason::Size as u32 + 1);
    let mut status = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
    status.arg("--run-dir").arg(rig.folder()).args(["status", "--json"]);
    let printed: serde_json::Value = serde_json::from_slice(&status.output().expect("it runs").stdout).expect("JSON");
    assert_eq!(printed["input_drop"], "Size", "{printed:#}");
    let is_reason = |line: &str| {
        line.contains("WARN") && line.contains("dropped within a second: Size (") && line.contains("hips to shoulders")
    };
    assert!(soon(|| rig.log("ingest").lines().any(is_reason)), "{}", rig.log("ingest"));
    // A second after the last frame, no drop is reported any more.
    drop(client);
    operator.wait("silent", |status| status.input_drop == 0);
}

/// A client that closes its hand, and reads what the robot answers until the gripper follows.
const GRIPS: &str = include_str!("clients/grips.py");
/// The person of the example, who moves a little.
const OWN_PERSON: &str = include_str!("clients/own_person.py");

/// The session of the package `teleopd`, which publishes until the robot follows.
const SESSION: &str = include_str!("clients/session.py");

#[test]
fn python_session_publishes_and_reads_the_mode() {
    in_real_time(|| {
        let Some(python) = python_with(&["numpy"]) else { return };
        let rig = Rig::whole();
        let operator = rig.operator_session();
        std::fs::write(rig.folder().join("own_person.py"), OWN_PERSON).expect("a file");
        // The parts that need no extension.
        let package = rig.folder().join("package");
        std::fs::create_dir_all(package.join("client")).expect("a folder");
        std::fs::write(package.join("__init__.py"), "").expect("a file");
        for (from, to) in [
            ("crates/python/teleopd/session.py", "session.py"),
            ("tools/clients/python/teleopd_client/__init__.py", "client/__init__.py"),
            ("tools/clients/python/teleopd_client/layout.py", "client/layout.py"),
        ] {
            std::fs::copy(repository().join(from), package.join(to)).expect("copied");
        }
        let mut script = Command::new(&python);
        script.args(["-c", SESSION]).arg(rig.folder()).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut script = Killed(script.spawn().expect("it starts"));
        operator.engage_until(Mode::Engaged);
        let mut printed = String::new();
        script.stdout.take().expect("a pipe").read_to_string(&mut printed).expect("its words");
        assert!(printed.starts_with("Engaged ") && printed.trim().len() > 12, "{printed}");
        operator.wait_mode(Mode::Disengaged);
    });
}

#[test]
fn python_client_grips_and_reads_what_the_robot_answers() {
    in_real_time(|| {
        let Some(python) = python_or_skip() else { return };
        let mut rig = Rig::with_settings(SHORT_HOLD);
        rig.start_all();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        std::fs::write(rig.folder().join("own_person.py"), OWN_PERSON).expect("a file");
        let mut script = Command::new(&python);
        script.args(["-c", GRIPS]).args([rig.folder(), rig.folder()]).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut script = Killed(script.spawn().expect("it starts"));
        operator.engage_until(Mode::Engaged);
        let mut printed = String::new();
        script.stdout.take().expect("a pipe").read_to_string(&mut printed).expect("its words");
        let printed: serde_json::Value = serde_json::from_str(&printed).expect("an answer");
        assert!(printed["sentence"].as_str().is_some_and(|sentence| sentence.len() > 5), "{printed}");
        assert_eq!(printed["held"], serde_json::json!([false, true]), "the lease, before and after the first frame");
        let clearance = |side: usize| printed["clearance_m"][side].as_f64().expect("a number");
        assert!(clearance(0) > 0.009 && clearance(1) > 0.009 && clearance(0) < 2.0, "{printed}");
        // Status, state and both grippers are known.
        assert_eq!(printed["known"].as_u64().map(|known| known & 15), Some(15), "{printed}");
        assert_eq!(printed["closure"][1], 0.0, "the other hand is not known");
        // After the script ends, no frames arrive.
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        rig.end_without_violations();
        let figures = rig.end("ingest");
        assert!(figures["accepted"].as_u64() > Some(60) && figures["dropped"] == serde_json::json!({}), "{figures:#}");
    });
}
