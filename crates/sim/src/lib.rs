//! A simulated robot behind the driver's port. Never does IO, never reads a clock, never allocates in a tick; the same
//! seed and the same inputs give the same run.
//!
//! Parts that know nothing of each other's arithmetic: the driver's follower executes commands, the [`interface`] hands
//! them to the joints, the [`Plant`] moves after what is executed, and the checker holds every executed step against the limits of the URDF and of the robot file
//! and against the clearance of every checked pair. The checker shares no formula with `wbc`, `safety` or `driver`, so it
//! can contradict them; it only counts, it never corrects.
//!
//! Time is the index of the setpoints: a driver that oversleeps moves a simulated robot no differently.

mod checker;
mod clearance;
mod config;
mod cubic;
mod injection;
pub mod interface;
mod plant;
mod report;
mod robot;

pub use checker::{Checker, TOLERANCE_A, TOLERANCE_CLEARANCE_M, TOLERANCE_J, TOLERANCE_Q, TOLERANCE_V};
pub use config::{Config, DELAY_MAX_TICKS, Options, SimError};
pub use injection::Injection;
pub use interface::Interface;
pub use plant::{Plant, Port};
pub use report::{Report, Violation, ViolationKind};
pub use robot::{Input, Output, State, tick};
