//! Tests access to the sockets and shared memory, and the lease, with real processes and other users of the machine.

use client::{PlayOptions, Player, Publisher, Transport};
use doors::{Client, DoorError, Hello, Reply};
use harness::user::{User, can_be_another};
use harness::{Killed, Pace, Rig, in_real_time, signal, soon, wait_until, within};
use messages::{Fault, Mode, RawSkeleton};
use motion::CalibrationMode;
use rustix::net::{RecvFlags, SendFlags};
use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Groups that every Linux has, for skeletons and for operators.
const GROUPS: [&str; 2] = ["daemon", "sys"];
/// A user that no machine has.
const SOMEBODY: u32 = 42_424;
/// Variable that names the socket to the client in a separate process.
const CLIENT_OF: &str = "TELEOP_TEST_CLIENT_OF";

/// Starts all four processes, with a group for each socket, in a folder that other users can pass through.
/// Returns the groups' numbers too.
fn open_house() -> Option<(Rig, u32, u32)> {
    let [Some(skeletons), Some(operators)] = GROUPS.map(doors::group_id) else {
        println!("skipped: this machine has not the groups {GROUPS:?}");
        return None;
    };
    let [skeleton, operator] = GROUPS;
    let groups = format!("doors.skeleton_group = {skeleton:?}\ndoors.operator_group = {operator:?}");
    let mut rig = Rig::with_settings(&groups);
    rig.open_to_others();
    rig.start_all();
    Some((rig, skeletons, operators))
}

/// Returns true if `path` can be opened for reading or for writing.
fn opens(path: &Path) -> bool {
    let refused = |error: std::io::Error| {
        assert_eq!(error.kind(), ErrorKind::PermissionDenied, "{}: {error}", path.display());
    };
    let read = std::fs::File::open(path).map_err(refused).is_ok();
    read | std::fs::OpenOptions::new().write(true).open(path).map_err(refused).is_ok()
}

/// Waits for a line in the log of `control`. Another thread than its loop writes it.
fn wait_for_log(rig: &Rig, is_it: &dyn Fn(&str) -> bool) {
    assert!(soon(|| rig.log("control").lines().any(is_it)), "{}", rig.log("control"));
}

fn is_forbidden<T>(outcome: Result<T, DoorError>) -> bool {
    matches!(outcome, Err(DoorError::PermissionDenied { .. }))
}

#[test]
fn f106_f107_f111_other_user_opens_no_file_and_gets_no_session() {
    if !can_be_another() {
        return;
    }
    let Some((mut rig, skeletons, _)) = open_house() else { return };
    let _client = rig.client(&motion::builtin(), 31);
    rig.operator_session().wait_mode(Mode::Disengaged);
    let (skeleton, operator) = (rig.instance.skeleton_socket(), rig.instance.operator_socket());
    let segments: Vec<PathBuf> = rig.instance.shared_memory().collect();
    assert!(segments.len() > 10, "{segments:?}");
    let places = ["core", "input"].map(|name| rig.folder().join(name));
    let files = ["names.json", "operator.sock.lock", "skeleton.sock.lock"].map(|name| rig.folder().join(name));
    let ids = teleopd::PROCESSES.map(|name| rig.id(name));
    for uid in SOMEBODY..SOMEBODY + 20 {
        User::stranger(uid).does(|| {
            assert!(segments.iter().all(|path| !opens(path)), "shared memory");
            assert!(files.iter().all(|path| !opens(path)), "files");
            assert!(places.iter().all(|path| std::fs::read_dir(path).is_err()));
            assert!(std::fs::read_dir(rig.folder()).is_err() && std::fs::write(rig.folder().join("x"), "").is_err());
            assert!(is_forbidden(Client::attach(&skeleton)));
            assert!(operator::Client::connect(&operator).is_err());
            // f112: access of another user to the processes themselves.
            assert!(ids.iter().all(|id| std::fs::File::open(format!("/proc/{id}/mem")).is_err()));
        });
    }
    // Socket files that someone opened to all users. The daemon gets the peer's user from the kernel.
    for path in [&skeleton, &operator] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o666)).unwrap();
    }
    User::stranger(SOMEBODY).does(|| {
        let refused = Client::attach(&skeleton).expect_err("a stranger");
        assert!(matches!(refused, DoorError::Refused { word: Reply::Forbidden, .. }), "{refused}");
        let mut client = operator::Client::connect(&operator).expect("the file lets everybody connect");
        assert!(client.estop().heartbeat().is_err(), "and control puts him out");
    });
    let member = User { uid: SOMEBODY, gid: SOMEBODY, groups: &[skeletons] };
    member.does(|| assert!(operator::Client::connect(&operator).unwrap().enable().heartbeat().is_err()));
    let status = rig.operator_session().wait_mode(Mode::Disengaged);
    assert_eq!(status.fault_counts[Fault::EmergencyStop.index()], 0);
    rig.end("ingest");
    let report = rig.instance.report("ingest");
    assert!(std::fs::read_to_string(&report).unwrap().contains("\"forbidden\":1"));
    User::stranger(SOMEBODY).does(|| assert!(!opens(&report)));
}

