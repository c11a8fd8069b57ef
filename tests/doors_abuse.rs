//! Tests attacks by a process of the daemon's own user on the shared memory of the input domain, and by a compromised
//! `ingest` on the core. The robot ends at rest, and only `ingest` dies. Also tests attacks of one operator on another.

use bus::Domain;
use harness::user::{User, can_be_another};
use harness::{Operator, Pace, Rig, SHORT_HOLD, in_real_time, soon};
use messages::{Layout, Mode, Service, Skeleton, skeleton_flag};
use rand::{RngExt, SeedableRng};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// SIGBUS of signal(7): access to memory whose file was truncated.
const SIGBUS: i32 = 7;
/// Processes that share no memory with clients.
const CORE: [&str; 3] = ["driver", "control", "retarget"];

/// A group that every Linux has, for operators. The users below exist on no machine.
const OPERATORS: &str = "sys";
const SOMEBODY: u32 = 42_424;
const ANOTHER: u32 = 42_425;

/// Opens the shared memory of the input domain for writing.
fn input_segments(rig: &Rig) -> Vec<File> {
    let prefix = rig.instance.input_domain().prefix;
    let all = std::fs::read_dir("/dev/shm").expect("shared memory").flatten();
    let ours = all.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
    ours.filter_map(|entry| OpenOptions::new().read(true).write(true).open(entry.path()).ok()).collect()
}

/// Random bits flip, and then the segments of the next `ingest` are truncated. Only `ingest` may die.
#[test]
fn f089_f091_flipped_or_truncated_input_memory_leaves_core_running() {
    in_real_time(|| {
        let (mut rig, operator, mut observer, client) = Rig::moving(Rig::socket_client);
        let segments = input_segments(&rig);
        let sizes: Vec<u64> = segments.iter().map(|file| file.metadata().map_or(0, |data| data.len())).collect();
        let mut random = rand_pcg::Pcg64::seed_from_u64(89);
        for flips in 0..1_000_000 {
            let which = random.random_range(0..segments.len());
            let (mut byte, at) = ([0], random.random_range(0..sizes[which].max(1)));
            if segments[which].read_at(&mut byte, at).is_ok() {
                byte[0] ^= 1 << random.random_range(0..8);
                let _ = segments[which].write_at(&byte, at);
            }
            if flips % 50_000 == 0 {
                assert!(CORE.iter().all(|name| rig.runs(name)), "after {flips} flips");
            }
        }
        // `ingest` may be dead, hung or alive. Without the person the robot rests.
        drop(client);
        println!("ingest {}", if rig.runs("ingest") { "lives" } else { "has died" });
        rig.kill("ingest");
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        rig.start("ingest");
        let _client = rig.socket_client();
        let segments = input_segments(&rig);
        assert!(segments.len() >= 2, "{} segments", segments.len());
        segments.iter().for_each(|file| file.set_len(0).expect("the same user may"));
        let ended = rig.ended("ingest");
        assert_eq!(ended.signal(), Some(SIGBUS), "{ended}: {}", rig.log("ingest"));
        assert!(CORE.iter().all(|name| rig.runs(name)));
        rig.end_without_violations();
    });
}

/// Draws a random unit quaternion, x y z w.
fn rotation(random: &mut impl RngExt) -> [f32; 4] {
    let q: [f32; 4] = std::array::from_fn(|_| random.random_range(-1.0..1.0));
    let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
    q.map(|x| x / norm)
}

