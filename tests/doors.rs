//! Tests access to the sockets and shared memory, and the lease, with real processes and other users of the machine.

use doors::{Client, DoorError, Hello, Reply};
use harness::user::{User, can_be_another};
use harness::{Rig, in_real_time, soon};
use messages::{Fault, Mode};
use rustix::net::{RecvFlags, SendFlags};
use std::io::ErrorKind;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Groups that every Linux has, for skeletons and for operators.
const GROUPS: [&str; 2] = ["daemon", "sys"];
/// A user that no machine has.
const SOMEBODY: u32 = 42_424;

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
