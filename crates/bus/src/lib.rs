//! Messages between processes: one writer and any number of readers per service over iceoryx2. Slots with the
//! same traits connect stages inside one process, with faults on request.
//!
//! A reader sees the newest message, and a queue only where the table of services says so. Silence is the only
//! sign of a dead writer. Ports are `!Send`: create a port on the thread that uses it. Never fork after opening a
//! domain. A file lock shows the death of a process, and a forked child would keep the lock.

mod carried;
mod domain;
mod error;
mod faulty;
mod payload;
mod port;
mod presence;
mod reader;
mod shared_memory;
mod writer;

pub use carried::{Carried, ReadPort, Unconnected, WritePort};
pub use domain::{Domain, DomainConfig};
pub use error::{BusError, PublishError};
pub use faulty::{FaultCounts, FaultPlan, Faulty};
pub use port::{Latest, Publish};
pub use reader::{ALSO_MAX, PublisherId, Reader, Sample, Wake, WakingReader};
pub use shared_memory::{
    Mapped, SHARED_MEMORY_NEEDED_BYTES, Segment, is_inhabited, prefix_of, segments, segments_beginning,
};
pub use writer::Writer;
