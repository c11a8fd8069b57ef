//! The possible difference between the commands and the robot's motion, as far as the gate must know it.
//!
//! Joints of one controller follow together. Controllers may lag each other by the *skew* s. Take the least
//! delayed controller as the reference, and a joint k of another one. This joint is where its command was up
//! to s earlier. By Taylor's formula with the jerk limit J_k, its distance from the command is at most
//!
//! ```text
//! lag_k = s (|v_k| + s |a_k| / 2) + J_k s^3 / 6
//! ```
//!
//! Besides that, each joint may differ by `off_k` from the position where its controller should have it. R_k
//! are the levers of the joints between a pair's bodies (see `body`). The pair may lose
//!
//! ```text
//! sum over all joints of R_k off_k + sum over all controllers but the one with the least sum of R_k lag_k
//! ```
//!
//! because nobody knows which controller is least delayed. If one controller moves all joints between a pair's bodies,
//! the pair loses nothing by lag. Positions, speeds and accelerations are those of the command at that instant.

use messages::JOINTS_MAX;
use robot::JointLimits;

use super::body::Body;
use super::check::ConfigError;
use super::fixed::{Point, UNITS};

/// Largest deviation of a joint, rad or m. Assumption: ten times the worst value of 100 Hz controllers that
/// interpolate linearly.
const OFF_MAX: f64 = 1e-3;
/// Longest skew, s. Assumption: more than one period of the slowest interface.
const SKEW_MAX_S: f64 = 0.05;

/// The interface between the commands and the robot. The default executes every command at its time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interface {
    /// Largest difference between a joint and the position where its controller should have it, rad or m.
    pub off: [f64; JOINTS_MAX],
    /// Largest lag between controllers, s.
    pub skew_s: f64,
    /// Index of the controller that moves each joint.
    pub controller: [usize; JOINTS_MAX],
}

/// The interface after its checks, with the jerk limits.
#[derive(Clone, Debug)]
pub(super) struct Deviation {
    off: [f64; JOINTS_MAX],
    skew_s: f64,
    /// J s^3 / 6.
    still: [f64; JOINTS_MAX],
    controller: [usize; JOINTS_MAX],
}

impl Deviation {
    /// Returns None if every command is executed at its time.
    pub(super) fn new(interface: &Interface, limits: &[JointLimits; JOINTS_MAX]) -> Result<Option<Self>, ConfigError> {
        let Interface { off, skew_s, controller } = *interface;
        let within = |key, value: f64, bound: f64| {
            // Written so that NaN is refused too.
            let inside = value >= 0.0 && value <= bound;
            if inside { Ok(()) } else { Err(ConfigError::Interface { key, value, bound }) }
        };
        within("skew in s", skew_s, SKEW_MAX_S)?;
        for j in 0..JOINTS_MAX {
            within("deviation of a joint in rad or m", off[j], OFF_MAX)?;
            within("index of a controller", controller[j] as f64, (JOINTS_MAX - 1) as f64)?;
        }
        if skew_s == 0.0 && off == [0.0; JOINTS_MAX] {
            return Ok(None);
        }
        let still = limits.each_ref().map(|limits| limits.j_max * skew_s * skew_s * skew_s / 6.0);
        Ok(Some(Self { off, skew_s, still, controller }))
    }

    fn lag(&self, j: usize, v: f64, a: f64) -> f64 {
        self.skew_s * (v.abs() + self.skew_s * a.abs() / 2.0) + self.still[j]
    }

    /// Largest distance of a joint from its command, rad or m, at speed `v` and acceleration `a`.
    pub(super) fn most(&self, j: usize, v: f64, a: f64) -> f64 {
        self.off[j] + self.lag(j, v, a)
    }

    /// Largest loss of a pair's distance at an instant at which the joints are at `x`, m.
    pub(super) fn loss_m(&self, body: &Body, pair: usize, x: &[Point; JOINTS_MAX]) -> f64 {
        let mut lags = [None; JOINTS_MAX];
        let mut lost = 0.0;
        for (j, lever) in body.between(pair) {
            let lag = lever * self.lag(j, x[j].v as f64 / UNITS, x[j].a as f64 / UNITS);
            lost += lever * self.off[j];
            *lags[self.controller[j]].get_or_insert(0.0) += lag;
        }
        let (mut total, mut least) = (0.0, f64::INFINITY);
        for lag in lags.into_iter().flatten() {
            total += lag;
            least = f64::min(least, lag);
        }
        lost + if total > 0.0 { total - least } else { 0.0 }
    }
}
