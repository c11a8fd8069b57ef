//! The record of a fit: digests of what capsules and proofs rest on. It finds a robot file or a URDF that was edited
//! since. It proves nothing, and does not protect against a person who writes a new record.

use crate::error::RobotError;
use crate::file::RobotFile;
use crate::model::Model;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// The first line of a record.
const MARK: &str = "# What capsules and proofs rest on. A start refuses files that were edited since. `collision check --sign` proves\n\
                    # them again.\n";
const ADVICE: &str = "run `collision check --sign`, which proves it again, or `collision fit`. Without [collision.fit] the file counts \
                      as hand-made";

/// `[collision.fit]`: digests (SHA-256), and the ranges for which the pairs were proved.
#[derive(Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FitEntry {
    capsules: String,
    allowed: String,
    held: String,
    urdf: String,
    ranges: BTreeMap<String, [f64; 2]>,
}

impl Model {
    /// The text of the robot file with the record of a fit below it, in the place of an older one.
    ///
    /// # Errors
    /// Refuses a file with something else below the old record, or with a record in another place.
    pub fn signed(&self) -> Result<String, RobotError> {
        let file = RobotFile::parse(&self.texts.toml_name, &self.texts.toml)?;
        let entry = BTreeMap::from([("collision", BTreeMap::from([("fit", self.fit_entry(&file))]))]);
        // Serialising strings, numbers and tables cannot fail.
        let record = toml::to_string(&entry).unwrap_or_default();
        let (text, below) = self.texts.toml.split_once(MARK).unwrap_or((&self.texts.toml, ""));
        let is_record = |below: toml::Table| match below.get("collision").and_then(toml::Value::as_table) {
            Some(table) => below.len() == 1 && table.len() == 1 && table.contains_key("fit"),
            None => below.is_empty(),
        };
        if !toml::from_str(below).is_ok_and(is_record) || below.is_empty() && file.collision.fit.is_some() {
            let (key, bound) = (
                "[collision.fit]",
                "the last thing in the file, below its own comment: move what stands below it \
                                                    up, or remove the record",
            );
            return Err(RobotError::value(&self.texts.toml_name, key.to_owned(), "in another place".to_owned(), bound));
        }
        Ok(format!("{}\n\n{MARK}{record}", text.trim_end()))
    }

    /// Checks that nothing was edited since the fit: capsules, tables, held joints, the URDF, and ranges in force, which may
    /// only be narrower. A file without a record passes, see [`Model::doubts`].
    pub fn check_fit(&self) -> Result<(), RobotError> {
        let file = RobotFile::parse(&self.texts.toml_name, &self.texts.toml)?;
        let Some(fit) = &file.collision.fit else { return Ok(()) };
        let (toml, now) = (&self.texts.toml_name, self.fit_entry(&file));
        for (file, key, before, after) in [
            (toml, "collision.capsules", &fit.capsules, &now.capsules),
            (toml, "collision.allowed or clearance_min_mm", &fit.allowed, &now.allowed),
            (toml, "base_link, held_rad or held_m", &fit.held, &now.held),
            (&self.texts.urdf_name, "its text", &fit.urdf, &now.urdf),
        ] {
            if before != after {
                return Err(RobotError::Edited { file: file.clone(), key: key.into(), advice: ADVICE.into() });
            }
        }
        for (joint, [low, high]) in &now.ranges {
            let proved = fit.ranges.get(joint).copied().unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
            let wide = if *low < proved[0] { Some(("lowest", *low)) } else { None };
            if let Some((end, value)) = wide.or_else(|| (*high > proved[1]).then_some(("highest", *high))) {
                let bound =
                    format!("edited after the fit: pairs were proved for {} to {}. {ADVICE}", proved[0], proved[1]);
                let (file, joint, key) = (toml.clone(), joint.clone(), format!("{end} position in force"));
                return Err(RobotError::Joint { file, joint, key, value, bound });
            }
        }
        Ok(())
    }

    /// Sentences about why a person must look at the collision model: it has no record of a fit, or moving links that no
    /// capsule guards.
    pub fn doubts(&self) -> Vec<String> {
        let file = RobotFile::parse(&self.texts.toml_name, &self.texts.toml);
        let mut doubts = Vec::new();
        if file.is_ok_and(|file| file.collision.fit.is_none()) {
            doubts.push("the collision model is hand-made: no record of a fit says that it was proved".to_owned());
        }
        let unguarded = self.links.iter().filter(|link| {
            let seen = !link.visuals.is_empty() || !link.meshes.is_empty() || link.inertia.mass_kg > 0.0;
            seen && link.body > 0 && !self.capsules.iter().any(|capsule| capsule.body == link.body)
        });
        let names: Vec<&str> = unguarded.map(|link| link.name.as_str()).collect();
        if !names.is_empty() {
            doubts.push(format!("no capsule moves with {}: nothing keeps them clear", names.join(", ")));
        }
        doubts
    }

    fn fit_entry(&self, file: &RobotFile) -> FitEntry {
        let capsule = |c: &crate::file::CapsuleEntry| format!("{:?}", (&c.name, &c.link, c.a_m, c.b_m, c.radius_m));
        let capsules: Vec<String> = file.collision.capsules.iter().map(capsule).collect();
        let (allowed, least_mm) = (&file.collision.allowed, file.collision.clearance_min_mm);
        let tables = (&allowed.adjacent, &allowed.proved_clear, &allowed.overlap_as_published, least_mm);
        let held = (&file.base_link, &file.held_rad, &file.held_m);
        let ranges = self.joint_names.iter().zip(&self.limits).map(|(name, l)| (name.clone(), [l.q_min, l.q_max]));
        FitEntry {
            capsules: digest(&capsules.join("\n")),
            allowed: digest(&format!("{tables:?}")),
            held: digest(&format!("{held:?}")),
            urdf: digest(&self.texts.urdf),
            ranges: ranges.collect(),
        }
    }
}

fn digest(text: &str) -> String {
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}
