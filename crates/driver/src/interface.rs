//! How a robot interpolates between the setpoints that its driver sends.

use messages::{TICK_HZ, TICK_S};

/// Ticks between two trajectory points: 10 ms.
pub const POINT_TICKS: u64 = TICK_HZ / 100;
/// Time between two trajectory points, s.
pub const POINT_S: f64 = POINT_TICKS as f64 * TICK_S;

messages::named! {
    /// How a robot interpolates between setpoints. Settings and command line use these names.
    #[derive(Clone, Copy, Debug, Default, serde::Deserialize, PartialEq, serde::Serialize, Eq)]
    #[serde(rename_all = "kebab-case")]
    pub enum Interface {
        /// The robot takes every setpoint at its index.
        #[default]
        Direct => "direct",
        /// The robot has trajectory controllers, not synchronised, that take points at 100 Hz.
        Jtc100 => "jtc100",
        /// The same for a driver that sends one point per message. The controllers begin again at the measured position.
        Jtc100Restart => "jtc100-restart",
    }
}

impl Interface {
    /// Returns the delay that it adds on average, s.
    pub const fn delay_s(self) -> f64 {
        match self {
            Self::Direct => 0.0,
            Self::Jtc100 | Self::Jtc100Restart => 1.5 * POINT_S,
        }
    }

    /// Returns true if trajectory controllers take the driver's setpoints.
    pub const fn has_controllers(self) -> bool {
        !matches!(self, Self::Direct)
    }
}
