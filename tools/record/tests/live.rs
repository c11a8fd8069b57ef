//! Runs the program beside writers of the test: what it reads, how it ends, and what remains after a kill or on
//! a full disk.

use crate::support::{config, contents, loaded};
use bus::{Domain, Writer};
use instance::Instance;
use messages::{Header, JointCommand, JointTarget, Layout, RobotState, Service, Skeleton, Stamp, Status};
use motion::mcap::Ending;
use record::{Content, Entry, Queue, Recorded, Sink, Topic};
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, SeekFrom, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// Writers of every service of a core domain.
pub(crate) struct Writers {
    skeletons: Writer<Skeleton>,
    targets: Writer<JointTarget>,
    policies: Writer<JointTarget>,
    commands: Writer<JointCommand>,
    states: Writer<RobotState>,
    statuses: Writer<Status>,
    sequence: u64,
    pub(crate) sent: Vec<JointCommand>,
    _domain: Domain,
    robot: messages::RobotId,
}

impl Writers {
    pub(crate) fn new(instance: &Instance) -> Self {
        let robot = loaded().model.id();
        let domain = Domain::open(instance.core_domain(), "test").expect("a domain");
        Self {
            skeletons: domain.writer(Service::Skeleton).unwrap(),
            targets: domain.writer(Service::JointTarget).unwrap(),
            policies: domain.writer(Service::PolicyTarget).unwrap(),
            commands: domain.writer(Service::JointCommand).unwrap(),
            states: domain.writer(Service::RobotState).unwrap(),
            statuses: domain.writer(Service::Status).unwrap(),
            robot,
            sequence: 0,
            sent: Vec::new(),
            _domain: domain,
        }
    }

    /// Publishes one message of each, with all numbers different.
    fn publish(&mut self) {
        self.sequence += 1;
        let (robot, k, stamp) = (self.robot, self.sequence, rt::now());
        let header = Header { sequence: k, stamp, origin: Stamp::NONE, config_hash: 7, incarnation: 1, reserved: 0 };
        let q = std::array::from_fn(|j| (k as f64).sin() + j as f64 * 0.01);
        let command = JointCommand { header, robot, k, q, ..JointCommand::ZERO };
        self.skeletons.publish(&Skeleton { header, ..Skeleton::ZERO }).unwrap();
        self.targets.publish(&JointTarget { header, robot, k, q, ..JointTarget::ZERO }).unwrap();
        self.policies.publish(&JointTarget { header, robot, k, q: q.map(|q| -q), ..JointTarget::ZERO }).unwrap();
        self.commands.publish(&command).unwrap();
        self.states.publish(&RobotState { header, robot, q_measured: q, ..RobotState::ZERO }).unwrap();
        self.statuses.publish(&Status { header, k, ..Status::ZERO }).unwrap();
        self.sent.push(command);
    }

