//! Slow motions of one joint, as functions of time. Does no IO and reads no clock.

use messages::JOINTS_MAX;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Largest speed of s(x) = 10 x^3 - 15 x^4 + 6 x^5, at x = 1/2.
const RAMP_PEAK: f64 = 1.875;

/// A motion of one joint. All other joints stand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// Posture at the beginning, rad or m.
    pub from: [f64; JOINTS_MAX],
    pub joint: usize,
    /// Position of the joint at the other end, relative to `from`, rad or m.
    pub by: f64,
    /// Duration of a ramp, or of one wave, s.
    pub period_s: f64,
    /// Sinusoids to the other end and back. 0 is a ramp to the other end, without speed and acceleration at both ends.
    pub waves: u32,
}

impl Path {
    pub fn stand(from: [f64; JOINTS_MAX]) -> Self {
        Self { from, joint: 0, by: 0.0, period_s: 1.0, waves: 0 }
    }

    /// Returns a ramp of `joint` by `by` whose largest speed is `speed`, rad/s or m/s.
    pub fn ramp(from: [f64; JOINTS_MAX], joint: usize, by: f64, speed: f64) -> Self {
        Self { from, joint, by, period_s: RAMP_PEAK * by.abs() / speed, waves: 0 }
    }

    /// Returns waves of `joint` between `from` and `by` whose largest speed is `speed`, rad/s or m/s.
    pub fn waves(from: [f64; JOINTS_MAX], joint: usize, by: f64, speed: f64, waves: u32) -> Self {
        Self { from, joint, by, period_s: PI * by.abs() / speed, waves }
    }

    pub fn length_s(&self) -> f64 {
        self.period_s * f64::from(self.waves.max(1))
    }

    pub fn at(&self, t_s: f64) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
        let x = t_s.clamp(0.0, self.length_s()) / self.period_s;
        let (share, slope) = match self.waves {
            0 => (x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) * (1.0 - x)),
            _ => ((1.0 - (TAU * x).cos()) / 2.0, PI * (TAU * x).sin()),
        };
        let (mut q, mut dq) = (self.from, [0.0; JOINTS_MAX]);
        q[self.joint] += self.by * share;
        if (0.0..self.length_s()).contains(&t_s) {
            dq[self.joint] = self.by * slope / self.period_s;
        }
        (q, dq)
    }

    pub fn to_line(self) -> String {
        serde_json::json!(self).to_string()
    }

    /// Reads a line of [`to_line`](Self::to_line). `None` if it is none, or if a number is not usable.
    pub fn from_line(line: &str) -> Option<Self> {
        let path = serde_json::from_str(line).ok();
        path.filter(|path: &Self| path.joint < JOINTS_MAX && path.period_s > 0.0)
    }
}
