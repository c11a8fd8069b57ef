//! Sentences for people, which say what happened and why the robot does not move, and the status as JSON. Never does IO
//! and never reads a clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod cause;
mod following;
mod sentences;
mod status;

pub use cause::cause;
pub use following::BEHIND_DEG;
pub use sentences::{
    Sentence, Severity, calibration_name, dropped_now, fault_behind, meaning, mode_name, newest_transitions,
    not_at_rest, payload, payload_refused, sentences, why, why_stopped,
};
pub use status::{activity, input_age_ms, status_json};