    /// Publishes for `duration`, slowly enough that a loaded machine reads nearly all.
    pub(crate) fn publish_for(&mut self, duration: Duration) {
        let end = Instant::now() + duration;
        while Instant::now() < end {
            self.publish();
            // The rate is the test's input. A late message is not made up for.
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

pub(crate) fn program(run_dir: &Path, out: &Path) -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_record"));
    program.arg(out).args(["--full", "--run-dir"]).arg(run_dir).arg("--config").arg(config());
    program
}

fn start(run_dir: &Path, out: &Path) -> Child {
    let child = program(run_dir, out).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let child = child.expect("the program starts");
    wait_begun(out);
    child
}

/// Waits for the beginning of the file. The file begins with the channels, and then the recorder reads.
fn wait_begun(out: &Path) {
    wait::wait_until("a beginning", || std::fs::metadata(out).map_or(0, |file| file.len()) >= 10_000);
}

/// Returns the commands of a recording. Checks that each one was sent, and that they are in order.
fn commands(path: &Path, sent: &[JointCommand]) -> (Vec<JointCommand>, Ending) {
    let (all, recorded) = contents(path);
    let read: Vec<JointCommand> = all
        .iter()
        .filter_map(|(_, content)| match content {
            Content::Command(command) => Some(**command),
            _ => None,
        })
        .collect();
    assert!(read.windows(2).all(|pair| pair[0].k < pair[1].k), "in order");
    for command in &read {
        assert_eq!(*command, sent[command.k as usize - 1], "bit for bit");
    }
    (read, recorded.ending().clone())
}

#[test]
fn recorder_records_published_data_and_sigterm_ends_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(&folder.path().join("run")).unwrap();
    let mut writers = Writers::new(&instance);
    let out = folder.path().join("out.mcap");
    let child = start(instance.run_dir(), &out);
    writers.publish_for(Duration::from_millis(800));
    // A pause of the writers. Its length is the test's input.
    std::thread::sleep(Duration::from_millis(120));
    writers.publish_for(Duration::from_millis(700));
    rt::terminate(child.id());
    let ended = child.wait_with_output().expect("it ends");
    let printed = String::from_utf8_lossy(&ended.stdout) + String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{printed}");
    assert!(
        printed.contains("0 lost") && printed.contains("missed: ") && printed.contains("runs with the settings"),
        "{printed}"
    );
    for option in ["--config", "--engage-without-realtime", "--interface"] {
        assert!(printed.contains(option), "{option}: {printed}");
    }

    let (read, ending) = commands(&out, &writers.sent);
    assert_eq!(ending, Ending::Complete);
    let (all, recorded) = contents(&out);
    // What a policy wished is beside what was commanded, in a topic of its own.
    let wished = all.iter().filter_map(|(_, content)| match content {
        Content::Policy(target) => Some(target),
        _ => None,
    });
    assert!(wished.clone().count() > read.len() / 2);
    assert!(wished.clone().all(|target| target.q == writers.sent[target.k as usize - 1].q.map(|q| -q)));
    let missed: usize = recorded.outcome()["missed /teleop/joint_command"].parse().unwrap();
    assert!(read.len() > writers.sent.len() / 2, "{} of {}", read.len(), writers.sent.len());
    // Every command between the first and the last that were read was either read or counted as missed.
    let span = (read[read.len() - 1].k - read[0].k + 1) as usize;
    assert_eq!(read.len() + missed, span);

    let program = || Command::new(env!("CARGO_BIN_EXE_record"));
    let again = program().arg(&out).arg("--run-dir").arg(instance.run_dir()).arg("--config").arg(config()).output();
    let again = again.unwrap();
    assert_eq!(again.status.code(), Some(73), "a recording is never written over");
    let summary = program().arg("--summary").arg(&out).arg("--config").arg(config()).output().unwrap();
    let text = String::from_utf8_lossy(&summary.stdout);
    assert!(text.contains("/teleop/joint_command") && text.contains("The robot is Disengaged."), "{text}");
    assert!(text.contains("the machine paused the driver for 1"), "the pause is marked: {text}");
    instance.retire();
}

#[test]
fn recorder_without_an_instance_fails_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, out) = (folder.path().join("run"), folder.path().join("out.mcap"));
    let refused = |what: &str| {
        let ended = program(&empty, &out).args(["--seconds", "20"]).output().expect("the program starts");
        let printed = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(69), "{what}: {printed}");
        assert!(printed.contains("no instance of teleopd runs in "), "{printed}");
        assert!(printed.contains("teleopd up --run-dir"), "{printed}");
        assert!(!out.exists(), "{what}: nothing was recorded");
    };
    refused("no folder");
    let instance = Instance::new(&empty).unwrap();
    drop(Writers::new(&instance));
    refused("an instance that has ended");
    let _writers = Writers::new(&instance);
    std::fs::write(&out, "of yesterday").unwrap();
    let ended = program(&empty, &out).output().expect("the program starts");
    let printed = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(73), "{printed}");
    assert!(printed.contains("exists already, and is not replaced. Remove it"), "{printed}");
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "of yesterday");
    instance.retire();
}

