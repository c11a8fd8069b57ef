//! The part of the robot file that a robot's body needs: joints, limits, capsules and pairs.

use crate::error::PlantError;
use crate::urdf::RawJoint;
use serde::Deserialize;
use std::collections::BTreeMap;

/// The only accepted format.
const FORMAT: u32 = 2;

#[derive(Deserialize)]
pub(crate) struct RobotFile {
    format: u32,
    pub(crate) base_link: String,
    #[serde(default)]
    pub(crate) base_height_m: f64,
    #[serde(default)]
    pub(crate) body_joints: Vec<String>,
    #[serde(default)]
    pub(crate) held_rad: BTreeMap<String, f64>,
    #[serde(default)]
    pub(crate) held_m: BTreeMap<String, f64>,
    pub(crate) arms: Arms,
    #[serde(default)]
    controllers: Vec<ControllerRow>,
    limits: Groups,
    /// Limits that the URDF leaves out, or for which it has a placeholder.
    #[serde(default)]
    supply: BTreeMap<String, Tighten>,
    #[serde(default)]
    tighten: BTreeMap<String, Tighten>,
    #[serde(default)]
    home_m: BTreeMap<String, f64>,
    home_rad: BTreeMap<String, f64>,
    #[serde(default)]
    payload: Payloads,
    pub(crate) collision: Collision,
}

/// Payloads of the hands. An unknown key here would be a mass that is not counted, so it is refused.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Payloads {
    left: Option<PayloadRow>,
    right: Option<PayloadRow>,
}

/// A mass (kg) and its place (m).
pub(crate) type PointMass = (f64, [f64; 3]);

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct PayloadRow {
    mass_kg: f64,
    centre_m: [f64; 3],
}

#[derive(Deserialize)]
pub(crate) struct Arms {
    pub(crate) left: ArmRow,
    pub(crate) right: ArmRow,
}

#[derive(Deserialize)]
pub(crate) struct ArmRow {
    pub(crate) joints: Vec<String>,
}

#[derive(Deserialize)]
struct ControllerRow {
    joints: Vec<String>,
}

#[derive(Deserialize)]
struct Groups {
    groups: BTreeMap<String, GroupRow>,
}

/// Limits of some joints, in rad or in m. An unknown key here would be a limit that is not kept, so it is refused.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GroupRow {
    joints: Vec<String>,
    #[serde(alias = "soft_margin_m")]
    soft_margin_rad: f64,
    #[serde(alias = "velocity_max_m_per_s")]
    velocity_max_rad_per_s: Option<f64>,
    #[serde(alias = "acceleration_max_m_per_s2")]
    acceleration_max_rad_per_s2: f64,
    #[serde(alias = "jerk_max_m_per_s3")]
    jerk_max_rad_per_s3: f64,
}

/// Tighter limits of a joint. An unknown key here would be a limit that is not kept, so it is refused.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tighten {
    #[serde(alias = "position_min_m")]
    position_min_rad: Option<f64>,
    #[serde(alias = "position_max_m")]
    position_max_rad: Option<f64>,
    #[serde(alias = "velocity_max_m_per_s")]
    velocity_max_rad_per_s: Option<f64>,
    #[serde(alias = "acceleration_max_m_per_s2")]
    acceleration_max_rad_per_s2: Option<f64>,
    #[serde(alias = "effort_max_n")]
    effort_max_n_m: Option<f64>,
}

#[derive(Deserialize)]
pub(crate) struct Collision {
    clearance_min_mm: f64,
    pub(crate) capsules: Vec<CapsuleRow>,
    pub(crate) allowed: AllowedPairs,
}

#[derive(Deserialize)]
pub(crate) struct CapsuleRow {
    pub(crate) name: String,
    pub(crate) link: String,
    pub(crate) a_m: [f64; 3],
    pub(crate) b_m: [f64; 3],
    pub(crate) radius_m: f64,
}

/// Pairs that are not checked, by reason.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AllowedPairs {
    pub(crate) adjacent: BTreeMap<String, Vec<String>>,
    pub(crate) proved_clear: BTreeMap<String, Vec<String>>,
    #[serde(default)]
    pub(crate) overlap_as_published: BTreeMap<String, Vec<String>>,
}

/// Limits that the file adds to the URDF's limits of one joint, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stricter {
    pub(crate) soft_margin: f64,
    pub(crate) q_min: f64,
    pub(crate) q_max: f64,
    pub(crate) v_max: f64,
    pub(crate) a_max: f64,
    pub(crate) j_max: f64,
    pub(crate) effort_max: f64,
}

impl RobotFile {
    pub(crate) fn read(file: &str, text: &str) -> Result<Self, PlantError> {
        let read: Self =
            toml::from_str(text).map_err(|error| PlantError::Syntax { file: file.into(), cause: error.to_string() })?;
        if read.format != FORMAT {
            return Err(PlantError::value(file, "format", read.format, format!("this version reads {FORMAT}")));
        }
        Ok(read)
    }

    /// Writes the limits that the file supplies into a joint. One that turns without end gets its range.
    pub(crate) fn supply(&self, joint: &mut RawJoint) {
        let Some(row) = self.supply.get(&joint.name) else { return };
        let limit = joint.limit.get_or_insert_default();
        let given = [
            (row.position_min_rad, &mut limit.lower),
            (row.position_max_rad, &mut limit.upper),
            (row.velocity_max_rad_per_s, &mut limit.velocity),
            (row.effort_max_n_m, &mut limit.effort),
        ];
        for (value, limit) in given {
            *limit = value.unwrap_or(*limit);
        }
        if joint.kind == "continuous" && row.position_min_rad.is_some() && row.position_max_rad.is_some() {
            joint.kind = "revolute".into();
        }
    }

