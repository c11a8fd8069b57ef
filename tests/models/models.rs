//! Tests lock-free data shared by the product's own threads, in every interleaving and every order that the
//! memory model allows. The sources are the product's, and only their atomics are loom's. The rings between
//! threads are `rtrb`, which has its own models.
#![cfg(test)]

use loom::sync::{Arc, atomic};
use loom::thread;

#[path = "../../crates/telemetry/src/counter.rs"]
#[allow(dead_code)]
mod counter;
#[path = "../../crates/client/src/publisher/shared.rs"]
#[allow(dead_code)]
mod shared;

use counter::{Counter, Counters};
use shared::Shared;

#[test]
fn f080_counter_of_one_writer_loses_nothing_and_never_falls() {
    loom::model(|| {
        let counters = Arc::new(Counters::default());
        let writer = Arc::clone(&counters);
        let writing = thread::spawn(move || {
            writer.add(Counter::RingDropped, 1);
            writer.add(Counter::RingDropped, 2);
        });
        let first = counters.get(Counter::RingDropped);
        let second = counters.get(Counter::RingDropped);
        assert!(first <= second && [0, 1, 3].contains(&second), "{first} {second}");
        writing.join().expect("the writer ends");
        assert_eq!(counters.get(Counter::RingDropped), 3);
    });
}

#[test]
fn f080_reader_that_sees_the_last_frame_sees_all_counts() {
    loom::model(|| {
        let shared = Arc::new(Shared::default());
        let publisher = Arc::clone(&shared);
        let publishing = thread::spawn(move || {
            publisher.publish(1, true, false);
            publisher.publish(2, false, true);
        });
        if shared.finished() {
            assert_eq!((shared.published(), shared.failures()), (2, 1));
        }
        publishing.join().expect("the publisher ends");
        assert!(shared.finished());
    });
}

#[test]
fn f080_stop_of_a_publisher_keeps_its_published_count() {
    loom::model(|| {
        let shared = Arc::new(Shared::default());
        let publisher = Arc::clone(&shared);
        let publishing = thread::spawn(move || {
            let mut published = 0;
            // At most two frames, so that the search ends.
            while !publisher.stopped() && published < 2 {
                published += 1;
                publisher.publish(published, false, published == 2);
            }
            published
        });
        shared.stop();
        let published = publishing.join().expect("the publisher ends");
        assert_eq!(shared.published(), published);
        assert_eq!(shared.finished(), published == 2);
    });
}