#[test]
fn f109_false_but_valid_skeletons_keep_robot_within_its_limits() {
    in_real_time(|| {
        let mut rig = Rig::with_settings(SHORT_HOLD);
        for name in CORE {
            rig.start(name);
        }
        let operator = rig.operator_session();
        let core = Domain::open(rig.instance.core_domain(), "ingest").expect("as ingest would");
        let mut writer = core.writer::<Skeleton>(Service::Skeleton).expect("ingest does not run");
        let config_hash = rig.place.load().expect("settings").hash;
        let mut random = rand_pcg::Pcg64::seed_from_u64(109);
        let mut skeleton = Skeleton::ZERO;
        (skeleton.header.config_hash, skeleton.header.incarnation, skeleton.session_nonce) = (config_hash, 1, 1);
        skeleton.flags = skeleton_flag::ALL | skeleton_flag::CALIBRATED;
        skeleton.limbs = [[0.0, 0.0, 0.0, 1.0]; 4];
        let (mut engaged, until) = (0_u64, Instant::now() + Duration::from_secs(8));
        let (mut asked, mut pace) = (false, Pace::new(Duration::from_millis(10)));
        // Two seconds of falsehood are enough.
        while engaged < 200 && Instant::now() < until {
            skeleton.header.sequence += 1;
            let now = rt::now();
            (skeleton.header.stamp, skeleton.header.origin, skeleton.received) = (now, now, now);
            // Valid numbers, but not a person: any rotation in any frame, or one that trembles.
            if engaged > 0 && skeleton.header.sequence.is_multiple_of(7) {
                skeleton.limbs = std::array::from_fn(|_| rotation(&mut random));
            }
            writer.publish(&skeleton).and_then(|_| writer.notify()).expect("it goes out");
            let status = operator.status();
            engaged += u64::from(status.is_some_and(|status| status.mode == Mode::Engaged as u32));
            if !asked && status.as_ref().is_some_and(Operator::is_free) {
                operator.enable();
                asked = true;
            }
            pace.wait();
        }
        assert!(engaged > 100, "engaged for {engaged} frames, {}", operator.describe());
        drop(writer);
        operator.wait_mode(Mode::Disengaged);
        rig.end("control");
        let driver = rig.end_without_violations();
        let clearance_mm = driver["min_clearance_mm"].as_f64().unwrap();
        harness::assert_always(clearance_mm >= 10.0, format!("{driver:#}"));
    });
}

#[test]
fn only_the_user_who_pressed_the_stop_or_root_resets_it() {
    if !can_be_another() {
        return;
    }
    let Some(operators) = doors::group_id(OPERATORS) else { return println!("skipped: no group {OPERATORS}") };
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
    let operator = rig.operator_session();
    operator.wait_mode(Mode::Disengaged);
    for (presser, resetter) in [(SOMEBODY, SOMEBODY), (SOMEBODY, 0), (0, 0)] {
        let (stopped, printed) = teleopctl(presser, "estop");
        assert!(stopped, "{printed}");
        let (reset, printed) = teleopctl(ANOTHER, "reset");
        let sentence = match presser {
            0 => "reset refused: the emergency stop was pressed by user root (0); only root may reset it".to_owned(),
            uid => format!("reset refused: the emergency stop was pressed by user {uid}; only this user or root may"),
        };
        assert!(!reset && printed.contains(&sentence), "{printed}");
        assert_eq!(operator.wait("told", |status| status.reset_first_by == presser + 1).mode, Mode::Faulted as u32);
        let (_, printed) = teleopctl(ANOTHER, "status");
        assert!(printed.contains(&format!("Only user {presser} or root may reset it.")), "{printed}");
        let (reset, printed) = teleopctl(resetter, "reset");
        assert!(reset && printed.contains("reset: Disengaged"), "{printed}");
        assert_eq!(operator.wait_mode(Mode::Disengaged).reset_first_by, 0);
    }
    let refused = format!("of user {ANOTHER}: pressed reset, refused");
    assert!(soon(|| rig.log("control").contains(&refused)), "{}", rig.log("control"));
    // A second user's press does not bypass the first one's.
    assert!(teleopctl(SOMEBODY, "estop").0 && teleopctl(ANOTHER, "estop").0);
    assert!(!teleopctl(ANOTHER, "reset").0);
    let (reset, printed) = teleopctl(SOMEBODY, "reset");
    assert!(reset, "{printed}");
    // The robot's own emergency stop belongs to no user.
    operator.wait_mode(Mode::Disengaged);
}
