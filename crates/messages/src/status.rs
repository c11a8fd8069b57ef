//! Status of `control`, 50 times a second.

use crate::fault::{FAULT_COUNT, Fault};
use crate::layout::message;
use crate::subject::Subject;
use crate::time::{Header, Stamp};

/// Number of mode transitions that a `Status` carries: the newest ones.
pub const TRANSITIONS_KEPT: usize = 16;

/// Bits of `Status::reduced`: the reasons for a reduced speed.
pub mod reduced_flag {
    /// The newest skeleton is late.
    pub const INPUT_LATE: u32 = 1;
    /// The newest target is late.
    pub const TARGET_LATE: u32 = 2;
    /// The target has jumped, and the robot is far behind it.
    pub const TARGET_JUMPED: u32 = 4;
    /// Control missed several deadlines in a row.
    pub const DEADLINES_LATE: u32 = 8;
    /// Every reason with its name in reports.
    pub const NAMES: [(u32, &str); 4] = [
        (INPUT_LATE, "skeleton late"),
        (TARGET_LATE, "target late"),
        (TARGET_JUMPED, "target jumped"),
        (DEADLINES_LATE, "deadlines late"),
    ];
}

message! {
    /// One mode transition.
    pub struct Transition v 2 size 24 {
        /// Tick of the transition.
        pub k: u64,
        /// `Mode` before.
        pub from: u32,
        /// `Mode` after.
        pub to: u32,
        /// Cause of the transition: the index of a `Fault`, or one of `Transition::ENABLED`, `RELEASED`,
        /// `ALIGNED`, `AT_REST`, `RESET`, `CLEARED`, `SETTLED`, `RECOVERING`, `RECOVERED`, `BLOCKED`.
        pub why: u32,
        /// Joint or pair that the fault concerned when it caused the transition: the code of a `Subject`, zero for
        /// none.
        pub about: u32,
    }
}

#[allow(missing_docs)]
impl Transition {
    pub const ENABLED: u32 = 1000;
    pub const RELEASED: u32 = 1001;
    pub const ALIGNED: u32 = 1002;
    pub const AT_REST: u32 = 1003;
    pub const RESET: u32 = 1004;
    pub const CLEARED: u32 = 1005;
    pub const SETTLED: u32 = 1006;
    pub const RECOVERING: u32 = 1007;
    pub const RECOVERED: u32 = 1008;
    pub const BLOCKED: u32 = 1009;

    /// Name of the cause in reports.
    pub const fn why_name(&self) -> &'static str {
        match self.why {
            Self::ENABLED => "enabled",
            Self::RELEASED => "released",
            Self::ALIGNED => "aligned",
            Self::AT_REST => "at rest",
            Self::RESET => "reset",
            Self::CLEARED => "cleared",
            Self::SETTLED => "settled",
            Self::RECOVERING => "recovery held",
            Self::RECOVERED => "recovered",
            Self::BLOCKED => "recovery found no path",
            why => match crate::Fault::from_u32(why) {
                Some(fault) => fault.row().name,
                None => "unknown",
            },
        }
    }
}

