//! Names of a robot's parts, for clients that receive only indices.

use crate::Model;
use serde::{Deserialize, Serialize};

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
    pub fn from_model(model: &Model) -> Self {
        let capsules = model.capsules.iter().map(|capsule| capsule.name.clone());
        let obstacles = model.obstacles.iter().map(|obstacle| obstacle.name.clone());
        Self {
            joints: model.joint_names.to_vec(),
            prismatic: model.prismatic[..model.count].to_vec(),
            limits: model.limits[..model.count].iter().map(|limits| [limits.q_min, limits.q_max]).collect(),
            parts: capsules.chain(obstacles).collect(),
        }
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

    /// Names of two parts. A part with itself stands for no pair: nothing was measured, or it was not finite.
    pub fn pair(&self, pair: [u32; 2]) -> String {
        if pair[0] == pair[1] {
            return "no pair".into();
        }
        let name = |index: u32| self.parts.get(index as usize).cloned().unwrap_or_else(|| format!("part {index}"));
        format!("{} and {}", name(pair[0]), name(pair[1]))
    }
}
