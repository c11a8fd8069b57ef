//! Metrics and log events of a real-time loop. The loop has a `Probe`. It stores numbers in atomics and puts small
//! values into a wait-free ring, and does nothing else. A `Collector` on a thread of its own does the slow work:
//! histograms, text, logs and the network. A full ring loses samples, which are counted. It never delays the loop.

mod collector;
mod counter;
mod event;
mod exposition;
mod lines;
mod logging;
mod metric;
mod probe;
mod series;

use std::sync::atomic;

pub use collector::Collector;
pub use counter::{Counter, Counters};
pub use event::{Event, RateLimit};
pub use exposition::Exposition;
pub use logging::install as install_logging;
pub use metric::Metric;
pub use probe::{Probe, RING_CAPACITY, channel};
pub use series::Series;
pub use tracing::level_filters::LevelFilter;