#[test]
fn killed_recorder_leaves_a_file_readable_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(&folder.path().join("run")).unwrap();
    let mut writers = Writers::new(&instance);
    let out = folder.path().join("out.mcap");
    let mut child = start(instance.run_dir(), &out);
    writers.publish_for(Duration::from_millis(2500));
    child.kill().unwrap();
    child.wait().unwrap();
    let (read, ending) = commands(&out, &writers.sent);
    assert!(matches!(ending, Ending::BrokenOff(_)), "{ending:?}");
    assert!(read.len() > writers.sent.len() / 4, "{} of {}", read.len(), writers.sent.len());
    instance.retire();
}

/// Starts the recorder as `up` does. The parent is killed with -9, so it can end nothing itself.
#[test]
fn recorder_ends_when_its_parent_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(&folder.path().join("run")).unwrap();
    let mut writers = Writers::new(&instance);
    let out = folder.path().join("out.mcap");
    let mut parent = Command::new("sh");
    parent.args(["-c", "\"$0\" \"$@\" --child-of $$ & wait"]).arg(env!("CARGO_BIN_EXE_record")).arg(&out);
    let mut parent = parent.arg("--run-dir").arg(instance.run_dir()).arg("--config").arg(config()).spawn().unwrap();
    wait_begun(&out);
    writers.publish_for(Duration::from_millis(500));
    assert!(matches!(commands(&out, &writers.sent).1, Ending::BrokenOff(_)), "it still writes");
    parent.kill().unwrap();
    parent.wait().unwrap();
    wait::wait_until("the end of the recording", || commands(&out, &writers.sent).1 == Ending::Complete);
    instance.retire();
}

/// A disk with limited room that, on request, hangs in a write until it is released.
#[derive(Clone)]
struct Disk {
    bytes: Arc<Mutex<Cursor<Vec<u8>>>>,
    room: usize,
    hangs: Arc<(Mutex<bool>, Condvar)>,
}

impl Disk {
    fn new(room: usize) -> Self {
        Self { bytes: Arc::default(), room, hangs: Arc::default() }
    }

    fn hang(&self, hangs: bool) {
        *self.hangs.0.lock().unwrap() = hangs;
        self.hangs.1.notify_all();
    }

    /// Returns what a recording on this disk holds.
    fn contents(&self) -> (Vec<(u64, Content)>, Recorded) {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), self.bytes.lock().unwrap().get_ref()).unwrap();
        contents(file.path())
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        drop(self.hangs.1.wait_while(self.hangs.0.lock().unwrap(), |hangs| *hangs));
        let mut disk = self.bytes.lock().unwrap();
        let room = self.room.saturating_sub(disk.get_ref().len());
        if room == 0 {
            return Err(std::io::Error::from(std::io::ErrorKind::StorageFull));
        }
        disk.write(&bytes[..bytes.len().min(room)])
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.bytes.lock().unwrap().seek(to)
    }
}

impl Sink for Disk {
    fn shorten(&mut self, bytes: u64) {
        self.bytes.lock().unwrap().get_mut().truncate(bytes as usize);
    }
}

