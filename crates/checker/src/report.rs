//! The checker's report on a run.

use messages::JOINTS_MAX;

messages::named! {
    /// A limit that an executed step can violate.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum ViolationKind {
        /// Position limits.
        Position = 0 => "position",
        /// Velocity limit, at the ends of a tick and inside it.
        Velocity = 1 => "velocity",
        /// Acceleration limit.
        Acceleration = 2 => "acceleration",
        /// Jerk limit. The acceleration changed by more than the limit allows, or velocity or position by more than
        /// in any motion within the limit.
        Jerk = 3 => "jerk",
        /// Clearance of a checked pair, or from an obstacle.
        Clearance = 4 => "clearance",
        /// Speed of an elbow or a hand in the base frame.
        HandSpeed = 5 => "hand speed",
        /// Effort limit, by the torque that the links need in the executed motion.
        Torque = 6 => "torque",
    }
}

/// One violation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// The violated limit.
    pub kind: ViolationKind,
    /// Index of the executed step.
    pub k: u64,
    /// The joint, or 0 to 3 for the speed of left elbow, left hand, right elbow and right hand, or the index of the
    /// pair. With m obstacles the pair of capsule i and obstacle k has the index m i + k after the model's pairs.
    pub which: usize,
    /// The value, SI.
    pub value: f64,
    /// The limit that it breaks, SI.
    pub limit: f64,
}

/// Counts and extremes since the start.
#[derive(Clone, Debug)]
pub struct Report {
    pub(crate) counts: [u64; ViolationKind::ALL.len()],
    /// The first violation, to find the cause.
    pub first_violation: Option<Violation>,
    /// Number of executed steps that were checked.
    pub steps: u64,
    /// The least clearance of the checked pairs over all executed postures, m. It is infinite before the first.
    pub min_clearance_m: f64,
    /// The least clearance of the steps that had to keep the clearance of every command, m. It leaves out the stops that
    /// the driver began by itself, and recoveries.
    pub min_proved_clearance_m: f64,
    /// The largest torque of each joint over its effort limit, by the dynamics of the links in every executed motion.
    pub(crate) torque_share_max: [f64; JOINTS_MAX],
    /// The largest of these ratios in the newest executed step that was judged for it.
    pub torque_share: f64,
    /// Number of times that the mode became Engaging with the robot at rest.
    pub engagements: u64,
    /// The largest step of a revolute joint in the first tick of Engaging from rest, rad.
    pub engage_max_step_rad: f64,
    /// The largest |v| / v_max of any joint in the first second after Engaging began from rest, while the mode was
    /// Engaging or Engaged.
    pub engage_first_second_velocity_ratio: f64,
}

impl Default for Report {
    fn default() -> Self {
        Self {
            counts: [0; ViolationKind::ALL.len()],
            first_violation: None,
            steps: 0,
            min_clearance_m: f64::INFINITY,
            min_proved_clearance_m: f64::INFINITY,
            torque_share_max: [0.0; JOINTS_MAX],
            torque_share: 0.0,
            engagements: 0,
            engage_max_step_rad: 0.0,
            engage_first_second_velocity_ratio: 0.0,
        }
    }
}

impl Report {
    /// Returns the violations by kind: name and number of joints or steps.
    pub fn violations(&self) -> [(&'static str, u64); ViolationKind::ALL.len()] {
        ViolationKind::ALL.map(|kind| (kind.name(), self.counts[kind as usize]))
    }

    /// Returns the number of violations of one kind.
    pub fn violations_of(&self, kind: ViolationKind) -> u64 {
        self.counts[kind as usize]
    }

    /// Returns the number of violations of all kinds.
    pub fn violations_total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the largest of `torque_share_max`, and its joint.
    pub fn largest_torque_share(&self) -> (f64, usize) {
        let larger = |most: (f64, usize), (j, &share): (usize, &f64)| if share > most.0 { (share, j) } else { most };
        self.torque_share_max.iter().enumerate().fold((0.0, 0), larger)
    }
}
