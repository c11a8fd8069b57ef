//! Names of a robot's parts, for clients that receive only indices. `control` writes them into the folder of its
//! instance.

use robot::Model;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// File in the instance's folder.
const FILE: &str = "names.json";

/// Longest file that is read: 128 capsules and obstacles and 17 joints have names of a few dozen bytes.
const BYTES_MAX: u64 = 1 << 16;

/// Names by index.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Names {
    joints: Vec<String>,
    prismatic: Vec<bool>,
    /// Lowest and highest position of each joint, rad or m.
    #[serde(default)]
    limits: Vec<[f64; 2]>,
    /// Capsules, and after them obstacles.
    parts: Vec<String>,
}

impl Names {
    /// Takes the names of `model`.
    pub fn of(model: &Model) -> Self {
        let capsules = model.capsules.iter().map(|capsule| capsule.name.clone());
        let obstacles = model.obstacles.iter().map(|obstacle| obstacle.name.clone());
        Self {
            joints: model.joint_names.to_vec(),
            prismatic: model.prismatic.to_vec(),
            limits: model.limits.iter().map(|limits| [limits.q_min, limits.q_max]).collect(),
            parts: capsules.chain(obstacles).collect(),
        }
    }

    /// Writes them into the folder of an instance.
    pub fn write(&self, run_dir: &Path) -> std::io::Result<()> {
        crate::write_anew(&run_dir.join(FILE), &serde_json::to_vec_pretty(self)?)
    }

    /// Reads the names that the instance's `control` wrote. Empty if there are none, and then clients show
    /// indices.
    pub fn read(run_dir: &Path) -> Self {
        let path = run_dir.join(FILE);
        let small = std::fs::metadata(&path).is_ok_and(|file| file.is_file() && file.len() <= BYTES_MAX);
        let bytes = if small { std::fs::read(&path).unwrap_or_default() } else { Vec::new() };
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    /// Name of joint `index`.
    pub fn joint(&self, index: usize) -> String {
        self.joints.get(index).cloned().unwrap_or_else(|| format!("joint {index}"))
    }

    /// Lowest and highest position of joint `index`, rad or m.
    pub fn limits(&self, index: usize) -> Option<[f64; 2]> {
        self.limits.get(index).copied().filter(|[low, high]| low < high)
    }

    /// Unit of joint `index`.
    pub fn unit(&self, index: usize) -> &'static str {
        match self.prismatic.get(index) {
            Some(true) => "m",
            Some(false) => "rad",
            None => "rad or m",
        }
    }

    /// Names of two parts.
    pub fn pair(&self, pair: [u32; 2]) -> String {
        let name = |index: u32| self.parts.get(index as usize).cloned().unwrap_or_else(|| format!("part {index}"));
        format!("{} and {}", name(pair[0]), name(pair[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_file_is_read_back_and_indices_replace_a_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let nobody = Names::read(folder.path());
        assert_eq!((nobody.joint(3), nobody.pair([1, 9])), ("joint 3".into(), "part 1 and part 9".into()));
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
        let (model, _) = crate::load_model(&file).expect("the shipped robot");
        let names = Names::of(&model);
        names.write(folder.path()).unwrap();
        let read = Names::read(folder.path());
        assert_eq!(read, names);
        assert_eq!((read.joint(0), read.unit(0)), ("torso_lift_joint".into(), "m"));
        assert!(read.pair([0, 1]).contains(&model.capsules[1].name));
        std::fs::write(folder.path().join(FILE), "{").unwrap();
        assert_eq!(Names::read(folder.path()), nobody);
    }
}