message! {
    /// State of the control process.
    pub struct Status v 11 size 848 {
        /// Writer is `control`.
        pub header: Header,
        /// Tick of this status.
        pub k: u64,
        /// Control ticks since start.
        pub ticks: u64,
        /// Deadlines missed since start.
        pub missed_deadlines: u64,
        /// Active faults, as bits of `Faults`.
        pub faults: u64,
        /// Latched faults, as bits of `Faults`.
        pub latched: u64,
        /// Stamp of the last target.
        pub target_stamp: Stamp,
        /// Stamp of the last robot state.
        pub state_stamp: Stamp,
        /// Age of the person's frame at this tick, ns.
        pub input_age_ns: u64,
        /// Smallest clearance of the checked pairs at the commanded posture, m.
        pub clearance_command_m: f64,
        /// Smallest clearance of the checked pairs at the measured posture, m.
        pub clearance_measured_m: f64,
        /// Largest |command - measured| over the joints, rad or m.
        pub tracking_error: f64,
        /// Mean limb error of the target, rad.
        pub limb_error_target_rad: f64,
        /// Mean limb error of the measured posture, rad.
        pub limb_error_measured_rad: f64,
        /// Speed scale in force, 0 to 1.
        pub speed_scale: f64,
        /// Distance of the measured joint `joint_outside` beyond its limit, rad or m. Negative below the lowest
        /// position.
        pub outside_by: f64,
        /// Distance that the torso still has to rise to its target while Engaging, m. Negative if it has to sink.
        /// Zero in other modes.
        pub torso_to_go_m: f64,
        /// Payload of the left and the right hand that the certificate assumes, kg.
        pub payload_kg: [f64; 2],
        /// Centres of mass of these payloads, each in its hand's frame, m.
        pub payload_centre_m: [[f64; 3]; 2],
        /// Nearest pair of capsules at the command, as indices of the robot file. If an obstacle is nearest, the
        /// second number is the number of capsules plus the obstacle's index. Obstacles are planes first, then
        /// boxes, in the order of the settings.
        pub nearest_pair: [u32; 2],
        /// The nearest pair at the measured posture, as above.
        pub nearest_pair_measured: [u32; 2],
        /// Index plus one of the joint that is measured farthest outside its limits. Zero if none is.
        pub joint_outside: u32,
        /// Bits of `reduced_flag`: the reasons for the reduced speed.
        pub reduced: u32,
        /// A `Mode`.
        pub mode: u32,
        /// Transitions since start. The last `TRANSITIONS_KEPT` are below.
        pub transition_count: u32,
        /// Transition n is at index n % `TRANSITIONS_KEPT`.
        pub transitions: [Transition; TRANSITIONS_KEPT],
        /// Number of times each fault was raised, indexed by `Fault`.
        pub fault_counts: [u32; FAULT_COUNT],
        /// Commands that the gate denied.
        pub gate_denials: u32,
        /// Ticks on which no new motion could be certified.
        pub fallbacks: u32,
        /// Operator connections.
        pub operators: u32,
        /// 1 while real-time scheduling is in force.
        pub realtime: u32,
        /// Index plus one of the joint whose |command - measured| is the largest share of the bound that stops the
        /// robot.
        pub tracking_joint: u32,
        /// Reason of the gate's last denial: a code of `safety::gate::Denial`, zero for never.
        pub denied_why: u32,
        /// Joint or pair of that denial: the code of a `Subject`, zero for none.
        pub denied_about: u32,
        /// Joint or pair for which the last motion was refused: the code of a `Subject`, zero for none.
        pub refused_about: u32,
        /// Reason of the newest drop of a frame by `ingest`, if it was within the last second: index in
        /// `skeleton`'s reasons plus one. Else zero.
        pub input_drop: u32,
        /// A `CalibrationSource`: the source of the elbow hinge axes.
        pub calibration: u32,
        /// User number plus one of the user who pressed the emergency stop and must reset it first. Zero if anyone
        /// may reset it.
        pub reset_first_by: u32,
        /// Resets that were refused for that reason, since start.
        pub resets_refused: u32,
        /// Zero while the command and the measured robot are at rest, near each other. Else 1.
        pub moving: u32,
        /// Index plus one of the joint that `VelocityError` or `StandstillLost` concerns, or that keeps a robot
        /// from rest although its command rests. Zero if there is none.
        pub unsteady_joint: u32,
        /// Payloads of operators that were taken, since start.
        pub payloads_taken: u32,
        /// Payloads that were refused since start.
        pub payloads_refused: u32,
        /// Reason of the last refusal of a payload: a `PayloadRefusal`, zero for none.
        pub payload_refused_why: u32,
        /// Index plus one of the joint that could not hold the payload. Zero if no joint was the reason.
        pub payload_refused_joint: u32,
        /// A `FollowingLimit`: the limit that keeps the command from the person, while Engaging or Engaged.
        pub limited_why: u32,
        /// Joint or pair that the limit concerns: the code of a `Subject`, zero for none.
        pub limited_about: u32,
        /// Arms that the operator leaves out while the enable is held: bit 0 the left one, bit 1 the right one. Bits 2 and 3:
        /// the same for arms that the operator uses, but of which the newest target has no person's arm.
        pub left_out: u32,
        /// `InputStatus::lost_permille`, of the last second.
        pub lost_permille: u32,
        /// Bits of `source_flag`: who leads each arm at this tick. None while the robot follows nobody.
        pub sources: u32,
        /// Zero.
        pub reserved: u32,
    }
}

impl Status {
    /// Returns the joint whose position is NaN or infinite, if `fault` is about positions. Its distances mean nothing.
    pub fn not_finite(&self, fault: Fault) -> Option<usize> {
        use Fault::{CollisionNear, StartInCollision, StartOutsideLimits, TrackingError};
        let about = matches!(fault, StartOutsideLimits | StartInCollision | CollisionNear | TrackingError);
        (about && !self.tracking_error.is_finite()).then_some(self.tracking_joint.saturating_sub(1) as usize)
    }

    /// Returns the joint or pair that a fault concerns now, if there is one.
    pub fn about(&self, fault: Fault) -> Option<Subject> {
        let joint = |number: u32| number.checked_sub(1).map(|joint| Subject::Joint(joint as usize));
        match fault {
            _ if self.not_finite(fault).is_some() => joint(self.tracking_joint),
            Fault::StartOutsideLimits => joint(self.joint_outside),
            Fault::StartInCollision | Fault::CollisionNear => Some(Subject::Pair(self.nearest_pair_measured)),
            Fault::TrackingError => joint(self.tracking_joint),
            Fault::VelocityError | Fault::StandstillLost => joint(self.unsteady_joint),
            Fault::GateDenied => Subject::from_code(self.denied_about),
            _ => None,
        }
    }
}

crate::named! {
    /// Limit that keeps a command from the person that it follows.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    #[repr(u32)]
    pub enum FollowingLimit {
        /// No limit: the robot is on its way or has arrived.
        #[default]
        None = 0 => "none",
        /// A joint moves at its highest speed.
        Speed = 1 => "speed",
        /// Two parts have the least clearance that is allowed.
        Clearance = 2 => "clearance",
        /// A joint is at the end of its range.
        Range = 3 => "range",
    }
}

impl FollowingLimit {
    /// Returns the limit with this number of `Status::limited_why`. Returns `Self::None` for an unknown number.
    pub fn from_u32(value: u32) -> Self {
        Self::ALL.get(value as usize).copied().unwrap_or_default()
    }
}
