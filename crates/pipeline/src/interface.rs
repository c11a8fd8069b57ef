//! `sim.interface`: how the simulated robot takes setpoints, in the form that each stage needs.

use messages::{HEAD, LEFT_ARM, TORSO};
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
    pub(crate) const fn simulated(self) -> sim::Interface {
        match self {
            Self::Direct => sim::Interface::Direct,
            Self::Jtc100 => sim::Interface::Jtc100,
        }
    }

    /// Converts it for the certificate.
    pub(crate) fn certified(self) -> wbc::Interface {
        match self {
            Self::Direct => wbc::Interface::default(),
            Self::Jtc100 => wbc::Interface::JTC_100_HZ,
        }
    }

    /// Converts it for the gate: controllers of torso, head, left arm and right arm. A spline through points every
    /// h deviates from a motion with the jerk limit J by at most J h^3 / 96.
    pub fn gated(self, model: &robot::Model) -> safety::gate::Interface {
        match self {
            Self::Direct => safety::gate::Interface::default(),
            Self::Jtc100 => {
                let wbc::Interface { skew_s, period_s, .. } = wbc::Interface::JTC_100_HZ;
                let spline = |j: usize| model.limits[j].j_max * period_s * period_s * period_s / 96.0;
                let controller = |j: usize| match j {
                    TORSO => 0,
                    _ if HEAD.contains(&j) => 1,
                    _ if LEFT_ARM.contains(&j) => 2,
                    _ => 3,
                };
                safety::gate::Interface {
                    off: std::array::from_fn(spline),
                    skew_s,
                    controller: std::array::from_fn(controller),
                }
            }
        }
    }
}
