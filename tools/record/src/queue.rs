//! A bounded queue and the thread that writes. A slow or full disk loses samples, which are counted. It never
//! blocks the caller.

use crate::error::RecordError;
use crate::file::{Entry, Recording};
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Number of entries that may wait: two thirds of a second of every message, about 10 MB.
const WAITING_MAX: usize = 4096;
/// Largest age of a chunk when it is written. It is less than the second that a kill may cost.
const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// The caller's end of the queue. It never blocks.
pub struct Queue {
    sender: Option<SyncSender<Entry>>,
    writer: Option<JoinHandle<Box<dyn Written>>>,
    lost: u64,
    failed: Arc<AtomicBool>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub written: u64,
    /// Number of entries that were lost, because the queue or the disk was full.
    pub lost: u64,
    pub failure: Option<String>,
}

/// A file that can be truncated after an incomplete write.
pub trait Sink: Write + Seek + Send + 'static {
    fn shorten(&mut self, bytes: u64);
}

impl Sink for std::fs::File {
    fn shorten(&mut self, bytes: u64) {
        let _ = self.set_len(bytes);
    }
}

/// A sink that stores its length after the last flush.
struct Whole<S> {
    sink: S,
    length: u64,
    whole: u64,
}

impl<S: Sink> Write for Whole<S> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.sink.write(bytes)?;
        self.length += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.sink.flush()?;
        self.whole = self.length;
        Ok(())
    }
}

impl<S: Sink> Seek for Whole<S> {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.sink.seek(to)
    }
}

impl Queue {
    /// Begins the file and the thread. Writes the channels, `about` and `files` before it returns.
    pub fn start(
        sink: impl Sink,
        about: &BTreeMap<String, String>,
        files: &[(String, Vec<u8>)],
    ) -> Result<Self, RecordError> {
        let recording = Recording::begin(Whole { sink, length: 0, whole: 0 }, about, files)?;
        let (sender, receiver) = sync_channel(WAITING_MAX);
        let failed = Arc::new(AtomicBool::new(false));
        let theirs = Arc::clone(&failed);
        let thread = std::thread::Builder::new().name("record-write".to_owned());
        let writer = thread
            .spawn(move || write_all(recording, &receiver, &theirs))
            .map_err(|error| RecordError::Write { cause: error.to_string() })?;
        Ok(Self { sender: Some(sender), writer: Some(writer), lost: 0, failed })
    }

    /// Adds an entry, or counts it as lost. It never waits.
    pub fn add(&mut self, entry: Entry) {
        let taken = self.sender.as_ref().is_some_and(|sender| sender.try_send(entry).is_ok());
        self.lost += u64::from(!taken);
    }

    pub fn failed(&self) -> bool {
        self.failed.load(Ordering::Relaxed)
    }

    /// Writes the waiting entries, and closes the file with `last` and the number of lost entries. Returns the result.
    pub fn finish(mut self, mut last: BTreeMap<String, String>) -> Outcome {
        last.insert("samples_lost".to_owned(), self.lost.to_string());
        self.sender = None;
        let writer = self.writer.take().map(JoinHandle::join);
        let Some(Ok(written)) = writer else { return Outcome { lost: self.lost, ..Outcome::default() } };
        let outcome = written.close(&last);
        Outcome { lost: outcome.lost + self.lost, ..outcome }
    }
}

/// Result of the thread: the file, still open unless writing failed.
trait Written: Send {
    fn close(self: Box<Self>, last: &BTreeMap<String, String>) -> Outcome;
}

struct Open<S: Sink> {
    recording: Option<Recording<Whole<S>>>,
    outcome: Outcome,
    /// Number of entries since the last flush. They are lost if the flush fails.
    pending: u64,
}

impl<S: Sink> Open<S> {
    fn attempt(&mut self, work: impl FnOnce(&mut Recording<Whole<S>>) -> Result<(), RecordError>) -> bool {
        let Some(recording) = &mut self.recording else { return false };
        let Err(error) = work(recording) else { return true };
        self.outcome.failure = Some(error.to_string());
        self.outcome.lost += std::mem::take(&mut self.pending);
        if let Some(mut whole) = self.recording.take().map(Recording::into_sink) {
            whole.sink.shorten(whole.whole);
        }
        false
    }

    fn add(&mut self, entry: &Entry) {
        self.pending += 1;
        if self.recording.is_none() {
            self.outcome.lost += std::mem::take(&mut self.pending);
        } else {
            self.attempt(|recording| recording.add(entry));
        }
    }

    fn flush(&mut self) {
        if self.pending > 0 && self.attempt(Recording::flush) {
            self.outcome.written += std::mem::take(&mut self.pending);
        }
    }
}

impl<S: Sink> Written for Open<S> {
    fn close(mut self: Box<Self>, last: &BTreeMap<String, String>) -> Outcome {
        self.flush();
        self.attempt(|recording| recording.finish(last));
        self.outcome
    }
}

fn write_all<S: Sink>(
    recording: Recording<Whole<S>>,
    receiver: &Receiver<Entry>,
    failed: &AtomicBool,
) -> Box<dyn Written> {
    let mut open = Box::new(Open { recording: Some(recording), outcome: Outcome::default(), pending: 0 });
    let mut flushed = Instant::now();
    loop {
        match receiver.recv_timeout(FLUSH_EVERY.saturating_sub(flushed.elapsed())) {
            Ok(entry) => open.add(&entry),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return open,
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            open.flush();
            flushed = Instant::now();
        }
        failed.store(open.recording.is_none(), Ordering::Relaxed);
    }
}
