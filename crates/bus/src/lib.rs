//! Messages between processes: one writer and any number of readers per service over iceoryx2, and slots with the same
//! traits inside one process, faulty on request.
//!
//! A reader sees the newest message, and a queue only where the table of services says so; silence is the only sign of a dead writer. Ports are `!Send`: a
//! port is created on the thread that uses it. Never fork after opening a domain: death is seen by a file lock, which
//! a forked child would keep alive.

mod carried;
mod domain;
mod error;
mod faulty;
mod local;
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
pub use local::Channel;
pub use port::{Latest, Publish};
pub use reader::{ALSO_MAX, PublisherId, Reader, Sample, Wake, WakingReader};
pub use shared_memory::{
    Mapped, SHARED_MEMORY_NEEDED_BYTES, Segment, is_inhabited, prefix_of, segments, segments_beginning,
};
pub use writer::Writer;
