//! The port to the robot and the command dead-man. Never does IO, never reads a clock, never allocates, and knows
//! no robot. A driver process gives it the time and the commands, and hands the executed setpoints to a
//! [`Driver`].
//!
//! # Words
//!
//! - **Index**: a tick of the grid that all processes share (`messages::deadline`). The executed state always
//!   belongs to one index, and that index only grows.
//! - **Identity**: the index `c` of the last accepted command and the number `n` of ticks of its stop plan played
//!   since. The executed state is that of index `c + n`. An identity names a state: no two states of one driver
//!   share it.
//! - **Command chain**: a run of commands in which every command continues the one before by one tick. Its name is its
//!   writer's incarnation and its seed. The seed is the identity (`seed_k`, `seed_played`) whose state its first
//!   command continues. That command has index `seed_k + seed_played + 1`.
//!
//! # Rules
//!
//! A command is executed when it arrives, if it continues from the executed state:
//!
//! (a) it belongs to the chain of the last accepted command, whose plan has not been played yet, and lies ahead;
//!     or
//! (b) it belongs to a new chain whose seed is the executed identity or lies ahead on the plan being played. Then
//!     the driver plays the plan up to the seed, and takes the command.
//!
//! A command that is [`GAP_MAX_TICKS`] ahead at most is taken under both rules. The driver was late, and `(k - k') T`
//! defines the time between. It must continue the executed state within the limits of position, velocity, acceleration
//! and jerk. When an index is due and no command for it is there, one tick of the plan is played instead. So the
//! executed motion is continuous whatever the two processes' timing, as `tests/model.rs` shows.
//!
//! A driver that was suspended for longer while the robot moved does not take a command of its old chain. If the
//! robot is measured where the plan has come to meanwhile, it goes on with the plan. If the robot is near another
//! point of the plan, it goes on from there as slowly as the robot moves. Otherwise it begins where the robot is
//! measured, and stops from there within the limits. It latches if the pause was as long as the silence that
//! latches. If the robot carried on, the next setpoint is no farther from the last one than the limits allow in
//! the time between the two writes (`tests/carried_on.rs`). If it did not, the next setpoint is near the robot.
//!
//! Silence latches a fault that only a reset edge at rest clears. Until then the driver executes only the plan.
//!
//! A robot whose drives do not follow (no power, its own emergency stop, setpoints refused) for
//! [`UNDRIVEN_TICKS`] moves under gravity. From then on the follower holds the measured posture, tick by tick,
//! under a new identity each time and still latched. So the returning power finds a setpoint where the robot
//! stands, and nothing moves. If power returns while joints still move, the setpoint follows them for as long as
//! they do ([`SETTLE_TICKS`] at most). The servos brake them, and nothing swings back. A measurement is ignored
//! if a joint cannot have come there since the last one at three times its speed limit.
#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]
#![no_std]

mod acceptance;
mod chain;
mod drive;
mod follower;
mod gripper;
mod interface;
mod limits;
mod plan;
mod port;
mod suspension;

pub use acceptance::{GAP_MAX_TICKS, PLAN_MAX_S, REST_TOLERANCE, Refusal};
pub use chain::{ChainView, CommandChain, Seed, on_chain, reseed};
pub use drive::{Drive, DriveInput, DriveOutput, Observer, drive};
pub use follower::{
    Accepted, Config, Input, MEASURED_AGE_MAX_NS, Output, SETTLE_TICKS, SILENCE_TICKS, STILL_TICKS, State, Step,
    StepKind, UNDRIVEN_TICKS, tick, tick_each,
};
pub use gripper::{Grippers, RAMP_S as GRIPPER_RAMP_S};
pub use interface::{Interface, POINT_S, POINT_TICKS};
pub use limits::JointLimits;
pub use plan::PlanPlayback;
pub use port::{Driver, Drives, Measured, Setpoint};
pub use suspension::{STANDS_WITHIN_TICKS, START_AFTER_TICKS, STOOD_FOR_NS, Standstill};
