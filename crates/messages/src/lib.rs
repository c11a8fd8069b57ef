//! The vocabulary of teleopd: every message, service, mode and fault. Never allocates, never does IO, never reads
//! a clock, and depends on nothing.
//!
//! All messages are `repr(C)` and `Copy`. Their fields have explicit widths: no `bool`, `Option`, `usize` or
//! implicit padding. Validity is a bit, never NaN. Units are SI (rad, m, s) unless the name says otherwise.
//! Quaternions are stored x, y, z, w. Frames are right-handed with x forward, y left, z up (ROS REP-103).
#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]
#![no_std]

mod bucket;
mod command;
mod fault;
mod feedback;
mod input;
mod joints;
mod layout;
mod motion;
mod named;
mod operator;
mod payload;
mod permit;
mod person_change;
mod policy;
mod port;
mod service;
mod skeleton;
mod status;
mod subject;
mod time;

pub use bucket::{BURST, Bucket, RATE_MAX_HZ};
pub use command::{
    GripperMotion, GripperState, HAND_NODES, JointCommand, JointTarget, RobotState, StopPlan, TRAJECTORY_NODE_TICKS,
    TRAJECTORY_NODES, command_flag, state_flag, target_flag,
};
pub use fault::{FAULTS, Fault, FaultRow, Faults, Mode, Response};
pub use feedback::{Feedback, SENTENCE_BYTES, feedback_flag};
pub use input::{CalibrationSource, DROPS_MAX, InputStatus};
pub use joints::{ALL_JOINTS, ARM_JOINTS, JOINTS_MAX, RobotId};
pub use layout::{FNV_BASIS, Field, Layout, Message, TypeName, fnv};
pub use motion::JointMotion;
pub use operator::{
    EDGES_MAX, HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, LEAVES_OUT, OPERATOR_VERSION, OperatorRequest, TAKES_OVER,
    payload_flag,
};
pub use payload::{PayloadOrder, PayloadRefusal};
pub use permit::Permit;
pub use person_change::PersonChange;
pub use policy::{CHUNK_ROWS_MAX, ChunkDrop, Joints, PolicyChunk, chunk_flag, joints_flag, source_flag};
pub use port::{RobotMeasured, RobotSetpoint, measured_flag};
pub use service::{Domain, SERVICES, Service, ServiceRow};
pub use skeleton::{
    CUSTOM_LAYOUTS, HingeCalibration, LIMBS, Limb, RAW_JOINTS_MAX, RawSkeleton, SMPL_JOINTS, SMPL_NAMES,
    SMPL_OTHER_SIDE, SMPL_PARENT, Skeleton, SkeletonLayout, Smpl, calibration_flag, closure_of, raw_flag,
    skeleton_flag, with_closure,
};
pub use status::{FollowingLimit, Status, TRANSITIONS_KEPT, Transition, reduced_flag};
pub use subject::Subject;
pub use time::{Header, Stamp, TICK_HZ, TICK_S, comes_after, deadline, tick_at};
