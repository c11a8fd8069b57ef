//! Runs `replay` beside a `control` of the test that never engages.

use bus::Domain;
use doors::LeaseState;
use instance::Instance;
use messages::{Layout, RawSkeleton, Service, Smpl, Status};
use operator::Server;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wait::{Pace, within};

/// Longest time for what `replay` does. Only a hang comes near it.
const LONGEST: Duration = Duration::from_secs(30);

/// Distance that the left wrist travels in what `replay` publishes, m, while the robot stays Disengaged.
fn wrist_goes(motion: &str, enough_m: f32) -> f32 {
    let folder = tempfile::Builder::new().prefix("tr").tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let domain = Domain::open(instance.input_domain(), "test").expect("the input domain");
    let mut frames = domain.reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader");
    let mut server = Server::bind(instance.operator_socket()).expect("an operator socket");
    let end = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&end);
    let control = std::thread::spawn(move || {
        let mut pace = Pace::new(Duration::from_millis(5));
        while !ended.load(Ordering::Relaxed) {
            server.poll(rt::now(), &Status::ZERO);
            pace.wait();
        }
    });
    let mut replay = Command::new(env!("CARGO_BIN_EXE_replay"));
    replay.arg(motion).arg("--run-dir").arg(folder.path()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut replay = replay.spawn().expect("replay runs");
    let (mut first, mut goes_m) = (None, 0.0_f32);
    let mut heard: Option<Instant> = None;
    let published = within(LONGEST, || {
        if let Some(frame) = frames.latest() {
            heard.get_or_insert_with(Instant::now);
            let height = frame.positions[Smpl::LeftWrist as usize][2];
            goes_m = goes_m.max((height - *first.get_or_insert(height)).abs());
        }
        // The T-pose of the calibration takes 4 s.
        goes_m >= enough_m || heard.is_some_and(|heard| heard.elapsed() >= Duration::from_secs(8))
    });
    assert!(published, "replay publishes nothing");
    rt::terminate(replay.id());
    replay.wait().expect("replay ends");
    end.store(true, Ordering::Relaxed);
    control.join().expect("the control of the test ends");
    drop((frames, domain));
    instance.retire();
    goes_m
}

#[test]
fn calibration_motion_plays_before_engaging_and_others_wait() {
    assert!(wrist_goes("builtin:calibration", 0.2) >= 0.2, "arms go up and down");
    let goes_m = wrist_goes("builtin", 0.2);
    assert!(goes_m < 0.01, "the first frame is held: {goes_m} m");
}

/// Returns the output of `replay` before it publishes, while a client holds the lease or none does.
fn output_before_holding(held: bool) -> Vec<String> {
    let folder = tempfile::Builder::new().prefix("tr").tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let mut door = doors::Server::bind(&instance.skeleton_socket(), None).expect("a skeleton socket");
    let mut server = Server::bind(instance.operator_socket()).expect("an operator socket");
    let mut replay = Command::new(env!("CARGO_BIN_EXE_replay"));
    replay.arg("builtin").arg("--run-dir").arg(folder.path()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut replay = replay.spawn().expect("replay runs");
    let output = BufReader::new(replay.stdout.take().expect("its words"));
    let reader = std::thread::spawn(move || {
        let mut lines = Vec::new();
        for line in output.lines().map_while(Result::ok) {
            let begins = line.starts_with("holding the first frame");
            lines.push(line);
            if begins {
                break;
            }
        }
        lines
    });
    within(LONGEST, || {
        door.poll(rt::now(), held, |_, _| LeaseState::NotHolder);
        server.poll(rt::now(), &Status::ZERO);
        reader.is_finished()
    });
    rt::terminate(replay.id());
    replay.wait().expect("replay ends");
    let lines = reader.join().expect("the reader ends");
    instance.retire();
    lines
}

#[test]
fn second_client_is_told_that_another_holds_the_lease() {
    let is_refused = |lines: &[String]| lines.iter().any(|line| line.starts_with("Another client holds the lease"));
    let (second, only) = (output_before_holding(true), output_before_holding(false));
    assert!(is_refused(&second) && second.len() > 1, "{second:?}");
    assert!(!is_refused(&only) && only.len() > 1, "{only:?}");
}

#[test]
fn closed_skeleton_socket_ends_replay_with_the_reason() {
    let folder = tempfile::Builder::new().prefix("tr").tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    std::fs::write(folder.path().join(doors::LINK_FILE), "tiago").expect("a link's file");
    let mut door = doors::Server::bind(&instance.skeleton_socket(), None).expect("a skeleton socket");
    let mut server = Server::bind(instance.operator_socket()).expect("an operator socket");
    let mut replay = Command::new(env!("CARGO_BIN_EXE_replay"));
    replay.args(["builtin", "--loop", "--run-dir"]).arg(folder.path()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut replay = replay.spawn().expect("replay runs");
    let mut heard = false;
    let published = within(LONGEST, || {
        door.poll(rt::now(), false, |_, _| {
            heard = true;
            LeaseState::Holder
        });
        server.poll(rt::now(), &Status::ZERO);
        heard
    });
    assert!(published, "replay publishes nothing");
    drop(door);
    // The operator's socket stays, or its end may be seen first.
    let ended = within(LONGEST, || {
        server.poll(rt::now(), &Status::ZERO);
        replay.try_wait().expect("a process").is_some()
    });
    assert!(ended, "replay goes on without a reader");
    let output = replay.wait_with_output().expect("its words");
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && printed.contains("closed the connection"), "{printed}");
    assert!(printed.contains("Nothing reaches robot tiago"), "{printed}");
}
