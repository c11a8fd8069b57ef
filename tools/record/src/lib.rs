//! Recordings of an instance as MCAP files. The library writes and reads them. The binary `record` attaches to
//! a running instance as a reader, in a process of its own. So neither its work nor a problem of its disk
//! affects the daemon.
//!
//! A recording holds our own messages bit for bit, under schemas whose names carry the layout's hash. It also holds
//! joint states, transforms, scenes and log sentences in the schemas of Foxglove, which several viewers read.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

mod about;
mod attach;
pub mod cli;
mod compare;
mod encoder;
mod error;
mod file;
mod inputs;
mod live_view;
mod offline;
mod pauses;
mod picture;
mod plot;
mod program;
mod queue;
mod read;
mod recording_view;
mod summary;
mod topic;
mod trace;

pub use about::{Files, Origin, about};
pub use attach::Attached;
pub use compare::{Compared, Counts, compare};
pub use encoder::{Rates, RecordingEncoder, Sample, bytes_of};
pub use error::RecordError;
pub use file::{Entry, Recording};
pub use inputs::Inputs;
pub use offline::OfflineRecording;
pub use plot::plot;
pub use program::main;
pub use queue::{Outcome, Queue, Sink};
pub use read::{Content, Recorded};
pub use recording_view::recording_view;
pub use summary::Summary;
pub use topic::{Described, Topic};
pub use trace::{Row, Trace};

/// Name of the metadata at the beginning of a recording.
pub const ABOUT: &str = "teleopd";
/// Name of the metadata at the end of a recording.
pub const OUTCOME: &str = "teleopd.outcome";
