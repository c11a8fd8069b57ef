//! `sim.interface`: how the simulated robot takes setpoints.

use serde::{Deserialize, Serialize};

/// How the simulated robot takes the setpoints of its driver.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum RobotInterface {
    /// It takes every command at its index.
    Direct,
    /// Four joint trajectory controllers, not synchronised, that take points at 100 Hz.
    Jtc100,
}

impl RobotInterface {
    /// All interfaces.
    pub const ALL: [Self; 2] = [Self::Direct, Self::Jtc100];

    /// Name in settings and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Jtc100 => "jtc100",
        }
    }

    /// Converts it for the simulated robot.
    pub const fn simulated(self) -> sim::Interface {
        match self {
            Self::Direct => sim::Interface::Direct,
            Self::Jtc100 => sim::Interface::Jtc100,
        }
    }
}
