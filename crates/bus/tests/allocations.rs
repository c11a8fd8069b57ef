//! Allocations of the hot path: none when reading and waiting, one block per message when writing.

use crate::support::{Place, message, reader, writer};
use bus::Wake;
use messages::{JointTarget, Service};
use rt::{Allocations, count_allocations};
use std::time::Duration;

const MESSAGES: u64 = 1_000;

#[test]
fn read_wait_and_notify_allocate_nothing_and_publish_once() {
    let place = Place::new("alloc");
    let domain = place.open();
    let (mut writer, mut reader) = (writer(&domain), reader(&domain));
    let mut waiting = domain.waking_reader::<JointTarget>(Service::JointTarget).expect("a reader");
    // The first message connects the ports.
    writer.publish(&message(0, 0)).expect("it goes out");
    writer.notify().expect("it wakes");
    assert_eq!(waiting.wait(Duration::from_secs(10)), Wake::Event);
    assert!(reader.latest().is_some() && waiting.latest().is_some());
    let (mut writing, mut reading, mut notifying) = Default::default();
    for k in 1..=MESSAGES {
        let (sent, count) = count_allocations(|| writer.publish(&message(0, k)));
        assert_eq!(sent, Ok(2));
        add(&mut writing, count);
        let (sent, count) = count_allocations(|| writer.notify());
        assert_eq!(sent, Ok(()));
        add(&mut notifying, count);
        let (_, count) = count_allocations(|| {
            assert_eq!(waiting.wait(Duration::from_secs(10)), Wake::Event);
            assert_eq!(waiting.latest().map(|message| message.k), Some(k));
            assert_eq!(reader.latest().map(|message| message.k), Some(k));
            assert!(reader.latest().is_none() && waiting.drain(|_| {}) == 0);
            assert_eq!(waiting.wait(Duration::ZERO), Wake::Timeout);
        });
        add(&mut reading, count);
    }
    assert_eq!(reading, Allocations::default(), "reading and waiting");
    assert_eq!(notifying, Allocations::default(), "waking");
    // The known exception, see `Writer`.
    assert_eq!(writing, Allocations { allocated: MESSAGES, freed: MESSAGES, bytes: 48 * MESSAGES }, "writing");
}

fn add(sum: &mut Allocations, count: Allocations) {
    sum.allocated += count.allocated;
    sum.freed += count.freed;
    sum.bytes += count.bytes;
}
