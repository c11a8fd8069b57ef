//! Measures how far the retargeted arm is from the human on clips that training never saw. The methods are the
//! network alone (K = 0), the network with two refinement steps (K = 2), and the best that the arm can do.

use crate::clips::Clip;
use crate::gimbal::Gimbal;
use crate::kinematics;
use crate::sampling::{near, noisy};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use retarget::{ArmModel, ArmQ, Limbs, Network, limb_error_deg, oracle, solve_poses};
use std::fmt;

/// Refinement steps of the second row.
const STEPS: u32 = 2;
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorFigures {
    /// Mean rotation error over limbs and frames, degrees.
    pub mean_deg: f64,
    /// 95th percentile of the rotation error, degrees.
    pub p95_deg: f64,
    /// S_GR, summed over the four limbs, mean over frames.
    pub s_gr: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    pub rows: [ErrorFigures; 3],
    pub clips: usize,
    pub arm_frames: usize,
    /// RMS joint change that a tracker's noise makes near the shoulder's gimbal with K = 2, degrees.
    pub gimbal_noise_deg: f64,
}

/// Each row's name in the manifest and in the table: the network alone, with Levenberg-Marquardt steps, and S_GR
/// minimised from many starts.
const ROWS: [[&str; 2]; 3] =
    [["k0", "K = 0 (network)"], ["k2", "K = 2 (two LM steps)"], ["optimum", "optimum (multi-start)"]];

#[derive(Default)]
struct Errors {
    degrees: Vec<f64>,
    s_gr: f64,
}

impl Errors {
    fn add(&mut self, arm: &ArmModel, human: &Limbs, q: &ArmQ) {
        let robot = arm.forward(q);
        let human = robot.target(human, arm.rolls);
        self.degrees.extend(limb_error_deg(&robot, &human));
        self.s_gr += retarget::s_gr(&robot, &human);
    }

    fn figures(mut self) -> ErrorFigures {
        let count = self.degrees.len().max(1);
        self.degrees.sort_by(f64::total_cmp);
        ErrorFigures {
            mean_deg: self.degrees.iter().sum::<f64>() / count as f64,
            p95_deg: self.degrees.get(count * 95 / 100).copied().unwrap_or(0.0),
            // There are two limbs per arm frame, and four limbs per frame.
            s_gr: 4.0 * self.s_gr / count as f64,
        }
    }
}

/// Converts limb rotations of training to those of retargeting.
pub fn limbs(pose: &kinematics::Limbs) -> Limbs {
    let [upper, fore] = pose.map(|limb| {
        let [x, y, z, w] = limb.map(f64::from);
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    });
    Limbs { upper, fore }
}

/// Returns both arms after a turn of the torso. Both are left arms, and one of them is mirrored.
pub fn turned(turn: &UnitQuaternion<f64>, arms: &[Limbs; 2]) -> [Limbs; 2] {
    let axis = turn.scaled_axis();
    let mirrored = UnitQuaternion::from_scaled_axis(Vector3::new(-axis.x, axis.y, -axis.z));
    let by = |turn: &UnitQuaternion<f64>, arm: &Limbs| Limbs { upper: turn * arm.upper, fore: turn * arm.fore };
    [by(turn, &arms[0]), by(&mirrored, &arms[1])]
}

/// Evaluates `network` on every frame of `clips`. The optimum is evaluated only on every `stride`-th frame,
/// because it is slow.
pub fn evaluate(arm: &ArmModel, network: &Network, clips: &[Clip], stride: usize) -> Evaluation {
    let [mut k0, mut k2, mut optimum] = [(); 3].map(|()| Errors::default());
    let mut arm_frames = 0;
    for sequence in clips.iter().flat_map(|clip| &clip.arms) {
        let mut previous = arm.mid();
        for (frame, pose) in sequence.iter().enumerate() {
            let human = limbs(pose);
            let [found] = solve_poses([arm; 2], network, &[human], STEPS);
            k0.add(arm, &human, &found.decoded);
            k2.add(arm, &human, &found.q);
            arm_frames += 1;
            if frame % stride.max(1) == 0 {
                previous = oracle(arm, &human, &previous).q;
                optimum.add(arm, &human, &previous);
            }
        }
    }
    let rows = [k0, k2, optimum].map(Errors::figures);
    let gimbal_noise_deg = gimbal_noise_deg(arm, network, clips, stride);
    Evaluation { rows, clips: clips.len(), arm_frames, gimbal_noise_deg }
}

/// Turns every `stride`-th arm near the gimbal, and returns the RMS joint change by half a degree of noise, degrees.
fn gimbal_noise_deg(arm: &ArmModel, network: &Network, clips: &[Clip], stride: usize) -> f64 {
    let gimbal = Gimbal::new(&kinematics::Arm::from(arm));
    let mut rng = Pcg64::new(1, 1);
    let (mut squares, mut count) = (0.0, 0);
    for pose in clips.iter().flat_map(|clip| &clip.arms).flat_map(|arm| arm.iter().step_by(stride.max(1))) {
        let pose = near(&mut rng, &gimbal, pose);
        let both = [pose, noisy(&mut rng, &pose)].map(|pose| limbs(&pose));
        let [clean, noisy] = solve_poses([arm; 2], network, &both, STEPS).map(|solved| solved.q);
        squares += clean.iter().zip(&noisy).map(|(a, b)| (a - b).to_degrees().powi(2)).sum::<f64>();
        count += clean.len();
    }
    (squares / f64::from(count.max(1) as u32)).sqrt()
}

impl Evaluation {
    pub fn table(&self) -> toml::Table {
        let mut table = toml::Table::new();
        table.insert("clips".into(), (self.clips as i64).into());
        table.insert("arm_frames".into(), (self.arm_frames as i64).into());
        for ([name, _], ErrorFigures { mean_deg, p95_deg, s_gr }) in ROWS.iter().zip(&self.rows) {
            for (key, value) in [("mean_deg", mean_deg), ("p95_deg", p95_deg), ("s_gr", s_gr)] {
                // Five digits are enough for a mean over this many frames.
                table.insert(format!("{name}_{key}"), ((value * 1e5).round() / 1e5).into());
            }
        }
        table.insert("gimbal_noise_deg".into(), ((self.gimbal_noise_deg * 1e3).round() / 1e3).into());
        table
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} validation clips, {} arm frames", self.clips, self.arm_frames)?;
        writeln!(f, "{:<28} {:>10} {:>10} {:>10}", "", "mean deg", "p95 deg", "S_GR")?;
        for ([_, name], row) in ROWS.iter().zip(&self.rows) {
            writeln!(f, "{name:<28} {:>10.3} {:>10.2} {:>10.5}", row.mean_deg, row.p95_deg, row.s_gr)?;
        }
        writeln!(f, "near the gimbal, half a degree of noise moves joints by {:.2} degrees RMS", self.gimbal_noise_deg)
    }
}
