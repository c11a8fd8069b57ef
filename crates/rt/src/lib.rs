//! The operating system under the real-time path: clock, tick grid, thread attributes, histograms, shutdown,
//! service manager, allocation and page-fault counters. This crate has no fallbacks. It reports every refusal of
//! the system in words, and the caller decides.

mod allocation;
mod background;
mod children;
mod clock;
mod denormals;
mod error;
mod exit;
mod file_error;
mod grid;
mod histogram;
mod incarnation;
mod limits;
mod notify;
mod output;
mod page_faults;
mod panic;
mod peer;
mod placement;
mod processor;
mod realtime;
mod shutdown;
mod switch;

pub use allocation::{
    Allocations, CountingAllocator, allocating_aside, allocating_ourselves, allocations, count_allocations,
    watch_allocations,
};
pub use background::Background;
pub use children::{die_with_parent, is_orphaned, resume, suspend, terminate};
pub use clock::{SleepWatch, cpu_time_ns, now, sleep_until};
pub use denormals::flush_denormals;
pub use error::RtError;
pub use exit::{Exit, Failure, finish};
pub use file_error::{port_refused, unreadable, unwritable};
pub use grid::{PeriodicLoop, Tick, TickGrid};
pub use histogram::Histogram;
pub use incarnation::incarnation;
pub use limits::Limits;
pub use notify::ServiceManager;
pub use output::{number, wants_colour};
pub use page_faults::PageFaults;
pub use panic::abort_on_panic;
pub use peer::Peer;
pub use placement::{CoreMap, Placement, core_list};
pub use processor::cpu_features;
pub use realtime::{Outcome, Policy, Realtime, RealtimeConfig, RealtimeReport, is_preempt_rt};
pub use shutdown::Shutdown;
pub use switch::Switch;
