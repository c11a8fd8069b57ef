//! The robot file: data that a URDF does not contain. A key is optional only if it can just tighten a limit.

use crate::error::RobotError;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The only accepted format.
pub(crate) const FORMAT: u32 = 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RobotFile {
    pub(crate) format: u32,
    pub(crate) name: String,
    pub(crate) urdf: String,
    pub(crate) base_link: String,
    pub(crate) torso_link: String,
    /// Movable joints of the URDF that nothing commands. They are modelled at position zero.
    pub(crate) held_joints: Vec<String>,
    pub(crate) joints: JointNames,
    pub(crate) limbs: Limbs,
    pub(crate) limits: Limits,
    /// Limits by joint name. They may only tighten.
    #[serde(default)]
    pub(crate) tighten: BTreeMap<String, Tighten>,
    pub(crate) home_m: BTreeMap<String, f64>,
    pub(crate) home_rad: BTreeMap<String, f64>,
    pub(crate) reference_rad: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) tasks: Tasks,
    /// Payload of the hands. Empty if the file has none.
    #[serde(default)]
    pub(crate) payload: Payloads,
    pub(crate) collision: Collision,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Payloads {
    pub(crate) left: Option<PayloadEntry>,
    pub(crate) right: Option<PayloadEntry>,
}

/// A point mass in a hand.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PayloadEntry {
    pub(crate) mass_kg: f64,
    /// Centre of mass in the frame of the link that the arm's last joint moves.
    pub(crate) centre_m: [f64; 3],
}

/// Costs of a deviation from the target where the robot is blocked. They never loosen a limit.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tasks {
    #[serde(default)]
    pub(crate) limb_orientation_weight: f64,
    /// Weights by joint name. The weight is 1 for a joint that is not named.
    #[serde(default)]
    pub(crate) joint_weight: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct JointNames {
    pub(crate) torso_lift: String,
    pub(crate) head_1: String,
    pub(crate) head_2: String,
    pub(crate) left_1: String,
    pub(crate) left_2: String,
    pub(crate) left_3: String,
    pub(crate) left_4: String,
    pub(crate) left_5: String,
    pub(crate) left_6: String,
    pub(crate) left_7: String,
    pub(crate) right_1: String,
    pub(crate) right_2: String,
    pub(crate) right_3: String,
    pub(crate) right_4: String,
    pub(crate) right_5: String,
    pub(crate) right_6: String,
    pub(crate) right_7: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Limbs {
    pub(crate) left: Limb,
    pub(crate) right: Limb,
}

/// The links whose rotations are the two limbs of an arm.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Limb {
    pub(crate) upper: String,
    pub(crate) fore: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Limits {
    pub(crate) stop_time_max_ms: f64,
    pub(crate) torso: PrismaticGroup,
    pub(crate) head: RevoluteGroup,
    pub(crate) arm_1_to_4: RevoluteGroup,
    pub(crate) arm_5_to_7: RevoluteGroup,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PrismaticGroup {
    pub(crate) soft_margin_m: f64,
    pub(crate) acceleration_max_m_per_s2: f64,
    pub(crate) jerk_max_m_per_s3: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RevoluteGroup {
    pub(crate) soft_margin_rad: f64,
    pub(crate) acceleration_max_rad_per_s2: f64,
    pub(crate) jerk_max_rad_per_s3: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Tighten {
    pub(crate) position_min_rad: Option<f64>,
    pub(crate) position_max_rad: Option<f64>,
    pub(crate) velocity_max_rad_per_s: Option<f64>,
    pub(crate) acceleration_max_rad_per_s2: Option<f64>,
    pub(crate) effort_max_n_m: Option<f64>,
    pub(crate) position_min_m: Option<f64>,
    pub(crate) position_max_m: Option<f64>,
    pub(crate) velocity_max_m_per_s: Option<f64>,
    pub(crate) acceleration_max_m_per_s2: Option<f64>,
    pub(crate) effort_max_n: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Collision {
    pub(crate) clearance_min_mm: f64,
    pub(crate) clearance_measured_min_mm: f64,
    pub(crate) capsules: Vec<CapsuleEntry>,
    pub(crate) allowed: Allowed,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CapsuleEntry {
    pub(crate) name: String,
    pub(crate) link: String,
    pub(crate) a_m: [f64; 3],
    pub(crate) b_m: [f64; 3],
    pub(crate) radius_m: f64,
}

/// Pairs that are not checked, by reason. Each capsule lists the others.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Allowed {
    pub(crate) adjacent: BTreeMap<String, Vec<String>>,
    pub(crate) proved_clear: BTreeMap<String, Vec<String>>,
}

impl RobotFile {
    pub(crate) fn parse(file: &str, text: &str) -> Result<Self, RobotError> {
        if text.len() > crate::urdf::TEXT_BYTES_MAX {
            let bound = crate::urdf::TEXT_BYTES_MAX;
            return Err(RobotError::TooLong { file: file.into(), bytes: text.len(), bound });
        }
        let parsed: Self = toml::from_str(text)
            .map_err(|error| RobotError::Syntax { file: file.into(), cause: error.to_string().trim_end().into() })?;
        let refuse = |key: &str, value: String, bound: &str| Err(RobotError::value(file, key, value, bound));
        if parsed.format != FORMAT {
            return refuse("format", parsed.format.to_string(), &format!("this version reads {FORMAT}"));
        }
        if parsed.urdf.is_empty() || parsed.urdf.contains(['/', '\\']) {
            return refuse("urdf", parsed.urdf, "must be the name of a file in the same folder");
        }
        Ok(parsed)
    }
}

impl JointNames {
    /// Returns the names in the fixed joint order: torso lift, head, left arm, right arm.
    pub(crate) fn ordered(self) -> [String; messages::JOINTS] {
        [
            self.torso_lift,
            self.head_1,
            self.head_2,
            self.left_1,
            self.left_2,
            self.left_3,
            self.left_4,
            self.left_5,
            self.left_6,
            self.left_7,
            self.right_1,
            self.right_2,
            self.right_3,
            self.right_4,
            self.right_5,
            self.right_6,
            self.right_7,
        ]
    }
}

/// Returns the name of the URDF for a robot file. It is a file in the same folder.
pub fn urdf_file(toml_name: &str, toml_text: &str) -> Result<String, RobotError> {
    RobotFile::parse(toml_name, toml_text).map(|file| file.urdf)
}