    /// Refuses a limit of a joint that is not among `names`: it would not be kept.
    pub(crate) fn check_names(&self, file: &str, names: &[String]) -> Result<(), PlantError> {
        let tightened = self.tighten.keys().map(|name| ("tighten", name));
        let grouped = self.limits.groups.values().flat_map(|group| &group.joints).map(|name| ("limits.groups", name));
        match tightened.chain(grouped).find(|(_, name)| !names.contains(name)) {
            Some((key, name)) => Err(PlantError::unknown(file, key, name, "a commanded joint")),
            None => Ok(()),
        }
    }

    /// Returns the number of the controller that moves a joint. One controller moves all if the file names none.
    pub(crate) fn controller(&self, file: &str, name: &String) -> Result<usize, PlantError> {
        let found = self.controllers.iter().position(|row| row.joints.contains(name));
        match (found, self.controllers.is_empty()) {
            (Some(controller), _) => Ok(controller),
            (None, true) => Ok(0),
            (None, false) => Err(PlantError::missing(file, format!("controllers: `{name}`"))),
        }
    }

    pub(crate) fn stricter(&self, file: &str, name: &String) -> Result<Stricter, PlantError> {
        let mut rows = self.limits.groups.values().filter(|row| row.joints.contains(name));
        let row = rows.next().ok_or_else(|| PlantError::missing(file, format!("limits.groups: `{name}`")))?;
        if rows.next().is_some() {
            return Err(PlantError::value(file, "limits.groups", name, "a joint may be in one group"));
        }
        let (soft_margin, a_max, j_max) =
            (row.soft_margin_rad, row.acceleration_max_rad_per_s2, row.jerk_max_rad_per_s3);
        let none = Tighten::default();
        let tighten = self.tighten.get(name).unwrap_or(&none);
        // `f64::min` passes over NaN, so each number is checked before it is compared.
        let given = [
            ("soft margin", Some(soft_margin), 0.0),
            ("acceleration_max", Some(a_max), f64::MIN_POSITIVE),
            ("jerk_max", Some(j_max), f64::MIN_POSITIVE),
            ("velocity_max of the group", row.velocity_max_rad_per_s, f64::MIN_POSITIVE),
            ("position_min", tighten.position_min_rad, f64::NEG_INFINITY),
            ("position_max", tighten.position_max_rad, f64::NEG_INFINITY),
            ("velocity_max", tighten.velocity_max_rad_per_s, f64::MIN_POSITIVE),
            ("acceleration_max", tighten.acceleration_max_rad_per_s2, f64::MIN_POSITIVE),
            ("effort_max", tighten.effort_max_n_m, f64::MIN_POSITIVE),
        ];
        for (key, value, least) in given {
            if let Some(value) = value.filter(|value| value.is_nan() || *value < least) {
                let key = format!("limits of `{name}`: {key}");
                return Err(PlantError::value(file, &key, value, "must not be negative, zero or NaN"));
            }
        }
        let or_infinite = |value: Option<f64>| value.unwrap_or(f64::INFINITY);
        Ok(Stricter {
            soft_margin,
            q_min: tighten.position_min_rad.unwrap_or(f64::NEG_INFINITY),
            q_max: or_infinite(tighten.position_max_rad),
            v_max: or_infinite(tighten.velocity_max_rad_per_s).min(or_infinite(row.velocity_max_rad_per_s)),
            a_max: a_max.min(or_infinite(tighten.acceleration_max_rad_per_s2)),
            j_max,
            effort_max: or_infinite(tighten.effort_max_n_m),
        })
    }

    pub(crate) fn home(&self, file: &str, name: &str) -> Result<f64, PlantError> {
        let found = self.home_m.get(name).or_else(|| self.home_rad.get(name));
        found.copied().ok_or_else(|| PlantError::missing(file, format!("home_rad.{name} or home_m.{name}")))
    }

    /// Returns mass (kg) and place (m, in the frame of the last link of the arm) of the payloads of the left and
    /// the right hand.
    pub(crate) fn payloads(&self, file: &str) -> Result<[Option<PointMass>; 2], PlantError> {
        let mut all = [None; 2];
        let rows = [("left", self.payload.left), ("right", self.payload.right)];
        for (found, (side, row)) in all.iter_mut().zip(rows) {
            let Some(PayloadRow { mass_kg, centre_m }) = row else { continue };
            if !(mass_kg >= 0.0 && mass_kg.is_finite()) {
                let key = format!("payload.{side}.mass_kg");
                return Err(PlantError::value(file, &key, mass_kg, "must be a finite number, at least 0"));
            }
            if centre_m.iter().any(|x| !x.is_finite()) {
                let key = format!("payload.{side}.centre_m");
                return Err(PlantError::value(file, &key, format!("{centre_m:?}"), "must be finite numbers"));
            }
            *found = Some((mass_kg, centre_m));
        }
        Ok(all)
    }

    /// Returns the least clearance of every checked pair, m.
    pub(crate) fn d_min_m(&self, file: &str) -> Result<f64, PlantError> {
        let mm = self.collision.clearance_min_mm;
        if mm >= 0.0 && mm.is_finite() {
            return Ok(mm * 1e-3);
        }
        Err(PlantError::value(file, "collision.clearance_min_mm", mm, "must be a finite number, at least 0"))
    }
}
