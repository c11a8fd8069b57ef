//! Thresholds of the state machine. They are validated once, and no configuration can loosen them beyond
//! fixed ceilings.

use thiserror::Error;

/// Returned for a setting that is refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ConfigError {
    /// Returned if a value is outside the range that the program allows.
    #[error("safety.{key} = {value}: must lie in [{min}, {max}]")]
    OutOfRange { key: &'static str, value: f64, min: f64, max: f64 },
    /// Returned if two settings contradict each other.
    #[error("safety.{lesser} = {lesser_value} must be below safety.{greater} = {greater_value}")]
    Order { lesser: &'static str, lesser_value: f64, greater: &'static str, greater_value: f64 },
}

/// Values of the configuration file, named as its keys. There are no defaults: the integrator sets every
/// value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Longest silence of `retarget` before the robot holds, ms.
    pub target_stale_ms: f64,
    /// Silence of `retarget` after which the speed begins to fall, ms. It reaches zero where the robot holds.
    pub target_late_ms: f64,
    /// Longest silence of the driver before the robot holds, ms.
    pub state_late_ms: f64,
    /// Longest silence of the driver before the robot stops, ms.
    pub state_stale_ms: f64,
    /// Silence of the person's skeleton after which the speed begins to fall, ms. It reaches zero where the
    /// robot holds.
    pub input_late_ms: f64,
    /// Longest silence of the person's skeleton before the robot holds, ms.
    pub input_stale_ms: f64,
    /// Longest silence of the operator's heartbeat before authority is released, ms.
    pub operator_silent_ms: f64,
    /// Time for which the enable must have been seen released since start before an edge counts, ms.
    pub enable_released_ms: f64,
    /// Longest duration of Holding, ms.
    pub hold_timeout_ms: f64,
    /// Largest |command - measured| of a revolute joint that is tolerated for longer than
    /// `tracking_error_ms`, rad.
    pub tracking_error_rad: f64,
    /// Largest |command - measured| of a revolute joint that is tolerated at all, rad.
    pub tracking_error_now_rad: f64,
    /// As `tracking_error_rad`, but of prismatic joints, m.
    pub tracking_error_m: f64,
    /// As `tracking_error_now_rad`, but of prismatic joints, m.
    pub tracking_error_now_m: f64,
    /// Time for which a tracking error above the lesser bound is tolerated, ms.
    pub tracking_error_ms: f64,
    /// Time for which the command may be far behind a target that jumped before the robot follows slowly, ms.
    pub target_jump_slow_ms: f64,
    /// Time for which a target may jump repeatedly before the robot holds, ms.
    pub target_jump_hold_ms: f64,
    /// Number of missed deadlines in a row that reduces the speed.
    pub deadlines_missed_slow: u32,
    /// Number of missed deadlines in a row that stops the robot.
    pub deadlines_missed_max: u32,
    /// Number of late ticks within a second that makes the robot hold.
    pub deadlines_late_per_s_max: u32,
}

/// Validated thresholds, in the integers that the tick compares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    pub(super) target_stale_ns: u64,
    pub(super) target_late_ns: u64,
    pub(super) state_late_ns: u64,
    pub(super) state_stale_ns: u64,
    pub(super) input_late_ns: u64,
    pub(super) input_stale_ns: u64,
    pub(super) operator_silent_ns: u64,
    pub(super) enable_released_ns: u64,
    pub(super) hold_timeout_ns: u64,
    pub(super) tracking_error_rad: f64,
    pub(super) tracking_error_now_rad: f64,
    pub(super) tracking_error_m: f64,
    pub(super) tracking_error_now_m: f64,
    pub(super) tracking_error_ns: u64,
    pub(super) target_jump_slow_ns: u64,
    pub(super) target_jump_hold_ns: u64,
    pub(super) deadlines_missed_slow: u32,
    pub(super) deadlines_missed_max: u32,
    pub(super) deadlines_late_per_s_max: u32,
}

/// Largest relaxation of the real-time streams where scheduling is not real-time. A 2-core machine under load
/// was seen to oversleep by tens of ms (2026-11). A factor of 100 would already be a second.
const RELAX_MAX: f64 = 100.0;

