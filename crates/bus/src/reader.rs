//! The reading end of a service.
#![allow(unsafe_code)]

use crate::carried::{ReadPort, Unconnected};
use crate::payload::Payload;
use crate::port::Latest;
use crate::presence::Presence;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{FileDescriptorBased, PayloadHeader, ipc};
use messages::Message;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fmt;
use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::time::Duration;

/// Largest number of descriptors that a reader can wait for besides its own.
pub const ALSO_MAX: usize = 15;

/// The writer of a message. It is unique per port, so a restarted writer has another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PublisherId(pub u128);

/// A message and its writer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<M> {
    /// The message.
    pub message: M,
    /// Its writer.
    pub publisher: PublisherId,
    /// The writer's process, as the writer reports it, or 0 if it reports none.
    pub process: u32,
}

/// A reader that is polled: no system call, no allocation, no lock. A poll took 0.1 us (2026-11, 480 bytes).
pub struct Reader<M: Message> {
    port: Box<dyn ReadPort<M>>,
    /// Messages that can wait at once: for every writer as many as the service keeps.
    waiting_max: usize,
    failures: u64,
}

impl<M: Message> fmt::Debug for Reader<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reader of {}", M::TYPE_NAME.as_str())
    }
}

impl<M: Message> Reader<M> {
    pub(crate) fn new(port: Box<dyn ReadPort<M>>, waiting_max: usize) -> Self {
        Self { port, waiting_max, failures: 0 }
    }

    /// Returns the newest message that has not been read yet.
    pub fn latest(&mut self) -> Option<M> {
        self.latest_sample().map(|sample| sample.message)
    }

    /// Does the same as `latest`, and also returns the writer. With several writers use `drain`.
    pub fn latest_sample(&mut self) -> Option<Sample<M>> {
        let mut newest = None;
        // A writer that has left is read before its successor, so the last message is the newest.
        self.receive_up_to(self.waiting_max + 1, |sample| newest = Some(sample));
        newest
    }

    /// Hands the unread messages of each writer to `use_sample`, the oldest first. It takes at most as many of
    /// each writer as the service keeps (one in most cases) and returns their number. A writer that publishes
    /// during the call may be seen twice. The rest waits for the next call.
    pub fn drain(&mut self, use_sample: impl FnMut(Sample<M>)) -> usize {
        self.receive_up_to(self.waiting_max, use_sample)
    }

    /// Returns the number of polls that failed because a writer could not be connected. This reader gets none of
    /// its messages.
    pub fn failures(&self) -> u64 {
        self.failures
    }

    fn receive_up_to(&mut self, most: usize, mut use_sample: impl FnMut(Sample<M>)) -> usize {
        for taken in 0..most {
            match self.port.receive() {
                Ok(Some(sample)) => use_sample(sample),
                Ok(None) => return taken,
                Err(Unconnected) => {
                    self.failures += 1;
                    return taken;
                }
            }
        }
        most
    }
}

/// A reader over iceoryx2.
pub(crate) struct IpcReader<M: Message> {
    pub(crate) subscriber: Subscriber<ipc::Service, Payload<M>, ()>,
    // Declared last, so that the port is dropped before it.
    pub(crate) _presence: Arc<Presence>,
}

impl<M: Message> ReadPort<M> for IpcReader<M> {
    fn receive(&mut self) -> Result<Option<Sample<M>>, Unconnected> {
        let Some(sample) = self.subscriber.receive().map_err(|_| Unconnected)? else { return Ok(None) };
        let publisher = PublisherId(sample.origin().value());
        let pid = sample.header().node_id().pid::<ipc::Service>();
        let process = pid.map_or(0, |pid| u32::try_from(pid.value()).unwrap_or(0));
        Ok(Some(Sample { message: copied_once(sample.payload()), publisher, process }))
    }
}

/// Copies the message and reads every word exactly once. A writer that breaks the rules can change the message
/// while it is read. So all later code uses the copy.
fn copied_once<M: Message>(payload: &Payload<M>) -> M {
    let words = size_of::<M>() / size_of::<u64>();
    let from = std::ptr::from_ref(payload).cast::<u64>();
    let mut copy = M::ZERO;
    let into = std::ptr::from_mut(&mut copy).cast::<u64>();
    const { assert!(size_of::<M>().is_multiple_of(size_of::<u64>()) && align_of::<M>() == align_of::<u64>()) };
    for i in 0..words {
        // SAFETY: `Payload<M>` is transparent over `M`, which has no padding and whole words of the alignment of u64
        // (asserted above). Both pointers stay inside it, and every bit pattern is a valid value.
        unsafe { into.add(i).write(from.add(i).read_volatile()) };
    }
    copy
}

impl<M: Message> Latest<M> for Reader<M> {
    fn latest(&mut self) -> Option<M> {
        Reader::latest(self)
    }
}

/// The reason why a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wake {
    /// A writer called `notify`. Its message may have been read already: `latest` decides.
    Event,
    /// The time is up.
    Timeout,
    /// A signal arrived: look at the shutdown flag.
    Interrupted,
}

/// A listener for `Writer::notify`.
pub(crate) trait WakeListener {
    /// Takes the wake-ups that have been sent and returns their number.
    fn drain(&mut self) -> Result<u64, Unconnected>;
    /// Returns a descriptor that is readable while there are any.
    fn descriptor(&self) -> BorrowedFd<'_>;
}

