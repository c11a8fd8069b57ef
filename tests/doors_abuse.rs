//! Tests attacks by a process of the daemon's own user on the shared memory of the input domain, and by a
//! compromised `ingest` on the core. The robot ends at rest, and only `ingest` dies. Also tests attacks of one
//! operator on another.

use bus::Domain;
use harness::user::{User, can_be_another};
use harness::{Rig, assert_no_violations};
use messages::{Layout, Mode, RawSkeleton, Service, Skeleton, skeleton_flag};
use rand::{RngExt, SeedableRng};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// SIGBUS of signal(7): access to memory whose file was truncated.
const SIGBUS: i32 = 7;
/// Processes that share no memory with clients.
const CORE: [&str; 3] = ["driver", "control", "retarget"];

/// A group that every Linux has, for operators. The users below exist on no machine.
const OPERATORS: &str = "sys";
const SOMEBODY: u32 = 42_424;
const ANOTHER: u32 = 42_425;
/// Variable that names the operator socket to the flooding process.
const FLOOD_AT: &str = "TELEOP_TEST_FLOOD_AT";
/// Requests that may be lost in the flood of connections. After these, one must be answered.
const TRIES_MAX: usize = 5;

/// Opens the shared memory of the input domain for writing.
fn input_segments(rig: &Rig) -> Vec<File> {
    let prefix = rig.instance.input_domain().prefix;
    let all = std::fs::read_dir("/dev/shm").expect("shared memory").flatten();
    let ours = all.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
    ours.filter_map(|entry| OpenOptions::new().read(true).write(true).open(entry.path()).ok()).collect()
}

/// Starts a rig that is engaged and moves for a client of the socket. Damage to shared memory then affects only
/// `ingest`.
fn moving() -> (Rig, harness::OperatorSession, harness::StateObserver, client::Publisher) {
    let rig = Rig::whole();
    let (hand, mut eyes) = (rig.hand(), rig.eyes());
    let client = rig.socket_client(&motion::builtin()).expect("the door is open");
    hand.engage_until(Mode::Engaged);
    client.set_engaged(true);
    eyes.wait("moving", |state| state.v.iter().any(|v| v.abs() > 0.2));
    (rig, hand, eyes, client)
}

fn assert_the_core_lives_and_rests(rig: &mut Rig, hand: &harness::OperatorSession, eyes: &mut harness::StateObserver) {
    hand.wait_mode(Mode::Disengaged);
    eyes.wait_at_rest();
    assert!(CORE.iter().all(|name| rig.runs(name)));
    assert_no_violations(&rig.end("driver"));
}

#[test]
fn f091_truncated_segments_end_only_ingest_and_the_robot_rests() {
    let (mut rig, hand, mut eyes, _client) = moving();
    let segments = input_segments(&rig);
    assert!(segments.len() >= 2, "{} segments", segments.len());
    segments.iter().for_each(|file| file.set_len(0).expect("the same user may"));
    let ended = rig.ended("ingest");
    assert_eq!(ended.signal(), Some(SIGBUS), "{ended}: {}", rig.log("ingest"));
    hand.wait_mode(Mode::Holding);
    assert_the_core_lives_and_rests(&mut rig, &hand, &mut eyes);
}

#[test]
fn f089_million_bit_flips_in_input_domain_leave_core_running() {
    let (mut rig, hand, mut eyes, client) = moving();
    let segments = input_segments(&rig);
    let sizes: Vec<u64> = segments.iter().map(|file| file.metadata().map_or(0, |data| data.len())).collect();
    let mut random = rand_pcg::Pcg64::seed_from_u64(89);
    let mut flips = 0_u64;
    while flips < 1_000_000 {
        let which = random.random_range(0..segments.len());
        if sizes[which] == 0 {
            continue;
        }
        let (mut byte, at) = ([0], random.random_range(0..sizes[which]));
        if segments[which].read_at(&mut byte, at).is_ok() {
            byte[0] ^= 1 << random.random_range(0..8);
            let _ = segments[which].write_at(&byte, at);
        }
        flips += 1;
        if flips.is_multiple_of(50_000) {
            assert!(CORE.iter().all(|name| rig.runs(name)), "after {flips} flips");
        }
    }
    println!("ingest {}", if rig.runs("ingest") { "lives" } else { "has died" });
    // `ingest` may be dead, hung or alive. Without the person the robot rests.
    drop(client);
    if rig.runs("ingest") {
        rig.kill("ingest");
    }
    assert_the_core_lives_and_rests(&mut rig, &hand, &mut eyes);
}

