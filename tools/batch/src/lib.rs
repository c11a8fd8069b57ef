//! Retargets a folder of motion files to joint trajectories, on all cores. It applies the retargeting's own
//! functions frame by frame. The results do not depend on the number of jobs. The outputs are targets, before
//! whole-body control and before the safety gate.
mod bench;
mod cli;
mod error;
mod manifest;
mod output;
mod postures;
mod run;
mod trajectory;

pub use bench::{BenchReport, bench, synthetic};
pub use cli::{Cli, Method, Rate};
pub use error::BatchError;
pub use output::Format;
pub use postures::Postures;
pub use run::{Outcome, Summary, run};
pub use trajectory::Trajectory;
