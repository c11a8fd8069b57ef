//! Lines on their way to the log. The reader of stderr or of the journal may be slow or stuck. Neither the
//! watchdog nor the end of the process may wait for it. So a thread of its own writes, and a line that finds its
//! queue full is lost and counted.

use crate::event::{Event, KIND_NAMES, Missed};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

/// Lines that can wait: some seconds of every kind at its limit.
const QUEUE: usize = 256;
/// Longest wait of an ending process for its last lines.
const PATIENCE: Duration = Duration::from_millis(200);

/// Content of a line.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Line {
    Event(Event),
    Missed(Missed, Instant),
    HeldBack { kind: usize, count: u64 },
}

/// The queue, and the thread behind it.
#[derive(Debug)]
pub(crate) struct Lines {
    sender: SyncSender<Line>,
    done: Receiver<()>,
    lost: u64,
}

impl Lines {
    /// Starts the thread, with the attributes of the calling one. Returns `None` if the system starts no thread.
    pub(crate) fn start(process: &'static str, relaxed: bool) -> Option<Self> {
        let (sender, lines) = sync_channel(QUEUE);
        let (finished, done) = sync_channel(1);
        let write = move || {
            while let Ok(line) = lines.recv() {
                write(process, relaxed, line);
            }
            let _ = finished.send(());
        };
        std::thread::Builder::new().name("log".into()).spawn(write).ok()?;
        Some(Self { sender, done, lost: 0 })
    }

    pub(crate) fn push(&mut self, line: Line) {
        if self.sender.try_send(line).is_err() {
            self.lost += 1;
        }
    }

    /// Waits a short time for the last lines. Returns how many were lost in all.
    pub(crate) fn finish(self) -> u64 {
        drop(self.sender);
        let _ = self.done.recv_timeout(PATIENCE);
        self.lost
    }
}

fn write(process: &str, relaxed: bool, line: Line) {
    match line {
        Line::Event(Event::Gap { k, ns }) if relaxed => {
            tracing::info!(k, "{process}: did not run for {:.1} ms in tick {k}, which was dropped", ns as f64 * 1e-6);
        }
        Line::Event(event) => event.log(process),
        Line::Missed(missed, until) if relaxed => tracing::info!("{process}: {}", missed.words(until)),
        Line::Missed(missed, until) => tracing::warn!("{process}: {}", missed.words(until)),
        Line::HeldBack { kind, count } => {
            let kind = KIND_NAMES[kind];
            tracing::warn!(count, "{process}: {count} more lines about {kind} suppressed in the last second");
        }
    }
}
