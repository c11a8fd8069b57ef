//! Status of `ingest` and its clients, ten times a second.

use crate::layout::message;
use crate::skeleton::HingeCalibration;
use crate::time::{Header, Stamp};

/// Length of the table of drop reasons.
pub const DROPS_MAX: usize = 32;

crate::named! {
    /// Source of the elbow hinge axes on which the person's limb rotations rest.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[repr(u32)]
    pub enum CalibrationSource {
        /// No source: the elbow's momentary plane is used.
        #[default]
        None = 0 => "none (uses the elbow's current plane)",
        /// The client's frames.
        Client = 1 => "the client's",
        /// The operator's file.
        Stored = 2 => "stored",
        /// Estimated from this session's movements.
        Online = 3 => "estimated online",
    }
}

impl CalibrationSource {
    /// Returns the source with this number.
    pub fn from_u32(number: u32) -> Option<Self> {
        Self::ALL.get(number as usize).copied()
    }
}

message! {
    /// State of the client that holds the lease, and counts of accepted and dropped frames.
    pub struct InputStatus v 2 size 392 {
        /// Writer is `ingest`.
        pub header: Header,
        /// Frames accepted since start.
        pub accepted: u64,
        /// Frames dropped since start, indexed by `skeleton`'s reasons. Entries without a reason are zero.
        pub dropped: [u64; DROPS_MAX],
        /// Time at which the last frame was dropped. Zero for never.
        pub dropped_at: Stamp,
        /// Reason for that drop: its index plus one. Zero for never.
        pub dropped_why: u32,
        /// A `CalibrationSource`: the one of the newest accepted frame.
        pub calibration: u32,
        /// Layout of the newest frame, as the client sent it.
        pub layout: u32,
        /// Number of the person, as the client counts them.
        pub operator_id: u32,
        /// `raw_flag` bits of the newest frame.
        pub flags: u32,
        /// Share of the client's newest 128 frames that never came, by the gaps in `header.sequence`: 1/1000.
        pub lost_permille: u32,
        /// Estimate from this session's movements so far, in the joint frames of SMPL-22.
        pub online: HingeCalibration,
    }
}
