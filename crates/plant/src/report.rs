//! The judge's report.

use messages::{JOINTS_MAX, Stamp};

messages::named! {
    /// A limit that can be violated.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum ViolationKind {
        /// A true position outside the URDF's limits.
        Stop = 0 => "stop",
        /// A true position outside the robot file's limits and the servo margin.
        Position = 1 => "position",
        /// A true speed above the limit and the permitted overshoot.
        Velocity = 2 => "velocity",
        /// A motor torque or force above the limit.
        Effort = 3 => "effort",
        /// A true clearance below the least one and the servo margin.
        Clearance = 4 => "clearance",
        /// Setpoints moved a joint faster than its speed limit allows in the wall time that passed.
        SetpointStep = 5 => "setpoint_step",
        /// Setpoints changed a velocity faster than the acceleration limit allows in the wall time that passed.
        SetpointChange = 6 => "setpoint_change",
    }
}

/// One violation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// The violated limit.
    pub kind: ViolationKind,
    /// Time of the violation.
    pub at: Stamp,
    /// The joint, or the index of the pair. The pair of capsule i with obstacle k of m has the index m i + k
    /// after the checked pairs.
    pub which: usize,
    /// The value, SI.
    pub value: f64,
    /// The bound that it breaks, SI.
    pub bound: f64,
}

/// Counts and extremes since the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Violations of each kind, in the order of [`ViolationKind::ALL`]: joints per look, or looks for the clearance.
    pub counts: [u64; ViolationKind::ALL.len()],
    /// The first violation.
    pub first: Option<Violation>,
    /// How often the truth was compared with the limits.
    pub looks: u64,
    /// How many setpoints were compared with the limits.
    pub setpoints: u64,
    /// Least true position of each joint, rad or m.
    pub q_min: [f64; JOINTS_MAX],
    /// Greatest true position of each joint, rad or m.
    pub q_max: [f64; JOINTS_MAX],
    /// Greatest true speed of each joint over its limit in force.
    pub speed_ratio_max: [f64; JOINTS_MAX],
    /// Greatest motor torque of each joint over its limit in force.
    pub effort_ratio_max: [f64; JOINTS_MAX],
    /// Least true clearance of the checked pairs and obstacles, m. Infinite before the first look.
    pub clearance_min_m: f64,
    /// Clearance at the last look, m.
    pub clearance_m: f64,
}

impl Default for Report {
    fn default() -> Self {
        Self {
            counts: [0; ViolationKind::ALL.len()],
            first: None,
            looks: 0,
            setpoints: 0,
            q_min: [f64::INFINITY; JOINTS_MAX],
            q_max: [f64::NEG_INFINITY; JOINTS_MAX],
            speed_ratio_max: [0.0; JOINTS_MAX],
            effort_ratio_max: [0.0; JOINTS_MAX],
            clearance_min_m: f64::INFINITY,
            clearance_m: f64::INFINITY,
        }
    }
}

impl Report {
    /// Returns the number of violations of one kind.
    pub fn count(&self, kind: ViolationKind) -> u64 {
        self.counts[kind as usize]
    }

    /// Returns the number of violations of all kinds.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    pub(crate) fn count_violation(&mut self, kind: ViolationKind, at: Stamp, which: usize, value: f64, bound: f64) {
        self.counts[kind as usize] += 1;
        self.first.get_or_insert(Violation { kind, at, which, value, bound });
    }
}
