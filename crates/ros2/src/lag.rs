//! Measures by how much the robot's servos lag.
//!
//! A sample q that lags by L + d behind what was sent, where L is what the settings say, differs from the setpoint p and
//! its velocity v of L before by q = p - d v. Over all samples of moving joints the least squares are
//!
//! ```text
//! d = sum v (p - q) / sum v^2
//! ```

use crate::trajectory::Executed;
use messages::JOINTS_MAX;

/// A joint that is commanded slower than this tells nothing, rad/s or m/s.
const MOVES: f64 = 0.05;
/// Samples of moving joints before the lag is known: a second of ten joints at 50 Hz.
const SAMPLES: u64 = 500;
/// A lag that differs by less from the settings is no matter, s: 5 mrad at 1 rad/s.
const ALIKE_S: f64 = 0.005;

#[derive(Clone, Copy, Debug, Default)]
pub struct Lag {
    product: f64,
    square: f64,
    samples: u64,
}

impl Lag {
    /// Adds a sample, with the setpoint of the known delay before it.
    pub fn add(&mut self, sent: &Executed, measured: &[f64; JOINTS_MAX]) {
        for j in 0..JOINTS_MAX {
            let v = sent.v[j];
            if v.abs() > MOVES {
                self.product += v * (sent.q[j] - measured[j]);
                self.square += v * v;
                self.samples += 1;
            }
        }
    }

    /// Additional lag, s. None before enough samples.
    pub fn additional_s(&self) -> Option<f64> {
        (self.samples >= SAMPLES).then(|| self.product / self.square)
    }

    /// Returns a sentence if the settings should say something else than `servo_lag_ms`.
    pub fn advice(&self, servo_lag_ms: f64) -> Option<String> {
        let additional_s = self.additional_s().filter(|s| s.abs() > ALIKE_S)?;
        let measured_ms = (servo_lag_ms + additional_s * 1e3).max(0.0);
        Some(format!(
            "the robot's joints followed {measured_ms:.0} ms behind their controllers: set ros2.servo_lag_ms = {measured_ms:.0}.0 \
             (it is {servo_lag_ms})"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lag_of_moving_joints_is_found_and_named() {
        for (lag_s, expected) in [(0.012, Some("22 ms")), (-0.008, Some("2 ms")), (0.001, None)] {
            let mut lag = Lag::default();
            for n in 0..200 {
                let t = f64::from(n) * 0.02;
                let sent = Executed { k: 1, q: [t.sin(); JOINTS_MAX], v: [t.cos(); JOINTS_MAX] };
                lag.add(&sent, &[(t - lag_s).sin(); JOINTS_MAX]);
            }
            assert!((lag.additional_s().expect("enough") - lag_s).abs() < 1e-3);
            let advice = lag.advice(10.0);
            assert_eq!(advice.is_some(), expected.is_some(), "{advice:?}");
            assert!(expected.is_none_or(|expected| advice.expect("differs").contains(expected)));
        }
    }

    #[test]
    fn standing_robot_tells_nothing() {
        let mut lag = Lag::default();
        let still = Executed { k: 1, q: [0.3; JOINTS_MAX], v: [0.0; JOINTS_MAX] };
        (0..1000).for_each(|_| lag.add(&still, &[0.1; JOINTS_MAX]));
        assert_eq!((lag.additional_s(), lag.advice(0.0)), (None, None));
    }
}
