//! Limits of one joint.

/// Limits of one joint in SI units: rad for revolute joints, m for prismatic ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Lowest position, rad or m.
    pub q_min: f64,
    /// Highest position, rad or m.
    pub q_max: f64,
    /// Highest speed in either direction, rad/s or m/s.
    pub v_max: f64,
    /// Highest acceleration in either direction, rad/s^2 or m/s^2. Infinite if a URDF gives none.
    pub a_max: f64,
    /// Highest jerk in either direction, rad/s^3 or m/s^3. Infinite if a URDF gives none.
    pub j_max: f64,
    /// Highest torque or force in either direction, N m or N.
    pub effort_max: f64,
}

impl JointLimits {
    /// Returns true if a position, rad or m, is within the limits. False for NaN.
    pub fn contains(&self, q: f64) -> bool {
        q >= self.q_min && q <= self.q_max
    }

    /// Time of the jerk-limited stop from the highest speed, s. It is v / a + a / j (a trapezoid of
    /// acceleration).
    pub fn stop_time_s(&self) -> f64 {
        if self.v_max * self.j_max < self.a_max * self.a_max {
            2.0 * (self.v_max / self.j_max).sqrt()
        } else {
            self.v_max / self.a_max + self.a_max / self.j_max
        }
    }
}

/// Plausible bounds of a limit, for one kind of joint. They refuse typing errors and missing values, but not
/// strong robots. The largest arms sold as collaborative turn at 4.6 rad/s with 370 N m. The arms of the Unitree G1
/// turn at 37 rad/s by its URDF. Lifts of mobile manipulators carry 2 kN over less than 1 m.
pub(crate) struct Plausible {
    /// Largest magnitude of a position, rad or m.
    pub(crate) position: f64,
    /// Largest speed, rad/s or m/s.
    pub(crate) speed: f64,
    /// Largest acceleration, rad/s^2 or m/s^2.
    pub(crate) acceleration: f64,
    /// Largest jerk, rad/s^3 or m/s^3.
    pub(crate) jerk: f64,
    /// Largest torque or force, N m or N.
    pub(crate) effort: f64,
}

/// Plausible values of a revolute joint: a little more than two turns either way.
pub(crate) const REVOLUTE: Plausible =
    Plausible { position: 13.0, speed: 50.0, acceleration: 200.0, jerk: 20_000.0, effort: 1_000.0 };
/// Plausible values of a prismatic joint.
pub(crate) const PRISMATIC: Plausible =
    Plausible { position: 3.0, speed: 2.0, acceleration: 20.0, jerk: 2_000.0, effort: 10_000.0 };

impl Plausible {
    /// Returns the bounds for this kind of joint.
    pub(crate) fn for_joint(prismatic: bool) -> &'static Self {
        if prismatic { &PRISMATIC } else { &REVOLUTE }
    }
}
