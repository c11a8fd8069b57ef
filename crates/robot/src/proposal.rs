//! The robot file's `[driver]`: which setpoints its controllers take. It is a proposal. The settings choose the
//! driver, so a robot file never makes hardware move.

use crate::error::RobotError;
use crate::model::Source;
use messages::JOINTS_MAX;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Indices of the motors that `rt/arm_sdk` of Unitree's G1 moves: waist 12 to 14, left arm 15 to 21, right arm 22 to 28.
/// Source: the example `g1_arm7_sdk_dds_example` of unitree_sdk2.
pub const ARM_SDK_INDICES: RangeInclusive<u32> = 12..=28;
/// Range of the stiffness (N m/rad) and damping (N m s/rad) of a motor. The examples of unitree_sdk2 and xr_teleoperate have
/// 40 to 300 and 1 to 3. Assumption: less does not hold an arm, and more is a mistake.
const STIFFNESS: [f64; 2] = [5.0, 400.0];
const DAMPING: [f64; 2] = [0.1, 10.0];

messages::named! {
    /// The setpoints that the robot's controllers take.
    #[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize, Eq)]
    #[serde(rename_all = "snake_case")]
    pub enum SetpointKind {
        /// Trajectory controllers of ROS 2. They play the certified stop by themselves.
        #[default]
        Trajectories => "trajectories",
        /// Controllers of ROS 2 that take positions. They hold the last one.
        Positions => "positions",
        /// The arms of a Unitree robot, beside its own controller.
        ArmSdk => "arm_sdk",
    }
}

/// A motor behind `arm_sdk`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Its place in the message.
    pub index: u32,
    /// Stiffness of the position loop, N m/rad.
    pub stiffness_n_m_per_rad: f64,
    /// Damping of the position loop, N m s/rad.
    pub damping_n_m_s_per_rad: f64,
}

/// How the robot is driven. Without `[driver]` it is by trajectories.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proposal {
    /// The setpoints that it takes.
    pub setpoints: SetpointKind,
    /// The robot type that `rt/lowstate` reports. None without `arm_sdk`.
    pub mode_machine: Option<u8>,
    /// One motor for each commanded joint. Empty without `arm_sdk`.
    pub motors: Vec<Motor>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProposalEntry {
    // Robot files of before 0.1.0 call it `interface`.
    #[serde(alias = "interface")]
    setpoints: SetpointKind,
    mode_machine: Option<u8>,
    #[serde(default)]
    motors: BTreeMap<String, Motor>,
}

impl Source<'_> {
    /// Checks `[driver]`. With `arm_sdk` each commanded joint has a motor of its own.
    pub(crate) fn proposal(
        &self,
        entry: ProposalEntry,
        names: &[String],
        prismatic: &[bool; JOINTS_MAX],
    ) -> Result<Proposal, RobotError> {
        let ProposalEntry { setpoints, mode_machine, motors: entries } = entry;
        let missing = |key: &str, bound: &str| self.value(key, "missing".into(), bound);
        let is_arm_sdk = setpoints == SetpointKind::ArmSdk;
        if !is_arm_sdk && (mode_machine.is_some() || !entries.is_empty()) {
            let bound = "must be \"arm_sdk\" for mode_machine and motors";
            return Err(self.value("driver.setpoints", format!("\"{}\"", setpoints.name()), bound));
        }
        if is_arm_sdk && mode_machine.is_none() {
            return Err(missing("driver.mode_machine", "must be the robot type that rt/lowstate reports"));
        }
        self.check_names("driver.motors", entries.keys(), names)?;
        let mut motors = Vec::new();
        for (j, name) in names.iter().enumerate().filter(|_| is_arm_sdk) {
            if prismatic[j] {
                let bound = "must be another kind: arm_sdk moves joints that turn, and this robot has one that slides";
                return Err(self.value("driver.setpoints", "\"arm_sdk\"".into(), bound));
            }
            let motor = *entries
                .get(name)
                .ok_or_else(|| missing("driver.motors", &format!("joint `{name}` must have a motor")))?;
            let joint = |key, value, bound: String| Err(self.joint(self.toml, name, key, value, bound));
            let (first, last) = (ARM_SDK_INDICES.start(), ARM_SDK_INDICES.end());
            if !ARM_SDK_INDICES.contains(&motor.index) {
                return joint("motor index", f64::from(motor.index), format!("arm_sdk moves {first} to {last}"));
            }
            if motors.iter().any(|other: &Motor| other.index == motor.index) {
                return joint("motor index", f64::from(motor.index), "belongs to another joint too".into());
            }
            for (key, value, [least, most]) in [
                ("stiffness_n_m_per_rad", motor.stiffness_n_m_per_rad, STIFFNESS),
                ("damping_n_m_s_per_rad", motor.damping_n_m_s_per_rad, DAMPING),
            ] {
                if !(least..=most).contains(&value) {
                    return joint(key, value, format!("must be {least} to {most}"));
                }
            }
            motors.push(motor);
        }
        Ok(Proposal { setpoints, mode_machine, motors })
    }
}
