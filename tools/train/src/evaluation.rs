//! Measures how far the retargeted arm is from the human on clips that training never saw. The methods are the
//! network alone (K = 0), the network with two refinement steps (K = 2), and the best that the arm can do.

use crate::clips::Clip;
use crate::kinematics;
use nalgebra::{Quaternion, UnitQuaternion};
use retarget::{ArmModel, ArmQ, Limbs, Network, limb_error_deg, oracle, solve_poses};
use std::fmt;

/// Refinement steps of the second row.
const STEPS: u32 = 2;
/// Number of random starts of the optimum, in addition to the four that are not random. More starts change its
/// mean by less than 0.01 degrees.
const RANDOM_STARTS: u32 = 6;
const ORACLE_SEED: u64 = 7;

/// One row of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Mean rotation error over limbs and frames, degrees.
    pub mean_deg: f64,
    /// 95th percentile of the rotation error, degrees.
    pub p95_deg: f64,
    /// S_GR, summed over the four limbs, mean over frames.
    pub s_gr: f64,
}

/// The table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// Figures of the network alone.
    pub k0: Figures,
    /// Figures with two Levenberg-Marquardt steps.
    pub k2: Figures,
    /// Figures of S_GR minimised from many starts.
    pub optimum: Figures,
    /// Number of clips.
    pub clips: usize,
    /// Frames of both arms.
    pub arm_frames: usize,
}

/// Errors of one method: two limbs per arm frame.
#[derive(Default)]
struct Errors {
    degrees: Vec<f64>,
    s_gr: f64,
}

impl Errors {
    fn add(&mut self, arm: &ArmModel, human: &Limbs, q: &ArmQ) {
        let robot = arm.forward(q);
        self.degrees.extend(limb_error_deg(&robot, human));
        self.s_gr += retarget::s_gr(&robot, human);
    }

    fn figures(mut self) -> Figures {
        let count = self.degrees.len().max(1);
        self.degrees.sort_by(f64::total_cmp);
        Figures {
            mean_deg: self.degrees.iter().sum::<f64>() / count as f64,
            p95_deg: self.degrees.get(count * 95 / 100).copied().unwrap_or(0.0),
            // There are two limbs per arm frame, and four limbs per frame.
            s_gr: 4.0 * self.s_gr / count as f64,
        }
    }
}

/// Converts limb rotations of training to those of retargeting.
#[must_use]
pub fn limbs(pose: &kinematics::Limbs) -> Limbs {
    let rotation = |[x, y, z, w]: [f32; 4]| {
        UnitQuaternion::new_normalize(Quaternion::new(f64::from(w), f64::from(x), f64::from(y), f64::from(z)))
    };
    Limbs { upper: rotation(pose[0]), fore: rotation(pose[1]) }
}

/// Evaluates `network` on every frame of `clips`. The optimum is evaluated only on every `stride`-th frame,
/// because it is slow.
#[must_use]
pub fn evaluate(arm: &ArmModel, network: &Network, clips: &[Clip], stride: usize) -> Evaluation {
    let (mut k0, mut k2, mut optimum) = (Errors::default(), Errors::default(), Errors::default());
    let mut arm_frames = 0;
    for sequence in clips.iter().flat_map(|clip| &clip.arms) {
        let mut previous = arm.mid();
        for (frame, pose) in sequence.iter().enumerate() {
            let human = limbs(pose);
            let [found] = solve_poses(arm, network, &[human], STEPS);
            k0.add(arm, &human, &found.decoded);
            k2.add(arm, &human, &found.q);
            arm_frames += 1;
            if frame % stride.max(1) == 0 {
                previous = oracle(arm, &human, &previous, RANDOM_STARTS, ORACLE_SEED).q;
                optimum.add(arm, &human, &previous);
            }
        }
    }
    let (k0, k2, optimum) = (k0.figures(), k2.figures(), optimum.figures());
    Evaluation { k0, k2, optimum, clips: clips.len(), arm_frames }
}

impl Evaluation {
    /// Returns the manifest's `[validation]` table.
    #[must_use]
    pub fn table(&self) -> toml::Table {
        let mut table = toml::Table::new();
        let mut count = |key: &str, value: usize| {
            table.insert(key.into(), toml::Value::Integer(i64::try_from(value).unwrap_or(i64::MAX)))
        };
        count("clips", self.clips);
        count("arm_frames", self.arm_frames);
        for (name, figures) in [("k0", &self.k0), ("k2", &self.k2), ("optimum", &self.optimum)] {
            for (key, value) in [("mean_deg", figures.mean_deg), ("p95_deg", figures.p95_deg), ("s_gr", figures.s_gr)] {
                // Five digits are enough for a mean over this many frames.
                let value = (value * 1e5).round() / 1e5;
                table.insert(format!("{name}_{key}"), toml::Value::Float(value));
            }
        }
        table
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} validation clips, {} arm frames", self.clips, self.arm_frames)?;
        writeln!(f, "{:<28} {:>10} {:>10} {:>10}", "", "mean deg", "p95 deg", "S_GR")?;
        for (name, row) in [
            ("K = 0 (network)", &self.k0),
            ("K = 2 (two LM steps)", &self.k2),
            ("optimum (multi-start)", &self.optimum),
        ] {
            writeln!(f, "{name:<28} {:>10.3} {:>10.2} {:>10.5}", row.mean_deg, row.p95_deg, row.s_gr)?;
        }
        Ok(())
    }
}
