//! What `ingest` says of its clients, ten times a second.

use crate::layout::message;
use crate::skeleton::HingeCalibration;
use crate::time::{Header, Stamp};

/// Room for reasons to drop a frame.
pub const DROPS_MAX: usize = 32;

/// What the person's limbs rest on: where the elbows' hinges come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum CalibrationSource {
    /// Nothing: the elbow's plane of the moment.
    #[default]
    None = 0,
    /// The client sends them.
    Client = 1,
    /// The operator's file.
    Stored = 2,
    /// Estimated from this session's movements.
    Online = 3,
}

impl CalibrationSource {
    /// The source of this number.
    pub const fn from_u32(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::None),
            1 => Some(Self::Client),
            2 => Some(Self::Stored),
            3 => Some(Self::Online),
            _ => None,
        }
    }

    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none (the elbow's plane of the moment)",
            Self::Client => "the client's",
            Self::Stored => "stored",
            Self::Online => "estimated online",
        }
    }
}

message! {
    /// Who is heard, and what became of the frames.
    pub struct InputStatus v 1 size 392 {
        /// Writer is `ingest`.
        pub header: Header,
        /// Frames accepted since start.
        pub accepted: u64,
        /// Frames dropped since start, by `skeleton`'s reasons; the rest is zero.
        pub dropped: [u64; DROPS_MAX],
        /// When a frame was dropped last; zero for never.
        pub dropped_at: Stamp,
        /// Why: one more than the reason, zero for never.
        pub dropped_why: u32,
        /// A `CalibrationSource`: what the newest accepted frame's limbs rest on.
        pub calibration: u32,
        /// Layout of the newest frame, as the client sent it.
        pub layout: u32,
        /// Which person, as the client counts them.
        pub operator_id: u32,
        /// Its `raw_flag` bits.
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
        /// Estimate from this session's movements so far, in the frames of SMPL-22.
        pub online: HingeCalibration,
    }
}
