//! The effect of a robot's own interface on the commands, and the distance that it may cost.
//!
//! A robot may have several controllers that are not synchronised, and that sample with their own period h.
//! Such a robot does not execute the commanded q(t). Joint k of the controller g (torso, head, left arm,
//! right arm) is at time t at
//!
//! ```text
//! y_k(t) = q_k(t - d_g) + u_k,   |u_k| <= e_k,   0 <= d_g - D <= s
//! ```
//!
//! The delay D is common to all controllers. Each controller has an unknown *skew*, which may change from one
//! instant to the next. u_k is the error of the spline that the controller puts through its samples.
//!
//! *Skew.* Let t' be the commanded time of the controller that is least delayed. Joints of the others are
//! where the command was at most s earlier. With |q'''| <= J, and speed v_k and acceleration a_k at t',
//! Taylor's formula gives
//!
//! ```text
//! |q_k(t') - q_k(t' - d)| <= |v_k| s + |a_k| s^2 / 2 + J_k s^3 / 6      for 0 <= d <= s
//! ```
//!
//! A point of a capsule's axis is moved by at most R_k (see [`certificate`](crate::certificate)) times that.
//! Nobody knows which controller is least delayed. So of the sums over the joints of each controller between
//! a pair's capsules, all but the least count. If one controller moves all joints between a pair's capsules,
//! the pair loses nothing by skew.
//!
//! *Spline.* For |q''| <= A, a chord leaves q by at most A h^2 / 8. For |q'''| <= J, the cubic through
//! positions and velocities of the samples leaves it by at most J h^3 / 96. This is the integral of the
//! magnitude of its Peano kernel, which is largest in the middle of the period. All joints count.
//!
//! At every instant t' the certificate requires the clearance plus the sum of these, the *deviation*. The
//! deviation is a function of the command at t' alone, and not of later or earlier decisions. So the rest of
//! a certified plan is certified, as without an interface. The past's jerk limit is the limit that every
//! command keeps. At rest the constant part remains, sum of R_k (J_k s^3 / 6 + e_k). Its bound is
//! [`REST_MAX_M`].

use crate::chain::JointSet;
use crate::config::WbcError;
use crate::geometry::{CheckedPair, Geometry};
use crate::interval::Bounds;
use messages::JOINTS_MAX;
use robot::CONTROLLERS_MAX;

/// Largest deviation at rest, m. It is less than the distance beyond d_min that engaging requires. Otherwise
/// a robot could engage but not move.
pub const REST_MAX_M: f64 = 2e-3;
/// Longest skew and period, s. It is more than one period of the slowest interface.
const LONGEST_S: f64 = 0.05;

/// The curve that a controller puts through its samples of the command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// The command itself.
    #[default]
    Exact,
    /// A chord through the positions.
    Linear,
    /// A cubic through positions and velocities.
    CubicHermite,
}

/// The interface between the commands and the robot. The default executes every command at its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interface {
    /// Largest difference between the delays of two controllers, s.
    pub skew_s: f64,
    /// Time between two samples of the command, s. It is not used if interpolation is exact.
    pub period_s: f64,
    /// The curve through the samples.
    pub interpolation: Interpolation,
}

impl Interface {
    /// Joint trajectory controllers at 100 Hz, each with its own phase. The skew is one period, and the
    /// splines are cubic.
    pub const JTC_100_HZ: Self = Self { skew_s: 0.01, period_s: 0.01, interpolation: Interpolation::CubicHermite };

    fn check(&self) -> Result<(), WbcError> {
        for (key, value) in [("skew_s", self.skew_s), ("period_s", self.period_s)] {
            if !(0.0..=LONGEST_S).contains(&value) {
                return Err(WbcError::Interface { key, value, bound: LONGEST_S });
            }
        }
        Ok(())
    }

    /// The error e of one joint, rad or m.
    fn spline_error(&self, limits: &Bounds) -> f64 {
        let h = self.period_s;
        match self.interpolation {
            Interpolation::Exact => 0.0,
            Interpolation::Linear => limits.a_max * h * h / 8.0,
            Interpolation::CubicHermite => limits.j_max * h * h * h / 96.0,
        }
    }
}

