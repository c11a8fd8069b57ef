//! One writer, many readers, newest value: the behaviour of iceoryx2 with our settings.

use crate::support::{Place, message, reader, writer};
use bus::{BusError, Domain, Wake};
use messages::{Field, JointTarget, Layout, Message, RawSkeleton, Service};
use std::time::Duration;

fn raw(incarnation: u32, sequence: u64) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    raw.header.incarnation = incarnation;
    raw.header.sequence = sequence;
    raw
}

#[test]
fn reader_gets_newest_message_once() {
    let place = Place::new("newest");
    let (ours, theirs) = (place.open(), place.open());
    let (mut writer, mut first, mut second) = (writer(&ours), reader(&theirs), reader(&theirs));
    assert_eq!(first.latest(), None);
    for k in 1..=100 {
        assert_eq!(writer.publish(&message(0, k)), Ok(2));
    }
    assert_eq!(first.latest(), Some(message(0, 100)));
    assert_eq!(first.latest(), None, "it has been read");
    writer.publish(&message(0, 101)).expect("it goes out");
    assert_eq!((first.latest(), second.latest()), (Some(message(0, 101)), Some(message(0, 101))));
    assert_eq!((first.failures(), second.failures()), (0, 0));
}

#[test]
fn second_writer_is_refused_by_name_until_first_one_leaves() {
    let place = Place::new("second");
    let domain = place.open();
    let mut early = reader(&domain);
    let mut held = writer(&domain);
    let other = place.open();
    let error = other.writer::<JointTarget>(Service::JointTarget).expect_err("the place is taken");
    assert!(matches!(error, BusError::WriterExists { writers_max: 1, .. }), "{error:?}");
    let text = error.to_string();
    assert!(text.contains("teleop/joint_target/7") && text.contains("another retarget is already running"), "{text}");
    assert!(text.contains(place.root().to_str().expect("UTF-8")), "{text}");
    held.publish(&message(0, 5)).expect("the first writer goes on");
    assert_eq!(early.latest(), Some(message(0, 5)));
    drop(held);
    let mut next = writer(&other);
    next.publish(&message(0, 6)).expect("the place is free again");
    assert_eq!(early.latest(), Some(message(0, 6)));
}

#[test]
fn newest_message_comes_from_newest_writer_after_restart() {
    let place = Place::new("restart");
    let (domain, first, second) = (place.open(), place.open(), place.open());
    let (mut reader, mut stepping) = (reader(&domain), reader(&domain));
    let mut older = writer(&first);
    // Both connect. A reader never sees a writer that comes and goes between two polls.
    assert_eq!((reader.latest(), stepping.latest()), (None, None));
    older.publish(&message(0, 1)).expect("it goes out");
    drop(older);
    let mut newer = writer(&second);
    newer.publish(&message(0, 2)).expect("it goes out");
    let mut seen = Vec::new();
    while stepping.drain(|sample| seen.push((sample.message.k, sample.publisher))) > 0 {}
    let both: Vec<u64> = seen.iter().map(|(k, _)| *k).collect();
    assert_eq!(both, [1, 2], "both messages waited, the dead writer's first");
    let sample = reader.latest_sample().expect("two messages wait");
    assert_eq!((sample.message, sample.publisher), (message(0, 2), seen[1].1));
    assert_ne!(seen[0].1, seen[1].1, "another writer, another number");
    assert_eq!(reader.latest(), None);
}

#[test]
fn drain_gives_newest_message_of_each_of_eight_clients() {
    let place = Place::new("clients");
    let domain = place.open();
    let mut reader = domain.reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader");
    let others: Vec<Domain> = (0..8).map(|_| place.open()).collect();
    let open = |domain: &Domain| domain.writer::<RawSkeleton>(Service::RawSkeleton);
    let mut writers: Vec<_> = others.iter().map(|domain| open(domain).expect("eight may write")).collect();
    let error = open(&domain).expect_err("nine may not");
    assert!(error.to_string().contains("another client is already running (8 writer(s)"), "{error}");
    let mut places = std::collections::BTreeMap::new();
    for round in 1..=3u64 {
        for (index, writer) in writers.iter_mut().enumerate() {
            for sequence in [10 * round, 10 * round + 1] {
                writer.publish(&raw(index as u32, sequence)).expect("it goes out");
            }
        }
        let mut seen = Vec::new();
        let count = reader.drain(|sample| {
            assert_eq!(sample.message.header.sequence, 10 * round + 1, "the newest of each");
            let client = sample.message.header.incarnation;
            assert_eq!(*places.entry(sample.publisher).or_insert(client), client);
            seen.push(client);
        });
        seen.sort_unstable();
        assert_eq!((count, seen), (8, (0..8).collect()));
        assert_eq!(reader.drain(|_| {}), 0);
    }
    assert_eq!(places.len(), 8);
    // One client floods. A poll stays bounded.
    for sequence in 0..1_000 {
        writers[0].publish(&raw(0, sequence)).expect("it goes out");
    }
    assert!(reader.drain(|_| {}) <= 8);
}

