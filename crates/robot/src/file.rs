//! The robot file: data that a URDF does not contain. A key is optional only if it can just tighten a limit, or if
//! its absence has one meaning.

use crate::error::RobotError;
use crate::fit::FitEntry;
use crate::proposal::ProposalEntry;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The only accepted format.
pub(crate) const FORMAT: u32 = 2;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RobotFile {
    #[serde(rename = "format")]
    _format: u32,
    pub(crate) name: String,
    pub(crate) urdf: String,
    pub(crate) base_link: String,
    /// Height of `base_link` above the floor. The robot's base frame lies below it, on the floor.
    #[serde(default)]
    pub(crate) base_height_m: f64,
    pub(crate) torso_link: String,
    /// Turns the torso's link into the torso frame: x forward, y left, z up.
    #[serde(default)]
    pub(crate) torso_rpy_rad: [f64; 3],
    /// Commanded joints that belong to no arm: a lift, a waist, a head. In any order.
    #[serde(default)]
    pub(crate) body_joints: Vec<String>,
    /// The two body joints that turn the head, from the neck up. They follow the person's head.
    pub(crate) head_joints: Option<[String; 2]>,
    /// Positions of the movable joints of the URDF that nothing commands, rad.
    #[serde(default)]
    pub(crate) held_rad: BTreeMap<String, f64>,
    /// The same for those that slide, m.
    #[serde(default)]
    pub(crate) held_m: BTreeMap<String, f64>,
    pub(crate) arms: ArmEntries,
    /// The robot's controllers. Without any, one controller has all joints.
    #[serde(default)]
    pub(crate) controllers: Vec<ControllerEntry>,
    /// How the robot is driven.
    #[serde(default)]
    pub(crate) driver: ProposalEntry,
    pub(crate) limits: Limits,
    /// Limits by joint name that the URDF leaves out, or for which it has a placeholder.
    #[serde(default)]
    pub(crate) supply: BTreeMap<String, Tighten>,
    /// Limits by joint name. They may only tighten.
    #[serde(default)]
    pub(crate) tighten: BTreeMap<String, Tighten>,
    #[serde(default)]
    pub(crate) home_m: BTreeMap<String, f64>,
    pub(crate) home_rad: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) tasks: Tasks,
    /// Payload of the hands. Empty if the file has none.
    #[serde(default)]
    pub(crate) payload: Sides<Option<PayloadEntry>>,
    /// Grippers. Empty if nothing commands the fingers.
    #[serde(default)]
    pub(crate) hands: Sides<Option<HandEntry>>,
    pub(crate) collision: Collision,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sides<T> {
    pub(crate) left: T,
    pub(crate) right: T,
}

/// Both arms, and whether they mirror each other. A file that does not say so refuses arms that do not.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ArmEntries {
    pub(crate) mirrored: Option<bool>,
    pub(crate) left: ArmEntry,
    pub(crate) right: ArmEntry,
}

/// An arm: its joints from the shoulder to the hand, the links whose rotations are its two limbs, and the T-pose.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ArmEntry {
    pub(crate) joints: Vec<String>,
    pub(crate) upper: String,
    pub(crate) fore: String,
    /// Positions of the joints up to the forearm in the T-pose.
    pub(crate) reference_rad: Vec<f64>,
}

/// Joints that one controller of the robot moves together.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ControllerEntry {
    pub(crate) name: String,
    pub(crate) joints: Vec<String>,
}

/// A point mass in a hand.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PayloadEntry {
    pub(crate) mass_kg: f64,
    /// Centre of mass in the frame of the link that the arm's last joint moves.
    pub(crate) centre_m: [f64; 3],
}

/// A gripper: positions of its joints when it is open and when it is closed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HandEntry {
    #[serde(default)]
    pub(crate) controller: String,
    /// Distance between the fingers of an open hand.
    pub(crate) opening_m: f64,
    pub(crate) closing_time_ms: f64,
    pub(crate) force_max_n: f64,
    #[serde(default)]
    pub(crate) open_rad: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) closed_rad: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) open_m: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) closed_m: BTreeMap<String, f64>,
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
pub(crate) struct Limits {
    pub(crate) stop_time_max_ms: f64,
    /// Every commanded joint is in exactly one group.
    pub(crate) groups: BTreeMap<String, Group>,
}

/// Limits of some joints of one kind: keys in rad for those that turn, in m for those that slide.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Group {
    pub(crate) joints: Vec<String>,
    pub(crate) soft_margin_rad: Option<f64>,
    pub(crate) velocity_max_rad_per_s: Option<f64>,
    pub(crate) acceleration_max_rad_per_s2: Option<f64>,
    pub(crate) jerk_max_rad_per_s3: Option<f64>,
    pub(crate) soft_margin_m: Option<f64>,
    pub(crate) velocity_max_m_per_s: Option<f64>,
    pub(crate) acceleration_max_m_per_s2: Option<f64>,
    pub(crate) jerk_max_m_per_s3: Option<f64>,
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
    /// Empty in a new file: `collision fit` writes them. A model needs at least one.
    #[serde(default)]
    pub(crate) capsules: Vec<CapsuleEntry>,
    /// Without it every pair is checked.
    #[serde(default)]
    pub(crate) allowed: Allowed,
    /// Without it the file is hand-made.
    pub(crate) fit: Option<FitEntry>,
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
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Allowed {
    pub(crate) adjacent: BTreeMap<String, Vec<String>>,
    pub(crate) proved_clear: BTreeMap<String, Vec<String>>,
    #[serde(default)]
    pub(crate) overlap_as_published: BTreeMap<String, Vec<String>>,
}

/// The one key that every format has.
#[derive(Deserialize)]
struct Format {
    format: u32,
}

impl RobotFile {
    pub(crate) fn parse(file: &str, text: &str) -> Result<Self, RobotError> {
        // No TOML begins so.
        if text.trim_start().starts_with('<') {
            let cause =
                format!("this is a URDF, not a robot file: `teleopd robot new {file}` writes the robot file beside it");
            return Err(RobotError::Syntax { file: file.into(), cause });
        }
        if text.len() > crate::xml::TEXT_BYTES_MAX {
            let bound = crate::xml::TEXT_BYTES_MAX;
            return Err(RobotError::TooLong { file: file.into(), bytes: text.len(), bound });
        }
        let syntax = |error: toml::de::Error| RobotError::Syntax {
            file: file.into(),
            cause: error.to_string().trim_end().into(),
        };
        let refuse = |key: &str, value: String, bound: &str| Err(RobotError::value(file, key, value, bound));
        // The format comes first: an older file has other keys, and their names would say nothing.
        let Format { format } = toml::from_str(text).map_err(syntax)?;
        if format == 1 {
            return refuse("format", "1".into(), "this version reads 2: `teleopd robot new URDF` writes one");
        }
        if format != FORMAT {
            return refuse("format", format.to_string(), &format!("this version reads {FORMAT}"));
        }
        let parsed: Self = toml::from_str(text).map_err(syntax)?;
        if parsed.urdf.is_empty() || parsed.urdf.contains(['/', '\\']) {
            return refuse("urdf", parsed.urdf, "must be the name of a file in the same folder");
        }
        Ok(parsed)
    }
}

/// Returns the name of the URDF for a robot file. It is a file in the same folder.
pub fn urdf_file(toml_name: &str, toml_text: &str) -> Result<String, RobotError> {
    RobotFile::parse(toml_name, toml_text).map(|file| file.urdf)
}
