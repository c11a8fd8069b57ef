//! Real processes that are stopped and killed. The test program starts itself again.

use crate::support;
use bus::{BusError, Domain, DomainConfig, Reader, WakingReader};
use messages::{JointTarget, Service};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use support::{Place, eventually, message, reader, writer};

const ROOT: &str = "BUS_TEST_ROOT";
const PREFIX: &str = "BUS_TEST_PREFIX";
const ROLE: &str = "BUS_TEST_ROLE";

/// A child that dies with its test.
struct Process(Child);

impl Process {
    fn start(place: &Place, role: &str) -> Self {
        let config = place.config();
        let mut command = Command::new(std::env::current_exe().expect("our own path"));
        command.args(["--exact", "processes::child", "--ignored", "--nocapture"]);
        command.env(ROOT, config.root).env(PREFIX, config.prefix).env(ROLE, role);
        Self(command.stdout(Stdio::null()).spawn().expect("the child starts"))
    }

    fn signal(&self, signal: &str) {
        let status = Command::new("kill").args([signal, &self.0.id().to_string()]).status();
        assert!(status.expect("kill runs").success());
    }

    fn kill(&mut self) {
        self.0.kill().expect("SIGKILL");
        self.0.wait().expect("it ends");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "the child process of the tests below"]
fn child() {
    let variable = |name| std::env::var(name).expect("set by the parent");
    let config = DomainConfig { root: variable(ROOT).into(), prefix: variable(PREFIX) };
    let domain = Domain::open(config, "child").expect("the domain opens");
    let ticks = 0..120_000;
    match variable(ROLE).as_str() {
        "writer" => {
            let mut writer = domain.writer::<JointTarget>(Service::JointTarget).expect("a writer's place");
            let incarnation = rt::incarnation();
            for k in ticks {
                writer.publish(&message(incarnation, k)).expect("it goes out");
                writer.notify().expect("it wakes");
                // The rate is the test's input. A late message is not made up for.
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        "reader" => {
            let mut reader = domain.waking_reader::<JointTarget>(Service::JointTarget).expect("a reader's place");
            for _ in ticks {
                reader.wait(Duration::from_millis(1));
                reader.latest();
            }
        }
        "rival" => {
            let error = domain.writer::<JointTarget>(Service::JointTarget).expect_err("the place is taken");
            assert!(matches!(error, BusError::WriterExists { .. }), "{error:?}");
        }
        role => panic!("no such role: {role}"),
    }
}

fn incarnation_heard(reader: &mut Reader<JointTarget>) -> u32 {
    eventually("a message", || reader.latest()).header.incarnation
}

#[test]
fn f086_killed_writer_is_silent_and_successor_is_a_new_writer() {
    let place = Place::new("kill");
    let (domain, successor) = (place.open(), place.open());
    let mut reader = reader(&domain);
    let mut known = Vec::new();
    for _ in 0..3 {
        let mut process = Process::start(&place, "writer");
        known.push(incarnation_heard(&mut reader));
        process.kill();
        reader.latest();
        assert!(wait::holds_for(Duration::from_millis(20), || reader.latest().is_none()), "the dead are silent");
    }
    // This domain was open all the time. Taking the place cleans up first.
    let mut next = writer(&successor);
    next.publish(&message(7, 1)).expect("it goes out");
    known.push(incarnation_heard(&mut reader));
    assert_eq!(known[3], 7);
    known.sort_unstable();
    known.dedup();
    assert_eq!(known.len(), 4, "each writer has its own incarnation");
    assert_eq!(reader.failures(), 0);
}

#[test]
fn live_writer_keeps_its_slot_against_another_process() {
    let place = Place::new("living");
    let domain = place.open();
    let (mut writer, mut reader) = (writer(&domain), reader(&domain));
    // A file lock of the process shows its death. Opening the domain again must not release the lock.
    drop(place.open());
    let mut rival = Process::start(&place, "rival");
    assert!(rival.0.wait().expect("it ends").success(), "the rival was not refused");
    assert_eq!(writer.publish(&message(1, 2)), Ok(1));
    assert_eq!(reader.latest(), Some(message(1, 2)));
}

#[test]
fn stopped_writer_keeps_its_slot_and_continues() {
    let place = Place::new("stop");
    let domain = place.open();
    let mut reader = reader(&domain);
    let process = Process::start(&place, "writer");
    let incarnation = incarnation_heard(&mut reader);
    process.signal("-STOP");
    let error = domain.writer::<JointTarget>(Service::JointTarget).expect_err("it lives");
    assert!(matches!(error, BusError::WriterExists { .. }), "{error:?}");
    reader.latest();
    process.signal("-CONT");
    assert_eq!(incarnation_heard(&mut reader), incarnation, "the same writer goes on");
}

#[test]
fn stopped_or_killed_readers_never_block_writer() {
    let place = Place::new("readers");
    let domain = place.open();
    let mut writer = writer(&domain);
    let mut reader = reader(&domain);
    let stopped = Process::start(&place, "reader");
    let mut killed = Process::start(&place, "reader");
    eventually("all three readers", || (writer.publish(&message(1, 0)) == Ok(3)).then_some(()));
    stopped.signal("-STOP");
    killed.kill();
    for k in 1..=10_000 {
        writer.publish(&message(1, k)).expect("nobody holds it up");
        writer.notify().expect("nobody holds it up");
        assert_eq!(reader.latest().map(|message| message.k), Some(k));
    }
    let frees = || Some(place.open()).filter(|_| writer.publish(&message(1, 0)) == Ok(2));
    eventually("the dead reader is gone, the stopped one is not", frees);
}

#[test]
fn processes_started_at_once_all_connect() {
    let place = Place::new("crowd");
    let processes: Vec<Process> = (0..6).map(|_| Process::start(&place, "reader")).collect();
    let domain = place.open();
    let mut writer = writer(&domain);
    eventually("six readers", || (writer.publish(&message(1, 0)) == Ok(6)).then_some(()));
    drop(processes);
    // A killed process may itself have been cleaning up after another one.
    eventually("no reader", || {
        drop(place.open());
        (writer.publish(&message(1, 0)) == Ok(0)).then_some(())
    });
    let mut own: WakingReader<JointTarget> = domain.waking_reader(Service::JointTarget).expect("a reader's place");
    writer.publish(&message(2, 3)).expect("it goes out");
    assert_eq!(own.latest(), Some(message(2, 3)));
}

#[test]
fn segments_of_killed_processes_are_removed_by_next_open() {
    for folder_is_gone in [false, true] {
        let place = Place::new("left");
        let mut processes = [Process::start(&place, "writer"), Process::start(&place, "reader")];
        let connected = || place.files().iter().any(|name| name.ends_with(".connection"));
        eventually("segments of both", || connected().then_some(()));
        processes.iter_mut().for_each(Process::kill);
        let left = place.files();
        if folder_is_gone {
            // A program that tidies /tmp does the same. Then the transport itself does not know the owner of the
            // segments.
            std::fs::remove_dir_all(place.root()).expect("it was there");
        }
        let domain = place.open();
        let now = place.files();
        let kept: Vec<_> = left.iter().filter(|name| now.contains(name) && !name.ends_with(".global_mgmt")).collect();
        assert!(kept.is_empty(), "{folder_is_gone}: {kept:?}");
        drop(domain);
        assert_eq!(place.files(), Vec::<String>::new(), "{folder_is_gone}");
        let nodes = std::fs::read_dir(place.root().join("nodes")).expect("the transport's folder").count();
        assert_eq!(nodes, 0, "{folder_is_gone}");
    }
}

#[test]
fn segments_of_live_process_are_never_removed() {
    let place = Place::new("alive");
    let process = Process::start(&place, "writer");
    eventually("its segments", || (place.files().len() > 3).then_some(()));
    let mut reader = reader(&place.open());
    let incarnation = incarnation_heard(&mut reader);
    drop(reader);
    process.signal("-STOP");
    let before = place.files();
    let kept = |what: &str| {
        let now = place.files();
        assert!(before.iter().all(|name| now.contains(name) || name.ends_with(".connection")), "{what}: {now:?}");
    };
    drop(place.open());
    kept("by another who comes and goes");
    // A client that uses the transport directly holds no lock of ours.
    std::fs::remove_file(place.root().join("presence.lock")).expect("it is there");
    drop(place.open());
    kept("without its lock");
    // Another folder with the same names, like a second mount of /tmp.
    let elsewhere = DomainConfig { root: place.root().with_file_name("elsewhere"), ..place.config() };
    drop(Domain::open(elsewhere, "test").expect("the domain opens"));
    kept("of another folder");
    process.signal("-CONT");
    let domain = place.open();
    assert_eq!(incarnation_heard(&mut support::reader(&domain)), incarnation, "the same writer goes on");
}

#[test]
fn port_that_outlives_its_domain_keeps_its_segments() {
    let place = Place::new("outlives");
    let (mut writer, mut reader) = (writer(&place.open()), reader(&place.open()));
    drop(place.open());
    assert_eq!(writer.publish(&message(1, 2)), Ok(1));
    assert_eq!(reader.latest(), Some(message(1, 2)));
    drop((writer, reader));
    assert_eq!(place.files(), Vec::<String>::new());
}