impl Settings {
    /// Returns (key, value, least, most). The ceilings are two to ten times the shipped values. A
    /// configuration may adapt a monitor to a robot, but may not switch it off.
    fn bounds(&self) -> [(&'static str, f64, f64, f64); 19] {
        [
            ("target_stale_ms", self.target_stale_ms, 1.0, 50.0),
            ("target_late_ms", self.target_late_ms, 0.5, 50.0),
            ("state_late_ms", self.state_late_ms, 1.0, 50.0),
            ("state_stale_ms", self.state_stale_ms, 2.0, 100.0),
            ("input_late_ms", self.input_late_ms, 5.0, 500.0),
            ("input_stale_ms", self.input_stale_ms, 10.0, 500.0),
            ("operator_silent_ms", self.operator_silent_ms, 40.0, 1000.0),
            ("enable_released_ms", self.enable_released_ms, 200.0, 5000.0),
            ("hold_timeout_ms", self.hold_timeout_ms, 100.0, 60_000.0),
            ("tracking_error_rad", self.tracking_error_rad, 0.001, 0.25),
            ("tracking_error_now_rad", self.tracking_error_now_rad, 0.001, 0.5),
            ("tracking_error_m", self.tracking_error_m, 0.0005, 0.05),
            ("tracking_error_now_m", self.tracking_error_now_m, 0.0005, 0.1),
            ("tracking_error_ms", self.tracking_error_ms, 1.0, 500.0),
            ("target_jump_slow_ms", self.target_jump_slow_ms, 1.0, 1000.0),
            ("target_jump_hold_ms", self.target_jump_hold_ms, 100.0, 5000.0),
            ("deadlines_missed_slow", f64::from(self.deadlines_missed_slow), 1.0, 50.0),
            ("deadlines_missed_max", f64::from(self.deadlines_missed_max), 1.0, 50.0),
            ("deadlines_late_per_s_max", f64::from(self.deadlines_late_per_s_max), 1.0, 100.0),
        ]
    }

    /// Checks every value against its bounds and against its partner. NaN is outside all bounds.
    pub fn validate(&self) -> Result<(), ConfigError> {
        for (key, value, min, max) in self.bounds() {
            if !(min..=max).contains(&value) {
                return Err(ConfigError::OutOfRange { key, value, min, max });
            }
        }
        let (slow, most) = (f64::from(self.deadlines_missed_slow), f64::from(self.deadlines_missed_max));
        let ordered = [
            ("target_late_ms", self.target_late_ms, "target_stale_ms", self.target_stale_ms),
            ("input_late_ms", self.input_late_ms, "input_stale_ms", self.input_stale_ms),
            ("target_jump_slow_ms", self.target_jump_slow_ms, "target_jump_hold_ms", self.target_jump_hold_ms),
            ("deadlines_missed_slow", slow, "deadlines_missed_max", most),
            ("state_late_ms", self.state_late_ms, "state_stale_ms", self.state_stale_ms),
            ("tracking_error_rad", self.tracking_error_rad, "tracking_error_now_rad", self.tracking_error_now_rad),
            ("tracking_error_m", self.tracking_error_m, "tracking_error_now_m", self.tracking_error_now_m),
        ];
        for (lesser, lesser_value, greater, greater_value) in ordered {
            if lesser_value >= greater_value {
                return Err(ConfigError::Order { lesser, lesser_value, greater, greater_value });
            }
        }
        Ok(())
    }
}

impl Config {
    /// Multiplies the bounds of the tracking error by `factor`, for a simulated robot whose drives are softer
    /// than real ones.
    #[must_use]
    pub fn with_tracking_factor(self, factor: f64) -> Self {
        Self {
            tracking_error_rad: self.tracking_error_rad * factor,
            tracking_error_now_rad: self.tracking_error_now_rad * factor,
            tracking_error_m: self.tracking_error_m * factor,
            tracking_error_now_m: self.tracking_error_now_m * factor,
            ..self
        }
    }

    /// Creates the thresholds for real-time scheduling.
    pub fn new(settings: &Settings) -> Result<Self, ConfigError> {
        Self::relaxed(settings, 1.0)
    }