#[test]
fn f102_full_disk_loses_counted_samples_and_keeps_the_file_good() {
    let disk = Disk::new(1_600_000);
    let mut queue = Queue::start(disk.clone(), &BTreeMap::new(), &[]).expect("room for the beginning");
    let mut sent = 0;
    let begun = Instant::now();
    while !queue.failed() && begun.elapsed() < Duration::from_secs(20) {
        // The data is not compressible, so that the room is soon used.
        let mut hash = sent ^ 0x9e37_79b9_7f4a_7c15;
        let data = std::iter::repeat_with(|| {
            hash = u64::wrapping_mul(hash ^ hash >> 29, 0xbf58_476d_1ce4_e5b9);
            (hash >> 32) as u8
        });
        let data = data.take(size_of::<JointCommand>()).collect();
        queue.add(Entry { topic: Topic::Command, sequence: sent as u32, log_time: sent, data });
        sent += 1;
        // The rate is the test's input.
        std::thread::sleep(Duration::from_millis(1));
    }
    queue.add(Entry { topic: Topic::Command, sequence: 0, log_time: sent, data: vec![0; 1312] });
    let outcome = queue.finish(BTreeMap::new());
    assert!(outcome.failure.is_some() && outcome.lost > 0 && outcome.written > 0, "{outcome:?}");
    assert_eq!(outcome.written + outcome.lost, sent + 1);
    let (all, recorded) = disk.contents();
    assert_eq!(all.len() as u64, outcome.written, "{:?}", recorded.ending());
}

#[test]
fn f103_hung_disk_blocks_no_sender_and_lost_samples_are_counted() {
    let disk = Disk::new(usize::MAX);
    let mut queue = Queue::start(disk.clone(), &BTreeMap::new(), &[]).expect("the beginning");
    disk.hang(true);
    // More entries than the queue and the thread hold. Each is taken or lost at once, while nothing is written.
    let sent = 40_000;
    for n in 0..sent {
        let data = vec![0; size_of::<JointCommand>()];
        queue.add(Entry { topic: Topic::Command, sequence: n as u32, log_time: n, data });
    }
    assert!(!queue.failed(), "it is late, not broken");
    disk.hang(false);
    let outcome = queue.finish(BTreeMap::new());
    assert_eq!((outcome.written + outcome.lost, &outcome.failure), (sent, &None));
    assert!(outcome.lost > sent / 2 && outcome.written >= 4096, "{outcome:?}");
    let (all, recorded) = disk.contents();
    assert_eq!((all.len() as u64, recorded.ending()), (outcome.written, &Ending::Complete));
    let reported: u64 = recorded.outcome()["samples_lost"].parse().unwrap();
    assert_eq!(reported, outcome.lost, "the file says what it lacks");
}

#[test]
fn f102_full_file_system_fails_the_recording_and_keeps_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let small = folder.path().join("small");
    std::fs::create_dir(&small).unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=8m", "none"]).arg(&small).output();
    if !mounted.is_ok_and(|mounted| mounted.status.success()) {
        return println!("skipped: no right to mount a small file system");
    }
    let instance = Instance::new(&folder.path().join("run")).unwrap();
    let mut writers = Writers::new(&instance);
    // Without any room it does not start, and leaves nothing.
    let _ = std::fs::write(small.join("other"), vec![0; 9 << 20]);
    let none = small.join("none.mcap");
    let refused = program(instance.run_dir(), &none).output().unwrap();
    assert_eq!(refused.status.code(), Some(73), "{refused:?}");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("none.mcap: the recording cannot be written"));
    assert!(!none.exists(), "the file that it made");
    std::fs::remove_file(small.join("other")).unwrap();
    let out = small.join("out.mcap");
    let child = start(instance.run_dir(), &out);
    writers.publish_for(Duration::from_millis(1500));
    // Another program takes all the remaining room.
    let _ = std::fs::write(small.join("other"), vec![0; 8 << 20]);
    writers.publish_for(Duration::from_millis(2500));
    rt::terminate(child.id());
    let ended = child.wait_with_output().expect("it ends");
    let printed = String::from_utf8_lossy(&ended.stdout) + String::from_utf8_lossy(&ended.stderr);
    let kept = folder.path().join("kept.mcap");
    std::fs::copy(&out, &kept).unwrap();
    let _ = Command::new("umount").arg(&small).output();
    assert_eq!(ended.status.code(), Some(1), "{printed}");
    assert!(printed.contains("nothing more can be written") && printed.contains("messages lost"), "{printed}");
    let (_, ending) = commands(&kept, &writers.sent);
    assert!(matches!(ending, Ending::BrokenOff(_)), "{ending:?}");
    instance.retire();
}
