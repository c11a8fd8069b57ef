//! Thresholds of the state machine. They are validated once, and no configuration can loosen them beyond
//! fixed ceilings.

use thiserror::Error;

/// Returned for a setting that is refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum ConfigError {
    /// Returned if a value is outside the range that the program allows.
    #[error("safety.{0}")]
    OutOfRange(#[from] schema::OutOfBounds),
    /// Returned if two settings contradict each other.
    #[error("safety.{lesser} = {lesser_value} must be below safety.{greater} = {greater_value}")]
    Order { lesser: &'static str, lesser_value: f64, greater: &'static str, greater_value: f64 },
}

schema::table! {
    /// Thresholds of the monitors.
    #[derive(Copy)]
    pub struct Settings {
        /// Silence of `retarget` from which the speed falls, ms. It is below `target_stale_ms`, where the speed is zero.
        target_late_ms: f64 = 2.0, in [0.5, 50.0];
        /// Silence of `retarget` that holds, ms.
        target_stale_ms: f64 = 10.0, in [1.0, 50.0];
        /// Silence of the driver that holds, ms. It is below `state_stale_ms`.
        state_late_ms: f64 = 5.0, in [1.0, 50.0];
        /// Silence of the driver that stops and latches, ms.
        state_stale_ms: f64 = 20.0, in [2.0, 100.0];
        /// Silence of the skeleton from which the speed falls, ms. It is below `input_stale_ms`, where the speed is zero.
        /// At 50 ms one frame of 30 Hz may be lost.
        input_late_ms: f64 = 50.0, in [5.0, 500.0];
        /// Silence of the skeleton that holds, ms.
        input_stale_ms: f64 = 100.0, in [10.0, 500.0];
        /// Silence of the operator's heartbeat that releases, ms.
        operator_silent_ms: f64 = 200.0, in [40.0, 1000.0];
        /// How long the enable must have been released since the start before a press counts, ms. A dead-man's handle
        /// that is stuck at the start never engages.
        enable_released_ms: f64 = 200.0, in [200.0, 5000.0];
        /// Longest hold, ms. Then the robot is released.
        hold_timeout_ms: f64 = 5000.0, in [100.0, 60_000.0];
        /// Largest tracking error of a turning joint that may last longer than `tracking_error_ms`, rad. It is below
        /// `tracking_error_now_rad`. More stops. 5 mrad are 5 mm at 0.98 m of reach.
        tracking_error_rad: f64 = 0.005, in [0.001, 0.25];
        /// Largest tracking error of a turning joint, rad. More stops at once. 7 mrad are 7 mm at 0.98 m of reach, which
        /// is `clearance_min_mm` less `clearance_measured_min_mm`.
        tracking_error_now_rad: f64 = 0.007, in [0.001, 0.5];
        /// As `tracking_error_rad`, for the torso lift, m. It is below `tracking_error_now_m`.
        tracking_error_m: f64 = 0.0015, in [0.0005, 0.05];
        /// As `tracking_error_now_rad`, for the torso lift, m.
        tracking_error_now_m: f64 = 0.004, in [0.0005, 0.1];
        /// How long the smaller tracking error may last, ms.
        tracking_error_ms: f64 = 100.0, in [1.0, 500.0];
        /// How long the command may stay far behind a target that jumped, ms. It is below `target_jump_hold_ms`. Then the
        /// target is followed slowly.
        target_jump_slow_ms: f64 = 250.0, in [1.0, 1000.0];
        /// How long a target may jump again and again, ms. Then the robot holds.
        target_jump_hold_ms: f64 = 1000.0, in [100.0, 5000.0];
        /// Missed deadlines in a row that make the robot slow for a second. It is below `deadlines_missed_max`.
        deadlines_missed_slow: u32 = 3, in [1.0, 50.0];
        /// Missed deadlines in a row that stop.
        deadlines_missed_max: u32 = 10, in [1.0, 50.0];
        /// Late ticks within a second that hold.
        deadlines_late_per_s_max: u32 = 10, in [1.0, 100.0];
        /// Factor on the stale times and on the number of missed deadlines above, where scheduling is not real-time.
        stale_factor_without_realtime: f64 = 20.0, in [1.0, 50.0];
        /// Largest speed of elbows and hands in the base frame, m/s.
        hand_speed_max_m_per_s: f64 = 3.0, in [0.05, 3.0];
        /// Limits elbows and hands to 0.25 m/s, the reduced speed of ISO 10218-1.
        hand_speed_reduced: bool = false;
    }
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

/// Reduced speed, m/s: ISO 10218-1:2011, 5.6.2, 250 mm/s.
const HAND_SPEED_REDUCED_M_PER_S: f64 = 0.25;

impl Settings {
    /// The bound on elbows and hands, m/s.
    pub fn hand_speed_m_per_s(&self) -> f64 {
        let reduced = if self.hand_speed_reduced { HAND_SPEED_REDUCED_M_PER_S } else { f64::INFINITY };
        self.hand_speed_max_m_per_s.min(reduced)
    }

    /// Checks every value against its bounds and against its partner. The ceilings are two to ten times the shipped
    /// values. So a monitor may be adapted to a robot, but not switched off. NaN is outside all bounds.
    ///
    /// # Errors
    /// Returns an error for the first value that is refused.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.check()?;
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
    ///
    /// # Errors
    /// Returns an error for the first setting that is refused.
    pub fn new(settings: &Settings) -> Result<Self, ConfigError> {
        Self::scaled(settings, 1.0)
    }

    /// Creates the thresholds for a simulated driver without real-time scheduling. Times of the 1500 Hz
    /// streams and of this process's own deadlines are `stale_factor_without_realtime` times as long. Human-scale
    /// times and tracking bounds stay as they are.
    ///
    /// # Errors
    /// Returns an error for the first setting that is refused.
    pub fn relaxed(settings: &Settings) -> Result<Self, ConfigError> {
        Self::scaled(settings, settings.stale_factor_without_realtime)
    }

    fn scaled(settings: &Settings, factor: f64) -> Result<Self, ConfigError> {
        settings.validate()?;
        // No value overflows: the largest is 60 s times 50, which is 3e12 ns.
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
            enable_released_ms: 210.0,
            tracking_error_rad: 0.05,
            tracking_error_now_rad: 0.15,
            tracking_error_m: 0.01,
            tracking_error_now_m: 0.03,
            tracking_error_ms: 110.0,
            deadlines_missed_max: 9,
            deadlines_late_per_s_max: 12,
            stale_factor_without_realtime: 4.0,
            ..Settings::default()
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
        assert_eq!((Config::new(&settings), Config::relaxed(&settings)), (Ok(strict), Ok(relaxed)));
    }
}
