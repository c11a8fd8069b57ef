//! Faults of the simulated robot, to be switched on by tests and simulations.

use driver::{Drives, Measured};
use messages::JOINTS;

/// A fault of the robot, switched on from now on; [`crate::State::repair`] switches all of them off. Those of feedback
/// distort what is measured and leave the motion alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Injection {
    /// The encoder of a joint reads so much more, rad or m.
    EncoderJump {
        /// The joint.
        joint: usize,
        /// By how much.
        by: f64,
    },
    /// One sample of the encoder of a joint reads so much more, rad or m.
    EncoderSpike {
        /// The joint.
        joint: usize,
        /// By how much.
        by: f64,
    },
    /// All measurements stay what they are.
    FrozenFeedback,
    /// The measurement of a joint stays what it is.
    FrozenEncoder {
        /// The joint.
        joint: usize,
    },
    /// The measurement of a joint is not a number.
    NanFeedback {
        /// The joint.
        joint: usize,
    },
    /// The measurement of a joint goes the other way from where the joint is now.
    FeedbackInverted {
        /// The joint.
        joint: usize,
    },
    /// The measurements of two joints have changed places.
    FeedbackSwapped {
        /// The one.
        joint: usize,
        /// The other.
        with: usize,
    },
    /// A joint brakes and does not follow its setpoints; its drive says nothing.
    NotFollowed {
        /// The joint.
        joint: usize,
    },
    /// A joint moves the other way from where it is now.
    SignSwapped {
        /// The joint.
        joint: usize,
    },
    /// The robot takes no setpoints, and holds the last one.
    SetpointsRejected,
    /// The drive of a joint reports a fault; the joint brakes, the others go on taking setpoints.
    DriveFault {
        /// The joint.
        joint: usize,
    },
    /// The robot's own emergency stop is pressed: every joint brakes, and no setpoints are taken.
    EmergencyStopPressed,
    /// It is released again.
    EmergencyStopReleased,
    /// The motors lose their power: no setpoints are taken, every joint brakes and then gives way at the speed `sag`, rad/s
    /// or m/s.
    PowerLost {
        /// The speed; zero for brakes that hold.
        sag: f64,
    },
    /// The power returns, and setpoints are taken at once.
    PowerReturned,
}

/// Which faults are on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Injected {
    encoder_offset: [f64; JOINTS],
    spike: Option<(usize, f64)>,
    frozen: [bool; JOINTS],
    not_a_number: [bool; JOINTS],
    /// The position about which the measurement of a joint is mirrored.
    inverted_about: [Option<f64>; JOINTS],
    swapped: Option<(usize, usize)>,
    not_followed: [bool; JOINTS],
    drive_fault: [bool; JOINTS],
    /// The position about which the setpoints of a joint are mirrored.
    pub(crate) mirrored_about: [Option<f64>; JOINTS],
    rejecting: bool,
    emergency_stop: bool,
    /// The speed at which joints give way, while there is no power.
    pub(crate) without_power: Option<f64>,
}

impl Injected {
    /// Switches a fault on, with the joints at `q`.
    pub(crate) fn inject(&mut self, fault: Injection, q: &[f64; JOINTS]) {
        match fault {
            Injection::EncoderJump { joint, by } => self.encoder_offset[joint] += by,
            Injection::EncoderSpike { joint, by } => self.spike = Some((joint, by)),
            Injection::FrozenFeedback => self.frozen = [true; JOINTS],
            Injection::FrozenEncoder { joint } => self.frozen[joint] = true,
            Injection::NanFeedback { joint } => self.not_a_number[joint] = true,
            Injection::FeedbackInverted { joint } => self.inverted_about[joint] = Some(q[joint]),
            Injection::FeedbackSwapped { joint, with } => self.swapped = Some((joint, with)),
            Injection::NotFollowed { joint } => self.not_followed[joint] = true,
            Injection::SignSwapped { joint } => self.mirrored_about[joint] = Some(q[joint]),
            Injection::SetpointsRejected => self.rejecting = true,
            Injection::DriveFault { joint } => self.drive_fault[joint] = true,
            Injection::EmergencyStopPressed => self.emergency_stop = true,
            Injection::EmergencyStopReleased => self.emergency_stop = false,
            Injection::PowerLost { sag } => self.without_power = Some(sag),
            Injection::PowerReturned => self.without_power = None,
        }
    }

    /// Whether a joint brakes, whatever its setpoints are.
    pub(crate) fn brakes(&self, joint: usize) -> bool {
        self.emergency_stop || self.not_followed[joint] || self.drive_fault[joint]
    }

    /// Whether the measurement of a joint stays what it is.
    pub(crate) fn is_frozen(&self, joint: usize) -> bool {
        self.frozen[joint]
    }

    /// Whether the robot takes setpoints.
    pub(crate) fn takes_setpoints(&self) -> bool {
        !self.rejecting && !self.emergency_stop && self.without_power.is_none()
    }

    /// What the drives say.
    pub(crate) fn drives(&self) -> Drives {
        Drives {
            emergency_stop: self.emergency_stop,
            fault: self.drive_fault.contains(&true),
            powered: self.without_power.is_none(),
        }
    }

    /// What becomes of a new sample; what is frozen was distorted when it was taken.
    pub(crate) fn distort(&mut self, measured: &mut Measured) {
        for j in (0..JOINTS).filter(|&j| !self.frozen[j]) {
            if let Some(about) = self.inverted_about[j] {
                (measured.q[j], measured.dq[j]) = (2.0 * about - measured.q[j], -measured.dq[j]);
            }
            measured.q[j] += self.encoder_offset[j];
            if self.not_a_number[j] {
                (measured.q[j], measured.dq[j]) = (f64::NAN, f64::NAN);
            }
        }
        if let Some((joint, by)) = self.spike.take() {
            measured.q[joint] += by;
        }
        if let Some((joint, with)) = self.swapped {
            measured.q.swap(joint, with);
            measured.dq.swap(joint, with);
        }
    }
}