#[test]
fn domains_with_different_prefixes_do_not_see_each_other() {
    let (here, there) = (Place::new("here"), Place::new("there"));
    let mut same_root = here.config();
    same_root.prefix = there.config().prefix;
    let other = Domain::open(same_root, "other").expect("the domain opens");
    let domain = here.open();
    let (mut ours, mut theirs) = (writer(&domain), writer(&other));
    let (mut reads_ours, mut reads_theirs) = (reader(&domain), reader(&other));
    assert_eq!((ours.publish(&message(0, 1)), theirs.publish(&message(0, 2))), (Ok(1), Ok(1)));
    assert_eq!((reads_ours.latest(), reads_theirs.latest()), (Some(message(0, 1)), Some(message(0, 2))));
}

/// A message with the size, name and version of a `JointTarget`, but with two fields exchanged.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Exchanged([u64; 399]);

impl Layout for Exchanged {
    const HASH: u64 = JointTarget::HASH ^ 1;
    const ZERO: Self = Self([0; 399]);
    fn write_to(&self, out: &mut [u8]) {
        self.0.write_to(out);
    }
    fn get(bytes: &[u8]) -> Self {
        Self(Layout::get(bytes))
    }
}

bus::carried!(Exchanged);

impl Message for Exchanged {
    const NAME: &'static str = JointTarget::NAME;
    const VERSION: u32 = JointTarget::VERSION;
    const FIELDS: &'static [Field] = &[];
}

#[test]
fn reader_with_other_layout_of_same_size_is_refused() {
    assert_eq!(std::mem::size_of::<Exchanged>(), std::mem::size_of::<JointTarget>());
    let place = Place::new("layout");
    let domain = place.open();
    let _writer = writer(&domain);
    let error = place.open().reader::<Exchanged>(Service::JointTarget).expect_err("another layout");
    assert!(matches!(error, BusError::IncompatibleTypes { .. }), "{error:?}");
    assert!(error.to_string().contains(Exchanged::TYPE_NAME.as_str()), "{error}");
}

#[test]
fn wait_ends_on_wake_up_or_at_its_timeout() {
    let place = Place::new("wake");
    let domain = place.open();
    let mut writer = writer(&domain);
    let mut waiting = domain.waking_reader::<JointTarget>(Service::JointTarget).expect("a reader");
    assert_eq!(waiting.wait(Duration::ZERO), Wake::Timeout);
    let before = rt::now();
    assert_eq!(waiting.wait(Duration::from_micros(700)), Wake::Timeout);
    assert!(rt::now().since(before) >= 700_000, "a timeout never ends early");
    for k in 1..=50 {
        writer.publish(&message(0, k)).expect("it goes out");
        writer.notify().expect("it wakes");
        writer.notify().expect("a second wake-up before the wait counts with the first");
        assert_eq!(waiting.wait(Duration::from_secs(60)), Wake::Event);
        assert_eq!(waiting.latest(), Some(message(0, k)));
        assert_eq!(waiting.wait(Duration::ZERO), Wake::Timeout, "both wake-ups are taken");
    }
    assert_eq!(waiting.failures(), 0);
}

#[test]
fn wake_up_is_never_lost_while_two_threads_race() {
    const LAST: u64 = 200_000;
    let place = Place::new("race");
    let domain = place.open();
    let mut waiting = domain.waking_reader::<JointTarget>(Service::JointTarget).expect("a reader");
    let publishing = place.open();
    let thread = std::thread::spawn(move || {
        let mut writer = writer(&publishing);
        for k in 1..=LAST {
            writer.publish(&message(0, k)).expect("it goes out");
            writer.notify().expect("it wakes");
            if k % 64 == 0 {
                std::thread::yield_now();
            }
        }
    });
    let mut newest = 0;
    while newest < LAST {
        // A lost wake-up of the last message would leave this wait hanging until its end.
        assert_eq!(waiting.wait(Duration::from_secs(30)), Wake::Event, "after message {newest}");
        if let Some(message) = waiting.latest() {
            assert!(message.k > newest, "{} after {newest}", message.k);
            newest = message.k;
        }
    }
    thread.join().expect("the writer does not panic");
}

#[test]
fn shared_memory_of_all_ports_stays_below_16_mib() {
    let place = Place::new("room");
    let domain = place.open();
    let _raw: Vec<_> = (0..8).map(|_| domain.writer::<RawSkeleton>(Service::RawSkeleton).expect("a writer")).collect();
    let _target = writer(&domain);
    let _readers: Vec<_> = (0..16).map(|_| reader(&domain)).collect();
    let _raw_readers: Vec<_> =
        (0..4).map(|_| domain.waking_reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader")).collect();
    let bytes = place.bytes();
    println!("{bytes} bytes of shared memory");
    assert!((1..16 << 20).contains(&bytes), "{bytes}");
}

#[test]
fn damaged_domain_gives_error_that_names_it_and_never_hangs() {
    let place = Place::new("damaged");
    let healthy = place.open();
    // Any local user can do this to the file that counts nodes: it is 0666.
    let prefix = place.config().prefix;
    let files = place.files();
    let counter = files.iter().find(|path| path.ends_with(".global_mgmt")).expect("a counter of nodes");
    std::fs::File::create(counter).expect("it can be truncated");
    let error = Domain::open(place.config(), "late").expect_err("it cannot be opened");
    let text = error.to_string();
    assert!(text.contains(&prefix) && text.contains(place.root().to_str().expect("UTF-8")), "{text}");
    println!("{text}");
    let (mut writer, mut reader) = (writer(&healthy), reader(&healthy));
    writer.publish(&message(0, 1)).expect("who was there before goes on");
    assert_eq!(reader.latest(), Some(message(0, 1)));
}
