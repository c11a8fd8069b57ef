//! Other programs read the file: the MCAP and protobuf readers of PyPI, if Python and a registry are available.

use crate::support::{loaded, recorded_offline};
use std::path::Path;
use std::process::Command;

const SCRIPT: &str = include_str!("viewers.py");

fn run(program: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        return Some(text.into_owned());
    }
    println!("{}: {}", program.display(), text.trim_end());
    None
}

#[test]
fn mcap_readers_from_pypi_find_the_viewer_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let venv = folder.path().join("venv");
    let (python, pip) = (venv.join("bin/python"), venv.join("bin/pip"));
    let made = run(Path::new("python3"), &["-m", "venv", &venv.to_string_lossy()]);
    let packages = ["install", "--quiet", "--disable-pip-version-check", "--timeout", "5", "--retries", "0"];
    let installed = made.and_then(|_| run(&pip, &[&packages[..], &["mcap", "mcap-protobuf-support"]].concat()));
    if installed.is_none() {
        return println!("skipped: no Python with a registry to install mcap and mcap-protobuf-support from");
    }
    let path = folder.path().join("run.mcap");
    recorded_offline(&path, &loaded());
    let printed = run(&python, &["-c", SCRIPT, &path.to_string_lossy()]).expect("it is read");
    for schema in ["foxglove.FrameTransforms", "foxglove.JointStates", "foxglove.Log", "foxglove.SceneUpdate"] {
        assert!(printed.contains(schema), "{schema}: {printed}");
    }
    assert!(printed.contains("Engaging after Disengaged: enabled.") && printed.contains("capsules True"), "{printed}");
    assert!(printed.contains("joints 17 torso_lift_joint True") && printed.contains("torso_lift_link"), "{printed}");
}

#[test]
fn recording_view_has_duration_and_events_and_reports_a_cut() {
    let folder = tempfile::tempdir().unwrap();
    let (loaded, path) = (loaded(), folder.path().join("run.mcap"));
    let commands = recorded_offline(&path, &loaded);
    let (recording, broken_off) = record::recording_view(&path, &loaded.model).expect("a recording");
    assert_eq!(broken_off, None);
    let run_s = commands.len() as f64 / messages::TICK_HZ as f64;
    assert!((recording.duration_s() - run_s).abs() < 1.0, "{} and {run_s} s", recording.duration_s());
    let engaged = recording.events().iter().filter(|event| event.contains("Engaged after Engaging")).count();
    assert_eq!(engaged, 1, "{:?}", recording.events());
    assert!(record::recording_view(&folder.path().join("none.mcap"), &loaded.model).is_err());
    // Another robot is named. A robot with as many joints and the same name may have got other limits.
    let refused = |change: &dyn Fn(&mut robot::Model)| {
        let mut other = loaded.model.clone();
        change(&mut other);
        record::recording_view(&path, &other).map(drop).map_err(|error| error.to_string())
    };
    let named = refused(&|model| model.name = "other".into()).expect_err("another robot");
    assert!(named.contains("run.mcap") && named.contains("the robot tiago_dual, not other: give --robot"), "{named}");
    let counted = refused(&|model| model.count = 16).expect_err("other joints");
    assert!(counted.contains("with 17 joints, not about tiago_dual with 16 joints"), "{counted}");
    assert_eq!(refused(&|model| model.hash ^= 1), Ok(()));
    // A file that breaks off is reported. Without any message before the break, it is rejected.
    let whole = std::fs::read(&path).unwrap();
    let part = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        record::recording_view(&path, &loaded.model)
    };
    let (half, broken_off) = part("half.mcap", &whole[..whole.len() / 2]).expect("its first half");
    assert!(half.duration_s() < 0.8 * recording.duration_s() && broken_off.is_some(), "{} s", half.duration_s());
    let reported = part("head.mcap", &whole[..5000]).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(reported.contains("head.mcap") && reported.contains("it has no whole message"), "{reported}");
}

/// Runs the program, as `teleopd view FILE` starts it.
#[test]
fn recording_is_served_over_http_and_another_file_is_refused() {
    use std::io::{BufRead, BufReader, Read, Write};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    recorded_offline(&path, &loaded());
    let program = |file: &std::path::Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_record"));
        command.arg("--view").arg(file).args(["--port", "0", "--config"]).arg(crate::support::config());
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::null());
        command
    };
    assert_eq!(program(&crate::support::config()).status().expect("it runs").code(), Some(66));
    let mut child = program(&path).spawn().expect("it runs");
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).expect("its address");
    let host = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()).expect("an address").to_owned();
    let mut stream = std::net::TcpStream::connect(&host).expect("it listens");
    write!(stream, "GET /page.js HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    rt::terminate(child.id());
    assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
    assert!(child.wait().expect("it ends").success());
}
