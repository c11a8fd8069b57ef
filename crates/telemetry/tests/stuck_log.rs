//! The reader of the log may stop reading. The collector goes on, ends, and reports how many lines were lost.

use messages::Transition;
use std::io::Write;
use telemetry::{Event, channel};

/// A terminal that was stopped.
struct Stuck;

impl Write for Stuck {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        loop {
            std::thread::park();
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn blocked_log_blocks_no_collector() {
    tracing_subscriber::fmt().with_writer(|| Stuck).init();
    let (mut probe, mut collector) = channel("control");
    let transition = Transition { k: 1, from: 0, to: 1, why: Transition::ENABLED, about: 0 };
    // At ten lines a second the queue of 256 would take half a minute to fill. The thread's first line is enough
    // to block it.
    for _ in 0..20 {
        probe.event(Event::Transition(transition));
    }
    assert_eq!(collector.drain(), 20);
    let json = collector.into_json();
    assert_eq!(json["ring_dropped"], 0);
    assert!(json["log_lines_lost"].is_u64(), "{json}");
}
