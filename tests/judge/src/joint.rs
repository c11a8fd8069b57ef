//! The motion of one joint, as polynomials of time.

use messages::StopPlan;

/// Position, velocity and acceleration of a joint, rad or m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Position.
    pub q: f64,
    /// Velocity.
    pub v: f64,
    /// Acceleration.
    pub a: f64,
}

/// Three phases of a stop: jerk and duration (s).
pub type Stop = [(f64, f64); 3];

impl Joint {
    /// Returns the joint after `t` seconds of jerk `j`.
    pub fn after(self, j: f64, t: f64) -> Self {
        Self {
            q: self.q + self.v * t + self.a * t * t / 2.0 + j * t * t * t / 6.0,
            v: self.v + self.a * t + j * t * t / 2.0,
            a: self.a + j * t,
        }
    }

    /// Returns the joint after `t` seconds of the stop. After its end the joint is at rest.
    pub fn play(mut self, stop: &Stop, t: f64) -> Self {
        let mut left = t;
        for (jerk, duration) in stop {
            let dt = left.min(*duration);
            self = self.after(*jerk, dt);
            left -= dt;
        }
        // The end itself is at rest by definition. The gate's clock errs by 1e-15 s per tick.
        let over = t >= duration_s(stop) - 1e-12;
        if over { Self { v: 0.0, a: 0.0, ..self } } else { self }
    }

    /// Returns true if no figure of the two is farther apart than `by`.
    pub fn is_near(self, other: Self, by: f64) -> bool {
        (self.q - other.q).abs() <= by && (self.v - other.v).abs() <= by && (self.a - other.a).abs() <= by
    }
}

/// Returns the stop of joint `j` in a plan.
pub fn stop_of(plan: &StopPlan, j: usize) -> Stop {
    std::array::from_fn(|i| (plan.jerk[j][i], plan.duration_s[j][i]))
}

/// Returns the duration of a stop, s.
pub fn duration_s(stop: &Stop) -> f64 {
    stop.iter().map(|(_, duration)| duration).sum()
}

/// Returns the rest of a stop after `t` seconds.
pub fn rest_of(stop: &Stop, t: f64) -> Stop {
    let mut left = t;
    stop.map(|(jerk, duration)| {
        let t = left.min(duration);
        left -= t;
        (jerk, duration - t)
    })
}
