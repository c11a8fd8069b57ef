//! Faults of the robot that tests and simulations switch on.

use messages::JOINTS_MAX;

/// A fault, switched on from now on. [`crate::Plant::repair`] switches all of them off. Feedback faults distort
/// the measurement and do not change the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum Injection {
    /// The encoder of a joint reads more by this value, rad or m.
    EncoderJump { joint: usize, by: f64 },
    /// One sample of the encoder of a joint reads more by this value, rad or m.
    EncoderSpike { joint: usize, by: f64 },
    /// All measurements keep their present values.
    FrozenFeedback,
    /// The measurement of a joint keeps its present value.
    FrozenEncoder { joint: usize },
    /// The measurement of a joint is NaN.
    NanFeedback { joint: usize },
    /// The measurement of a joint is mirrored about the joint's present position.
    FeedbackInverted { joint: usize },
    /// The measurements of two joints are exchanged.
    FeedbackSwapped { joint: usize, with: usize },
    /// A joint brakes and ignores its setpoints. Its drive reports nothing.
    NotFollowed { joint: usize },
    /// The setpoints of a joint are mirrored about the joint's present position.
    SignSwapped { joint: usize },
    /// The robot refuses setpoints, so its watchdog fires.
    SetpointsRejected,
    /// The drive of a joint reports a fault. The joint brakes, the others follow setpoints.
    DriveFault { joint: usize },
    /// The robot's own emergency stop is pressed: every joint brakes, setpoints are refused.
    EmergencyStopPressed,
    /// The robot's own emergency stop is released.
    EmergencyStopReleased,
    /// The motors lose power: setpoints are refused, every joint brakes and then gives way at the speed `sag`.
    PowerLost {
        /// The speed, rad/s or m/s. Zero means brakes that hold.
        sag: f64,
    },
    /// The power returns.
    PowerReturned,
    /// The servo loop of a joint is unstable: the joint truly swings about its setpoint.
    Swing {
        joint: usize,
        /// Largest deviation from the setpoint, rad or m.
        amplitude: f64,
        /// Frequency, Hz.
        frequency: f64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Swing {
    pub(crate) amplitude: f64,
    /// Angular frequency, rad/s.
    pub(crate) omega: f64,
    /// Number of the step at which it began.
    pub(crate) since_step: u64,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Injected {
    offset: [f64; JOINTS_MAX],
    spike: Option<(usize, f64)>,
    frozen: [bool; JOINTS_MAX],
    nan: [bool; JOINTS_MAX],
    /// Position about which the measurement of a joint is mirrored.
    feedback_mirror: [Option<f64>; JOINTS_MAX],
    swapped: Option<(usize, usize)>,
    not_followed: [bool; JOINTS_MAX],
    drive_fault: [bool; JOINTS_MAX],
    /// Position about which the setpoints of a joint are mirrored.
    pub(crate) setpoint_mirror: [Option<f64>; JOINTS_MAX],
    pub(crate) swing: [Option<Swing>; JOINTS_MAX],
    pub(crate) rejecting: bool,
    pub(crate) emergency_stop: bool,
    /// Speed at which joints give way while the motors have no power.
    pub(crate) sag: Option<f64>,
}

impl Injected {
    /// Switches a fault on, with the joints at `q` after `step` steps. A joint index that is too large changes nothing.
    pub(crate) fn switch_on(&mut self, fault: Injection, q: &[f64; JOINTS_MAX], step: u64) {
        let known = |joint: usize| joint < JOINTS_MAX;
        match fault {
            Injection::EncoderJump { joint, by } if known(joint) => self.offset[joint] += by,
            Injection::EncoderSpike { joint, by } if known(joint) => self.spike = Some((joint, by)),
            Injection::FrozenFeedback => self.frozen = [true; JOINTS_MAX],
            Injection::FrozenEncoder { joint } if known(joint) => self.frozen[joint] = true,
            Injection::NanFeedback { joint } if known(joint) => self.nan[joint] = true,
            Injection::FeedbackInverted { joint } if known(joint) => self.feedback_mirror[joint] = Some(q[joint]),
            Injection::FeedbackSwapped { joint, with } if known(joint) && known(with) => {
                self.swapped = Some((joint, with));
            }
            Injection::NotFollowed { joint } if known(joint) => self.not_followed[joint] = true,
            Injection::SignSwapped { joint } if known(joint) => self.setpoint_mirror[joint] = Some(q[joint]),
            Injection::SetpointsRejected => self.rejecting = true,
            Injection::DriveFault { joint } if known(joint) => self.drive_fault[joint] = true,
            Injection::EmergencyStopPressed => self.emergency_stop = true,
            Injection::EmergencyStopReleased => self.emergency_stop = false,
            Injection::PowerLost { sag } => self.sag = Some(sag),
            Injection::PowerReturned => self.sag = None,
            Injection::Swing { joint, amplitude, frequency } if known(joint) => {
                let omega = std::f64::consts::TAU * frequency;
                self.swing[joint] = Some(Swing { amplitude, omega, since_step: step });
            }
            _ => {}
        }
    }

    pub(crate) fn refuses(&self) -> bool {
        self.rejecting || !self.all_driven()
    }

    /// Returns true if the motors have power and no emergency stop is pressed.
    pub(crate) fn all_driven(&self) -> bool {
        self.sag.is_none() && !self.emergency_stop
    }

    /// Returns the speed that the brake of a joint forces on it, or `None` if the motor drives it.
    pub(crate) fn braked_to(&self, joint: usize) -> Option<f64> {
        let braked = self.emergency_stop || self.not_followed[joint] || self.drive_fault[joint];
        self.sag.or(braked.then_some(0.0))
    }

    pub(crate) fn drive_fault(&self) -> bool {
        self.drive_fault.contains(&true)
    }

    pub(crate) fn is_frozen(&self, joint: usize) -> bool {
        self.frozen[joint]
    }

    /// Distorts a new sample. A frozen joint was distorted when its value was taken.
    pub(crate) fn distort(&mut self, q: &mut [f64; JOINTS_MAX], dq: &mut [f64; JOINTS_MAX]) {
        for j in (0..JOINTS_MAX).filter(|&j| !self.frozen[j]) {
            if let Some(about) = self.feedback_mirror[j] {
                (q[j], dq[j]) = (2.0 * about - q[j], -dq[j]);
            }
            q[j] += self.offset[j];
            if self.nan[j] {
                (q[j], dq[j]) = (f64::NAN, f64::NAN);
            }
        }
        if let Some((joint, by)) = self.spike.take() {
            q[joint] += by;
        }
        if let Some((joint, with)) = self.swapped {
            q.swap(joint, with);
            dq.swap(joint, with);
        }
    }
}
