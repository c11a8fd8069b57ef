//! Damage that a process of the same user can do to a domain, and damage that it cannot do.

use crate::support::Place;
use bus::{BusError, Domain, Reader, Writer};
use messages::{Layout, RawSkeleton, Service, Skeleton};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileExt, PermissionsExt};

fn raw(sequence: u64) -> RawSkeleton {
    let mut raw = RawSkeleton::ZERO;
    raw.header.sequence = sequence;
    raw.positions[95] = [sequence as f32; 3];
    raw
}

fn client(domain: &Domain) -> Writer<RawSkeleton> {
    domain.writer(Service::RawSkeleton).expect("a place")
}

#[test]
fn f106_f107_domain_files_are_closed_to_other_users() {
    let place = Place::new("modes");
    let domain = place.open();
    let mut reader: Reader<RawSkeleton> = domain.reader(Service::RawSkeleton).expect("a reader");
    let mut writer = client(&domain);
    writer.publish(&raw(1)).expect("it goes out");
    assert!(reader.latest().is_some());
    let files = place.files();
    let mode = |path: &str| std::fs::metadata(path).expect("it is there").permissions().mode() & 0o777;
    assert!(files.len() >= 4, "{files:?}");
    assert!(files.iter().all(|path| mode(path) & 0o077 == 0), "{files:?}");
    assert_eq!(mode(place.root().to_str().expect("UTF-8")), 0o700);
    // A second process of the same user can still enter.
    drop(place.open());
}

#[test]
fn f019_drained_message_is_a_copy_writer_cannot_change() {
    let place = Place::new("copy");
    let domain = place.open();
    let mut reader: Reader<RawSkeleton> = domain.reader(Service::RawSkeleton).expect("a reader");
    let mut writer = client(&domain);
    for sequence in 1..=20 {
        writer.publish(&raw(sequence)).expect("it goes out");
        let taken = reader.drain(|sample| {
            // A writer that breaks the rules overwrites its sent messages: only the memory of the samples, so
            // that both live.
            for path in place.files().into_iter().filter(|path| path.ends_with(".data")) {
                let file = OpenOptions::new().read(true).write(true).open(path).expect("the same user");
                let mut bytes = vec![0; file.metadata().expect("a size").len() as usize];
                file.read_at(&mut bytes, 0).expect("it reads");
                let value = (sequence as f32).to_le_bytes();
                let places: Vec<_> = (0..bytes.len() - 4).step_by(4).filter(|&i| bytes[i..i + 4] == value).collect();
                assert!(places.len() >= 3, "the frame lies there");
                places.iter().for_each(|&i| _ = file.write_at(&[0xff; 4], i as u64).expect("it writes"));
            }
            assert_eq!(sample.message, raw(sequence));
        });
        assert_eq!(taken, 1);
    }
}

#[test]
fn f088_first_client_keeps_its_slot_when_another_takes_the_rest() {
    let place = Place::new("places");
    let (ours, theirs) = (place.open(), place.open());
    let mut reader: Reader<RawSkeleton> = ours.reader(Service::RawSkeleton).expect("a reader");
    let mut holder = client(&theirs);
    let rogue = place.open();
    let mut taken = Vec::new();
    let error = loop {
        match rogue.writer::<RawSkeleton>(Service::RawSkeleton) {
            Ok(writer) => taken.push(writer),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, BusError::WriterExists { writers_max: 8, .. }), "{error:?}");
    assert_eq!(taken.len(), 7);
    for sequence in 1..=1000 {
        taken.iter_mut().for_each(|writer| _ = writer.publish(&raw(u64::MAX)));
        holder.publish(&raw(sequence)).expect("it goes out");
        let mut seen = false;
        for _ in 0..2 {
            reader.drain(|sample| seen |= sample.message.header.sequence == sequence);
        }
        assert!(seen, "frame {sequence} of the first client");
    }
}

#[test]
fn f090_idle_readers_use_constant_memory_while_writer_publishes() {
    let place = Place::new("unread");
    let domain = place.open();
    let mut writer = client(&domain);
    let idle: Vec<Reader<RawSkeleton>> = (0..8).map(|_| domain.reader(Service::RawSkeleton).expect("one")).collect();
    writer.publish(&raw(0)).expect("it goes out");
    let before = place.bytes();
    for sequence in 1..=100_000 {
        writer.publish(&raw(sequence)).expect("a full buffer gives way to the newest");
    }
    assert_eq!(place.bytes(), before);
    drop(idle);
}

#[test]
fn f018_writer_of_wrong_message_or_file_as_root_is_refused() {
    let place = Place::new("type");
    let domain = place.open();
    let error = domain.writer::<Skeleton>(Service::RawSkeleton).expect_err("another layout");
    assert_eq!(error.to_string(), "service teleop/raw_skeleton/1: the message is Skeleton, expected RawSkeleton");
    // The folder itself keeps other users out. A file in its place is a clear error.
    File::create(place.root().join("in the way")).expect("a file");
    let config = bus::DomainConfig { root: place.root().join("in the way"), prefix: place.config().prefix };
    assert!(matches!(Domain::open(config, "test"), Err(BusError::Root { .. })));
}
