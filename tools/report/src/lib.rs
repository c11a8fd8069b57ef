//! Options, progress, tables and JSON files that the tools share.

mod json_output;
mod machine;
mod options;
mod parallel;
mod progress;
pub mod table;

pub use json_output::{JsonOutput, open_before_run, print};
pub use machine::{Machine, cores, load_average, processor};
pub use options::{check_bounds, interrupted, out_of_bounds, parse};
pub use parallel::{derived_seed, in_parallel};
pub use progress::Progress;