/// Values of the deviation for each joint.
#[derive(Clone, Debug)]
pub(crate) struct Deviation {
    skew_s: f64,
    controllers: Controllers,
    joints: [JointDeviation; JOINTS_MAX],
    /// Largest loss of each pair at any speed and acceleration, m.
    pub(crate) largest: Vec<f64>,
}

/// The robot's controllers. Joints of one controller have one delay.
#[derive(Clone, Debug)]
pub struct Controllers {
    /// Joints of each.
    joints: Vec<JointSet>,
    /// Number of each joint's controller.
    of: [usize; JOINTS_MAX],
}

impl Controllers {
    /// Takes the joints of each controller. A joint that no controller moves counts as one of the first.
    pub fn new(joints: impl IntoIterator<Item = JointSet>) -> Self {
        let joints: Vec<JointSet> = joints.into_iter().take(CONTROLLERS_MAX).collect();
        let of = std::array::from_fn(|j| joints.iter().position(|set| set & 1 << j != 0).unwrap_or(0));
        Self { joints, of }
    }
}

#[derive(Clone, Copy, Debug)]
struct JointDeviation {
    /// J s^3 / 6.
    still: f64,
    /// The spline error e.
    spline: f64,
    /// Largest speed and acceleration.
    fastest: [f64; 2],
}

impl Deviation {
    /// Creates the deviation of the model `geometry` with these limits. Returns None if the interface
    /// executes exactly what is commanded.
    pub(crate) fn new(
        interface: &Interface,
        controllers: &Controllers,
        limits: &[Bounds; JOINTS_MAX],
        geometry: &Geometry,
    ) -> Result<Option<Self>, WbcError> {
        interface.check()?;
        let s = interface.skew_s;
        if s == 0.0 && interface.interpolation == Interpolation::Exact {
            return Ok(None);
        }
        let joints = limits.each_ref().map(|l| JointDeviation {
            still: l.j_max * s * s * s / 6.0,
            spline: interface.spline_error(l),
            fastest: [l.v_max, l.a_max],
        });
        let mut deviation = Self { skew_s: s, controllers: controllers.clone(), joints, largest: Vec::new() };
        let at_rest = |pair| deviation.loss_m(geometry, pair, |_| [0.0; 2]);
        let value = geometry.pairs.iter().map(at_rest).fold(0.0, f64::max);
        if value > REST_MAX_M {
            return Err(WbcError::Interface { key: "deviation at rest in m", value, bound: REST_MAX_M });
        }
        let fastest = |pair| deviation.loss_m(geometry, pair, |j| deviation.joints[j].fastest);
        deviation.largest = geometry.pairs.iter().map(fastest).collect();
        Ok(Some(deviation))
    }

    /// Largest loss of a pair, m, while `speed` bounds |velocity| and |acceleration| of each joint.
    #[inline]
    pub(crate) fn loss_m(&self, geometry: &Geometry, pair: &CheckedPair, speed: impl Fn(usize) -> [f64; 2]) -> f64 {
        let s = self.skew_s;
        let (mut lags, mut spline) = ([0.0; CONTROLLERS_MAX], 0.0);
        for side in [pair.a, pair.b] {
            let shape = &geometry.shapes[side.capsule];
            for (&j, &reach) in shape.chain[side.from..].iter().zip(&shape.reach[side.from..]) {
                let ([v, a], joint) = (speed(j), &self.joints[j]);
                lags[self.controllers.of[j]] += reach * (s * (v + a * s / 2.0) + joint.still);
                spline += reach * joint.spline;
            }
        }
        let (mut total, mut least) = (0.0, f64::INFINITY);
        for (lag, joints) in lags.into_iter().zip(&self.controllers.joints) {
            if pair.between & joints != 0 {
                total += lag;
                least = least.min(lag);
            }
        }
        spline + if total > 0.0 { total - least } else { 0.0 }
    }
}