/// A listener over iceoryx2.
pub(crate) struct IpcWakeListener {
    pub(crate) listener: Listener<ipc::Service>,
    // Declared last, so that the port is dropped before it.
    pub(crate) _presence: Arc<Presence>,
}

impl WakeListener for IpcWakeListener {
    fn drain(&mut self) -> Result<u64, Unconnected> {
        self.listener.try_wait(|_| {}).map_err(|_| Unconnected)
    }

    fn descriptor(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor belongs to the listener, which outlives the borrow and never closes it before.
        unsafe { BorrowedFd::borrow_raw(self.listener.file_descriptor().native_handle()) }
    }
}

/// A reader that can also wait.
pub struct WakingReader<M: Message> {
    reader: Reader<M>,
    wake_listener: Box<dyn WakeListener>,
    failures: u64,
}

impl<M: Message> fmt::Debug for WakingReader<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.reader.fmt(f)
    }
}

impl<M: Message> WakingReader<M> {
    pub(crate) fn new(reader: Reader<M>, wake_listener: Box<dyn WakeListener>) -> Self {
        Self { reader, wake_listener, failures: 0 }
    }

    /// Waits until a writer calls `notify`, `timeout` is over, or a signal arrives. A wake-up sent since the last
    /// wait ends it at once.
    ///
    /// The transport's own timed wait is a socket timeout, which Linux counts in scheduler ticks. There 667 us
    /// took 8.0 ms at 250 Hz (iceoryx2 0.10.0, `findings/iceoryx2_timed_wait.sh`). This wait is a high-resolution
    /// timer (ppoll). Its precision is the thread's timer slack: 0.75 ms.
    pub fn wait(&mut self, timeout: Duration) -> Wake {
        self.wait_also(timeout, &[])
    }

    /// Does the same as `wait`, and also ends when one of at most `ALSO_MAX` other descriptors can be read. It
    /// ignores more.
    pub fn wait_also(&mut self, timeout: Duration, also: &[BorrowedFd<'_>]) -> Wake {
        // First without waiting: a wake-up may be in shared memory without a datagram in the socket.
        if self.collect() {
            return Wake::Event;
        }
        let descriptor = self.wake_listener.descriptor();
        let timeout = Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: i64::from(timeout.subsec_nanos()) };
        let also = &also[..also.len().min(ALSO_MAX)];
        let mut looked_at: [PollFd<'_>; 1 + ALSO_MAX] = std::array::from_fn(|i| {
            let other = i.checked_sub(1).and_then(|i| also.get(i));
            PollFd::new(other.unwrap_or(&descriptor), PollFlags::IN)
        });
        match poll(&mut looked_at[..=also.len()], Some(&timeout)) {
            Ok(0) => Wake::Timeout,
            Ok(_) => {
                self.collect();
                Wake::Event
            }
            Err(rustix::io::Errno::INTR) => Wake::Interrupted,
            Err(_) => {
                self.failures += 1;
                Wake::Interrupted
            }
        }
    }

    /// Returns the newest message that has not been read yet.
    pub fn latest(&mut self) -> Option<M> {
        self.reader.latest()
    }

    /// Does the same as `Reader::latest_sample`.
    pub fn latest_sample(&mut self) -> Option<Sample<M>> {
        self.reader.latest_sample()
    }

    /// Does the same as `Reader::drain`.
    pub fn drain(&mut self, use_sample: impl FnMut(Sample<M>)) -> usize {
        self.reader.drain(use_sample)
    }

    /// Returns the number of polls and waits that failed.
    pub fn failures(&self) -> u64 {
        self.reader.failures() + self.failures
    }

    /// Takes all wake-ups that have been sent. Returns true if there was one.
    fn collect(&mut self) -> bool {
        match self.wake_listener.drain() {
            Ok(count) => count > 0,
            Err(Unconnected) => {
                self.failures += 1;
                false
            }
        }
    }
}

impl<M: Message> Latest<M> for WakingReader<M> {
    fn latest(&mut self) -> Option<M> {
        WakingReader::latest(self)
    }
}

#[cfg(test)]
mod tests {
    use crate::{Domain, DomainConfig};
    use messages::{JointTarget, Layout, Service};

    #[test]
    fn f090_sample_held_by_one_reader_blocks_no_writer_or_reader() {
        let folder = tempfile::tempdir().expect("a folder");
        let prefix = format!("t{}_held_", std::process::id());
        let config = DomainConfig { root: folder.path().join("root"), prefix: prefix.clone() };
        let domain = Domain::open(config, "test").expect("a domain");
        let mut writer = domain.writer::<JointTarget>(Service::JointTarget).expect("a writer");
        let greedy = domain.data_service::<JointTarget>(Service::JointTarget).expect("the service");
        let greedy = greedy.subscriber_builder().create().expect("a reader");
        let mut other = domain.reader::<JointTarget>(Service::JointTarget).expect("a reader");
        writer.publish(&JointTarget::ZERO).expect("it goes out");
        let held = greedy.receive().expect("a sample").expect("the first");
        for k in 1..=10_000 {
            writer.publish(&JointTarget { k, ..JointTarget::ZERO }).expect("it goes out");
            assert_eq!(other.latest().map(|target| target.k), Some(k));
        }
        assert_eq!(held.payload().0.k, 0);
        assert!(greedy.receive().is_err(), "more than one it does not get");
        drop((held, greedy, other, writer, domain));
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}