#[test]
fn f088_client_with_all_bus_places_does_not_disturb_the_holder() {
    let mut rig = Rig::whole();
    let (hand, mut eyes) = (rig.hand(), rig.eyes());
    let holder = rig.client(&motion::builtin(), 88);
    hand.engage_until(Mode::Engaged);
    holder.set_engaged(true);
    eyes.wait("moving", |state| state.v.iter().any(|v| v.abs() > 0.2));
    let stale = hand.raised(messages::Fault::InputStale);
    let rogue = Domain::open(rig.instance.input_domain(), "rogue").expect("the same user");
    let mut places: Vec<bus::Writer<RawSkeleton>> =
        std::iter::from_fn(|| rogue.writer(Service::RawSkeleton).ok()).collect();
    assert_eq!(places.len(), 7, "eight in all");
    let mut frame = motion::raw_frame(&motion::builtin(), 0, &messages::HingeCalibration::ZERO);
    let until = Instant::now() + Duration::from_secs(3);
    // Each writes at about 1 kHz, 7 kHz together, and each wakes ingest.
    while Instant::now() < until {
        for (session, writer) in places.iter_mut().enumerate() {
            frame.session_nonce = 1000 + session as u64;
            frame.header.sequence += 1;
            (frame.header.stamp, frame.header.origin) = (rt::now(), rt::now());
            let _ = writer.publish(&frame).is_ok() && writer.notify().is_ok();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    hand.wait_mode(Mode::Engaged);
    assert_eq!(hand.raised(messages::Fault::InputStale), stale);
    drop(holder);
    let ingest = rig.end("ingest");
    assert_eq!((&ingest["leases"], &ingest["publish_failures"]), (&1.into(), &0.into()), "{ingest:#}");
    assert!(ingest["over_quota"]["shared memory"].as_u64().unwrap() > 1000, "{ingest:#}");
    assert_no_violations(&rig.end("driver"));
}

/// Draws a random unit quaternion, x y z w.
fn rotation(random: &mut impl RngExt) -> [f32; 4] {
    let q: [f32; 4] = std::array::from_fn(|_| random.random_range(-1.0..1.0));
    let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
    q.map(|x| x / norm)
}

#[test]
fn f109_false_but_valid_skeletons_keep_robot_within_its_limits() {
    let mut rig = Rig::empty();
    for name in CORE {
        rig.start(name);
    }
    let hand = rig.hand();
    let core = Domain::open(rig.instance.core_domain(), "ingest").expect("as ingest would");
    let mut writer = core.writer::<Skeleton>(Service::Skeleton).expect("ingest does not run");
    let loaded =
        config::load(&harness::config(), config::Overrides { engage_without_realtime: true, ..Default::default() });
    let config_hash = loaded.expect("settings").hash;
    let mut random = rand_pcg::Pcg64::seed_from_u64(109);
    let mut skeleton = Skeleton::ZERO;
    (skeleton.header.config_hash, skeleton.header.incarnation, skeleton.session_nonce) = (config_hash, 1, 1);
    skeleton.flags = skeleton_flag::ALL | skeleton_flag::CALIBRATED;
    skeleton.limbs = [[0.0, 0.0, 0.0, 1.0]; 4];
    let (mut engaged, until) = (0_u64, Instant::now() + Duration::from_secs(8));
    let mut asked = false;
    while Instant::now() < until {
        skeleton.header.sequence += 1;
        let now = rt::now();
        (skeleton.header.stamp, skeleton.header.origin, skeleton.received) = (now, now, now);
        // Valid numbers, but not a person: any rotation in any frame, or one that trembles.
        if engaged > 0 && skeleton.header.sequence.is_multiple_of(7) {
            skeleton.limbs = std::array::from_fn(|_| rotation(&mut random));
        }
        writer.publish(&skeleton).and_then(|_| writer.notify()).expect("it goes out");
        let status = hand.status();
        engaged += u64::from(status.is_some_and(|status| status.mode == Mode::Engaged as u32));
        if !asked && status.is_some_and(|status| status.faults == 0 && status.moving == 0 && status.ticks > 750) {
            hand.enable();
            asked = true;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(engaged > 100, "engaged for {engaged} frames, {:?}", hand.status().map(|status| status.faults));
    drop(writer);
    hand.wait_mode(Mode::Disengaged);
    rig.end("control");
    let driver = rig.end("driver");
    assert_no_violations(&driver);
    assert!(driver["min_clearance_mm"].as_f64().unwrap() >= 10.0, "{driver:#}");
}

/// A process that connects to the operator socket as fast as it can. It keeps its newest 64 connections open.
struct Flood(Child);

impl Flood {
    fn at(rig: &Rig) -> Self {
        let mut command = Command::new(std::env::current_exe().expect("this program"));
        command.args(["--exact", "flood_process_connects_until_killed", "--test-threads=1"]);
        command.env(FLOOD_AT, rig.instance.operator_socket()).stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().expect("the flood starts"))
    }
}

impl Drop for Flood {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn flood_process_connects_until_killed() {
    let Some(path) = std::env::var_os(FLOOD_AT) else { return };
    let mut newest = std::collections::VecDeque::new();
    loop {
        newest.extend(doors::connect(std::path::Path::new(&path), "control", 1000).ok());
        if newest.len() > 64 {
            newest.pop_front();
        }
    }
}

fn teleopctl(rig: &Rig, command: &str) -> Output {
    let mut teleopctl = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
    teleopctl.arg(command).arg("--run-dir").arg(rig.folder()).stdin(Stdio::null()).output().expect("it runs")
}

#[test]
fn status_and_reset_are_answered_while_one_process_floods() {
    let rig = Rig::whole();
    let hand = rig.hand();
    hand.wait_mode(Mode::Disengaged);
    let _flood = Flood::at(&rig);
    hand.wait("crowded", |status| status.operators == operator::CLIENTS_MAX as u32);
    let mut lost = Vec::new();
    for round in 0..10 {
        for (command, becomes) in [("status", None), ("estop", Some(Mode::Faulted)), ("reset", Some(Mode::Disengaged))]
        {
            let mut said = String::new();
            let answered = (0..TRIES_MAX).any(|_| {
                let output = teleopctl(&rig, command);
                said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
                lost.extend((!output.status.success()).then(|| format!("{command}: {said}")));
                output.status.success()
            });
            assert!(answered, "round {round}, {command}: {said}");
            becomes.map(|mode| hand.wait_mode(mode));
        }
    }
    println!("{} of 30 were lost: {lost:#?}", lost.len());
    assert!(lost.len() <= 3, "{lost:#?}");
}

#[test]
fn only_the_user_who_pressed_the_stop_or_root_resets_it() {
    if !can_be_another() {
        return;
    }
    let Some(operators) = doors::group_id(OPERATORS) else { return println!("skipped: no group {}", OPERATORS) };
    let changes = format!("doors.operator_group = {OPERATORS:?}\ncontrol.emergency_stop_reset = \"presser\"");
    let mut rig = Rig::with_settings(&changes);
    rig.open_to_others();
    rig.start_all();
    let program = rig.folder().join("teleopctl");
    std::fs::copy(env!("CARGO_BIN_EXE_teleopctl"), &program).expect("a copy that others may run");
    let teleopctl = |uid: u32, command: &str| {
        let user = User { uid, gid: uid, groups: &[operators] };
        let mut teleopctl = Command::new(&program);
        teleopctl.arg(command).arg("--run-dir").arg(rig.folder()).stdin(Stdio::null());
        let output = user.does(|| teleopctl.output().expect("it runs"));
        (output.status.success(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    let hand = rig.hand();
    hand.wait_mode(Mode::Disengaged);
    for (presser, resetter) in [(SOMEBODY, SOMEBODY), (SOMEBODY, 0), (0, 0)] {
        let (stopped, said) = teleopctl(presser, "estop");
        assert!(stopped, "{said}");
        let (reset, said) = teleopctl(ANOTHER, "reset");
        let sentence = match presser {
            0 => "reset refused: the emergency stop was pressed by user root (0); only root may reset it".to_owned(),
            uid => format!("reset refused: the emergency stop was pressed by user {uid}; only this user or root may"),
        };
        assert!(!reset && said.contains(&sentence), "{said}");
        assert_eq!(hand.wait("told", |status| status.reset_first_by == presser + 1).mode, Mode::Faulted as u32);
        let (_, said) = teleopctl(ANOTHER, "status");
        assert!(said.contains(&format!("Only user {presser} or root may reset it.")), "{said}");
        let (reset, said) = teleopctl(resetter, "reset");
        assert!(reset && said.contains("reset: Disengaged"), "{said}");
        assert_eq!(hand.wait_mode(Mode::Disengaged).reset_first_by, 0);
    }
    let give_up = Instant::now() + harness::SOON;
    while !rig.log("control").contains(&format!("of user {ANOTHER}: pressed reset, refused")) {
        assert!(Instant::now() < give_up, "{}", rig.log("control"));
        std::thread::sleep(Duration::from_millis(20));
    }
    // A second user's press does not bypass the first one's.
    assert!(teleopctl(SOMEBODY, "estop").0 && teleopctl(ANOTHER, "estop").0);
    assert!(!teleopctl(ANOTHER, "reset").0);
    let (reset, said) = teleopctl(SOMEBODY, "reset");
    assert!(reset, "{said}");
    // The robot's own emergency stop belongs to no user.
    hand.wait_mode(Mode::Disengaged);
}