    /// Creates the thresholds for a simulated driver without real-time scheduling. Times of the 1500 Hz
    /// streams and of this process's own deadlines are `factor` (1 to 100) times as long. Human-scale times
    /// and tracking bounds stay as they are.
    pub fn relaxed(settings: &Settings, factor: f64) -> Result<Self, ConfigError> {
        settings.validate()?;
        if !(1.0..=RELAX_MAX).contains(&factor) {
            let key = "stale_factor_without_realtime";
            return Err(ConfigError::OutOfRange { key, value: factor, min: 1.0, max: RELAX_MAX });
        }
        // No value overflows: the largest is 60 s times 100, which is 6e12 ns.
        let ns = |ms: f64| (ms * 1e6) as u64;
        Ok(Self {
            target_stale_ns: ns(settings.target_stale_ms * factor),
            target_late_ns: ns(settings.target_late_ms * factor),
            state_late_ns: ns(settings.state_late_ms * factor),
            state_stale_ns: ns(settings.state_stale_ms * factor),
            input_late_ns: ns(settings.input_late_ms),
            input_stale_ns: ns(settings.input_stale_ms),
            operator_silent_ns: ns(settings.operator_silent_ms),
            enable_released_ns: ns(settings.enable_released_ms),
            hold_timeout_ns: ns(settings.hold_timeout_ms),
            tracking_error_rad: settings.tracking_error_rad,
            tracking_error_now_rad: settings.tracking_error_now_rad,
            tracking_error_m: settings.tracking_error_m,
            tracking_error_now_m: settings.tracking_error_now_m,
            tracking_error_ns: ns(settings.tracking_error_ms),
            target_jump_slow_ns: ns(settings.target_jump_slow_ms),
            target_jump_hold_ns: ns(settings.target_jump_hold_ms),
            deadlines_missed_slow: (f64::from(settings.deadlines_missed_slow) * factor) as u32,
            deadlines_missed_max: (f64::from(settings.deadlines_missed_max) * factor) as u32,
            deadlines_late_per_s_max: (f64::from(settings.deadlines_late_per_s_max) * factor) as u32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relaxed_config_scales_target_state_and_deadline_limits_only() {
        let settings = Settings {
            target_stale_ms: 10.0,
            target_late_ms: 2.0,
            state_late_ms: 5.0,
            state_stale_ms: 20.0,
            input_late_ms: 50.0,
            input_stale_ms: 100.0,
            operator_silent_ms: 200.0,
            enable_released_ms: 210.0,
            hold_timeout_ms: 5000.0,
            tracking_error_rad: 0.05,
            tracking_error_now_rad: 0.15,
            tracking_error_m: 0.01,
            tracking_error_now_m: 0.03,
            tracking_error_ms: 110.0,
            target_jump_slow_ms: 250.0,
            target_jump_hold_ms: 1000.0,
            deadlines_missed_slow: 3,
            deadlines_missed_max: 9,
            deadlines_late_per_s_max: 12,
        };
        let ns = |ms: u64| ms * 1_000_000;
        let strict = Config {
            target_stale_ns: ns(10),
            target_late_ns: ns(2),
            state_late_ns: ns(5),
            state_stale_ns: ns(20),
            input_late_ns: ns(50),
            input_stale_ns: ns(100),
            operator_silent_ns: ns(200),
            enable_released_ns: ns(210),
            hold_timeout_ns: ns(5000),
            tracking_error_rad: 0.05,
            tracking_error_now_rad: 0.15,
            tracking_error_m: 0.01,
            tracking_error_now_m: 0.03,
            tracking_error_ns: ns(110),
            target_jump_slow_ns: ns(250),
            target_jump_hold_ns: ns(1000),
            deadlines_missed_slow: 3,
            deadlines_missed_max: 9,
            deadlines_late_per_s_max: 12,
        };
        let relaxed = Config {
            target_stale_ns: ns(40),
            target_late_ns: ns(8),
            state_late_ns: ns(20),
            state_stale_ns: ns(80),
            deadlines_missed_slow: 12,
            deadlines_missed_max: 36,
            deadlines_late_per_s_max: 48,
            ..strict
        };
        assert_eq!((Config::new(&settings), Config::relaxed(&settings, 4.0)), (Ok(strict), Ok(relaxed)));
    }
}