#[test]
fn f106_f111_group_members_connect_only_to_their_own_socket() {
    if !can_be_another() {
        return;
    }
    let Some((mut rig, skeletons, operators)) = open_house() else { return };
    let (skeleton, operator) = (rig.instance.skeleton_socket(), rig.instance.operator_socket());
    for path in [&skeleton, &operator] {
        let found = std::fs::metadata(path).unwrap();
        assert!(found.file_type().is_socket() && found.permissions().mode() & 0o777 == 0o660);
    }
    let by_group = |group| [User { uid: SOMEBODY, gid: group, groups: &[] }, User::stranger(SOMEBODY)];
    for member in
        by_group(skeletons).into_iter().take(1).chain([User { groups: &[skeletons], ..User::stranger(SOMEBODY) }])
    {
        member.does(|| {
            assert_eq!(Client::attach(&skeleton).expect("a member").last_reply(), Reply::Granted);
            assert!(operator::Client::connect(&operator).is_err(), "no operator");
        });
    }
    for member in [by_group(operators)[0], User { groups: &[operators], ..User::stranger(SOMEBODY) }] {
        member.does(|| {
            operator::Client::connect(&operator).expect("a member").heartbeat().expect("a status");
            assert!(is_forbidden(Client::attach(&skeleton)), "no tracker");
        });
    }
    let printed = format!("of user {SOMEBODY}: connected");
    wait_for_log(&rig, &|line| line.contains(&printed));
    let ingest = rig.end("ingest");
    assert_eq!(ingest["connections"]["granted"], 2, "{ingest:#}");
}

/// Checks what the processes map and open, while a client publishes. And no one dumps its memory.
fn assert_only_ingest_maps_input(rig: &Rig) {
    let client = rig.client(&motion::builtin(), 51);
    rig.operator_session().wait_free();
    let input = rig.instance.input_domain().prefix;
    for name in teleopd::PROCESSES {
        let id = rig.id(name);
        let limits = std::fs::read_to_string(format!("/proc/{id}/limits")).unwrap();
        let core = limits.lines().find(|line| line.starts_with("Max core file size")).expect("a limit");
        assert_eq!(core.split_whitespace().filter(|word| *word == "0").count(), 2, "{name}: {core}");
        let maps = std::fs::read_to_string(format!("/proc/{id}/maps")).unwrap();
        let open = std::fs::read_dir(format!("/proc/{id}/fd")).unwrap().flatten();
        let open: String =
            open.filter_map(|fd| std::fs::read_link(fd.path()).ok()).map(|p| p.display().to_string()).collect();
        assert_eq!(maps.contains(&input) || open.contains(&input), name == "ingest", "{name}");
    }
    drop(client);
}

