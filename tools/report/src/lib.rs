//! Options, progress, tables and JSON files that the tools share.
//!
//! - [`parse`], [`check_bounds`], [`interrupted`]: the command line and its failures.
//! - [`Machine`], [`cores`]: the machine that measured.
//! - [`Progress`], [`in_parallel`]: a long run on several threads.
//! - [`table`]: numbers as text.
//! - [`JsonOutput`]: the figures as text and as JSON.

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
