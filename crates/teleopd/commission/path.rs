//! Slow motions of one joint, as functions of time. Does no IO and reads no clock.

use messages::JOINTS_MAX;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

/// Largest speed of s(x) = 10 x^3 - 15 x^4 + 6 x^5, at x = 1/2.
const RAMP_PEAK: f64 = 1.875;

/// Shape of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// From one end to the other. It begins and ends without speed and acceleration.
    Ramp,
    /// From one end to the other and back, this many times: a sinusoid.
    Wave(u32),
}

/// A motion of one joint. All other joints stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// Posture at the beginning, rad or m.
    pub from: [f64; JOINTS_MAX],
    /// The joint.
    pub joint: usize,
    /// Position of the joint at the other end, relative to `from`, rad or m.
    pub by: f64,
    /// Duration of a ramp, or of one wave, s.
    pub period_s: f64,
    /// Shape.
    pub shape: Shape,
}

impl Path {
    /// Returns a path that stands at `from`.
    pub fn stand(from: [f64; JOINTS_MAX]) -> Self {
        Self { from, joint: 0, by: 0.0, period_s: 1.0, shape: Shape::Ramp }
    }

    /// Returns a ramp of `joint` by `by` whose largest speed is `speed`, rad/s or m/s.
    pub fn ramp(from: [f64; JOINTS_MAX], joint: usize, by: f64, speed: f64) -> Self {
        Self { from, joint, by, period_s: RAMP_PEAK * by.abs() / speed, shape: Shape::Ramp }
    }

    /// Returns waves of `joint` between `from` and `by` whose largest speed is `speed`, rad/s or m/s.
    pub fn waves(from: [f64; JOINTS_MAX], joint: usize, by: f64, speed: f64, count: u32) -> Self {
        Self { from, joint, by, period_s: PI * by.abs() / speed, shape: Shape::Wave(count) }
    }

    /// Returns the time after which the joint stands, s.
    pub fn length_s(&self) -> f64 {
        match self.shape {
            Shape::Ramp => self.period_s,
            Shape::Wave(count) => self.period_s * f64::from(count),
        }
    }

    /// Returns positions and velocities at `t_s` after the beginning.
    pub fn at(&self, t_s: f64) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
        let x = t_s.clamp(0.0, self.length_s()) / self.period_s;
        let (share, slope) = match self.shape {
            Shape::Ramp => (x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), 30.0 * x * x * (1.0 - x) * (1.0 - x)),
            Shape::Wave(_) => ((1.0 - (TAU * x).cos()) / 2.0, PI * (TAU * x).sin()),
        };
        let (mut q, mut dq) = (self.from, [0.0; JOINTS_MAX]);
        q[self.joint] += self.by * share;
        if (0.0..self.length_s()).contains(&t_s) {
            dq[self.joint] = self.by * slope / self.period_s;
        }
        (q, dq)
    }

    /// Writes the path as one line.
    pub fn to_line(self) -> String {
        let waves = if let Shape::Wave(count) = self.shape { count } else { 0 };
        let Self { from, joint, by, period_s, .. } = self;
        json!({ "from": from, "joint": joint, "by": by, "period_s": period_s, "waves": waves }).to_string()
    }

    /// Reads a line of [`to_line`](Self::to_line). `None` if it is none, or if a number is not usable.
    pub fn from_line(line: &str) -> Option<Self> {
        let value: Value = serde_json::from_str(line).ok()?;
        let from: Vec<f64> = value["from"].as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
        let number = |key: &str| value[key].as_f64().filter(|number| number.is_finite());
        let shape = match value["waves"].as_u64()? {
            0 => Shape::Ramp,
            count => Shape::Wave(u32::try_from(count).ok()?),
        };
        let joint = usize::try_from(value["joint"].as_u64()?).ok().filter(|joint| *joint < JOINTS_MAX)?;
        let period_s = number("period_s").filter(|period_s| *period_s > 0.0)?;
        Some(Self { from: from.try_into().ok()?, joint, by: number("by")?, period_s, shape })
    }
}