#[test]
fn f111_f112_clients_reach_nothing_but_ingest_and_stop_log_has_user() {
    let mut rig = Rig::whole();
    assert_only_ingest_maps_input(&rig);
    let operator = rig.operator_session();
    let order = messages::OperatorRequest {
        version: messages::OPERATOR_VERSION,
        enable_level: 1,
        enable_count: 1,
        release_count: 0,
        reset_count: 1,
        estop_count: 1,
        sequence: 1,
        ..messages::Layout::ZERO
    };
    // Sent instead of the hello, and after it.
    for greets in [false, true] {
        let socket = doors::connect(&rig.instance.skeleton_socket(), "ingest", 1000).unwrap();
        let mut answer = [0; 64];
        if greets {
            rustix::net::send(&socket, &Hello::OURS.encode(), SendFlags::empty()).unwrap();
            rustix::net::recv(&socket, &mut answer[..], RecvFlags::empty()).unwrap();
        }
        rustix::net::send(&socket, &operator::encode_request(&order), SendFlags::empty()).unwrap();
        let (length, _) = rustix::net::recv(&socket, &mut answer[..], RecvFlags::empty()).unwrap();
        let word = doors::ReplyPacket::decode(&answer[..length]).map(|answer| answer.word);
        assert_eq!(word, Some(if greets { Reply::WrongSize } else { Reply::NoHello }));
    }
    let status = operator.wait("ticking", |status| status.ticks > 100);
    assert_eq!((status.mode, status.transition_count), (Mode::Disengaged as u32, 0));
    operator.estop();
    operator.wait_mode(Mode::Faulted);
    let printed = format!("process {} of user", std::process::id());
    wait_for_log(&rig, &|line| line.contains(&printed) && line.contains("pressed the emergency stop"));
    rig.end("ingest");
}

/// Another writer is another client, even with the same session number.
#[test]
fn f068_f108_second_client_on_socket_or_bus_does_not_get_the_lease() {
    in_real_time(|| {
        let (mut rig, operator, _, first) = Rig::moving(Rig::shared_memory_client);
        let (by_socket, twin) = (rig.socket_client(), rig.shared_memory_client());
        by_socket.set_engaged(true);
        twin.set_engaged(true);
        operator.wait_control(Duration::from_secs(1));
        // No other client interferes. Otherwise the robot would disengage, and not engage again.
        operator.wait_mode(Mode::Engaged);
        assert_eq!(by_socket.last_reply().as_deref(), Some(Reply::NotHolder.meaning()));
        assert_eq!(first.failures(), 0);
        let ingest = rig.end("ingest");
        assert_eq!(ingest["leases"], 1, "{ingest:#}");
        assert_eq!(ingest["holder"]["door"], "shared memory", "{ingest:#}");
        assert!(ingest["without_authority"].as_u64().unwrap() > 60, "{ingest:#}");
        assert_eq!(ingest["telemetry"]["allocations"]["loop"], 0, "{ingest:#}");
        rig.end_without_violations();
    });
}

/// Not a test by itself. It is the client of the next test, in a process that can be killed and suspended.
#[test]
fn client_process_publishes_until_killed() {
    let Some(socket) = std::env::var_os(CLIENT_OF) else { return };
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let player = Player::new(&motion::builtin(), play, 0, rt::incarnation());
    let client = Publisher::start_on(Transport::Socket(socket.into()), player, rt::now).expect("the door is open");
    client.set_engaged(true);
    loop {
        std::thread::park();
    }
}

fn client_process(rig: &Rig) -> Killed {
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--exact", "doors::client_process_publishes_until_killed", "--test-threads=1"]);
    command.env(CLIENT_OF, rig.instance.skeleton_socket()).stdout(Stdio::null()).stderr(Stdio::null());
    Killed(command.spawn().expect("the client starts"))
}

/// Attaches until the new client has the lease. Returns the time that this took.
fn wait_for_lease(rig: &Rig) -> (Publisher, Duration) {
    let (since, mut newcomer) = (Instant::now(), None);
    wait_until("the end of the lease", || {
        let client = newcomer.insert(rig.socket_client());
        client.set_engaged(true);
        within(Duration::from_millis(60), || client.last_reply().as_deref() == Some(Reply::Holder.meaning()))
    });
    (newcomer.expect("the holder"), since.elapsed())
}

#[test]
fn f069_f070_next_client_waits_for_lease_and_needs_new_enable() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let (operator, mut observer) = (rig.operator_session(), rig.state_observer());
        let holder = client_process(&rig);
        operator.engage_until(Mode::Engaged);
        observer.wait_moving();
        signal(holder.id(), "STOP");
        let (_newcomer, after) = wait_for_lease(&rig);
        assert!(after > Duration::from_millis(900), "the lease passed on after {after:?}");
        // The robot came to rest before another client could get the lease. The enable is held all the time.
        let rest = observer.wait_at_rest();
        operator.wait_mode(Mode::Disengaged);
        operator.assert_stays(Mode::Disengaged, Duration::from_secs(1));
        assert_eq!(observer.wait_at_rest().q, rest.q);
        signal(holder.id(), "CONT");
        operator.assert_stays(Mode::Disengaged, Duration::from_millis(500));
        operator.release();
        operator.wait_control(Duration::from_millis(300));
        operator.engage_until(Mode::Engaging);
        let ingest = rig.end("ingest");
        assert_eq!(ingest["leases"], 2, "{ingest:#}");
        assert_eq!(ingest["holder"]["pid"], std::process::id(), "{ingest:#}");
        rig.end_without_violations();
    });
}

/// Publishes as fast as `period` and the socket allow, until `end`. Returns the number of offered and accepted frames.
fn flood(socket: &Path, period: Duration, end: &AtomicBool) -> (u64, u64) {
    let mut client = Client::attach(socket).expect("the door is open");
    let (mut offered, mut taken, mut pace) = (0_u64, 0, Pace::new(period));
    let mut frame = motion::raw_frame(&motion::builtin(), 0, &<messages::HingeCalibration as messages::Layout>::ZERO);
    while !end.load(Ordering::Relaxed) {
        offered += 1;
        frame.header.sequence = offered;
        (frame.header.stamp, frame.header.origin) = (rt::now(), rt::now());
        taken += u64::from(client.publish(&RawSkeleton { ..frame }).is_ok());
        pace.wait();
    }
    (offered, taken)
}

fn resident_kb(id: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{id}/status")).expect("its status");
    let line = text.lines().find(|line| line.starts_with("VmRSS:")).expect("a size");
    line.split_whitespace().nth(1).and_then(|number| number.parse().ok()).expect("a number")
}

#[test]
fn f023_flood_by_another_client_costs_the_holder_no_frame() {
    in_real_time(|| {
        let (mut rig, operator, _, holder) = Rig::moving(Rig::socket_client);
        let (socket, end, id) = (rig.instance.skeleton_socket(), AtomicBool::new(false), rig.id("ingest"));
        let (before_kb, stale) = (resident_kb(id), operator.raised(Fault::InputStale));
        let (offered, taken) = std::thread::scope(|scope| {
            let flooding = scope.spawn(|| flood(&socket, Duration::from_micros(100), &end));
            operator.wait_control(Duration::from_secs(2));
            operator.wait_mode(Mode::Engaged);
            end.store(true, Ordering::Relaxed);
            flooding.join().expect("no panic")
        });
        let after_kb = resident_kb(id);
        assert_eq!(operator.raised(Fault::InputStale), stale, "no frame of the holder came late");
        assert_eq!((holder.failures(), holder.last_reply().as_deref()), (0, Some(Reply::Holder.meaning())));
        drop(holder);
        let ingest = rig.end("ingest");
        let over = ingest["over_quota"]["socket"].as_u64().unwrap();
        println!("offered {offered}, taken {taken}, over quota {over}, {before_kb} -> {after_kb} kB, {ingest:#}");
        assert!(offered > 1000 && over > 500, "offered {offered}, passed over {over}");
        let looked_at = ingest["without_authority"].as_u64().unwrap();
        assert!(looked_at <= 16 + 250 * 3, "{looked_at} frames of the flood were looked at");
        assert!(after_kb <= before_kb + 256, "{before_kb} -> {after_kb} kB");
        rig.end_without_violations();
    });
}
