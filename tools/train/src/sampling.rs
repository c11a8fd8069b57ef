//! Training poses: recorded human arms, procedural human arms, and robot postures, all from one seed.
//!
//! Every batch has its own generator, created from (seed, step, shard).

use crate::gimbal::Gimbal;
use crate::kinematics::{ARM, Arm, FEATURES, Limbs, about, features, product};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Share of recorded poses with a noisy copy that are at least near the gimbal. It is a little less than where the gimbal is
/// a hanging arm, 0.45, so the training of such an arm draws what it always drew.
const NEAR_GIMBAL: f64 = 0.4;
/// Largest turn of a pose away from the gimbal, about each torso axis, rad. With the jitter of every pose, it spreads
/// over the angles that count as near.
const GIMBAL_SPREAD_RAD: f32 = 0.2;

/// Recorded poses: every arm as a left arm.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// Limb rotations of the left and the right arm, one entry per frame.
    pub frames: Vec<[Limbs; 2]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixture {
    /// Share of procedural poses, 0..=1. The others are recorded. A share of one half cut the error on unseen
    /// data from 2.80 to 1.73 degrees at equal steps.
    pub procedural: f64,
    /// Largest common rotation of both limbs about each torso axis, rad. People's torso frames differ by as much.
    pub torso_jitter_rad: f32,
    /// Largest rotation of each limb by itself about each torso axis, rad.
    pub limb_jitter_rad: f32,
    /// Share of the recorded poses with a noisy copy that are turned to the arm's gimbal, 0..=1.
    pub gimbal: f64,
}

impl Recorded {
    /// Returns the share of recorded poses to turn to `gimbal`, so that `NEAR_GIMBAL` of all are near it. It is 0
    /// where people's arms hang at the gimbal, as TIAGo++'s.
    pub fn share_to_turn(&self, gimbal: &Gimbal) -> f64 {
        let arms = self.frames.as_flattened();
        let near = arms.iter().filter(|arm| gimbal.is_near(arm)).count();
        let share = near as f64 / arms.len().max(1) as f64;
        ((NEAR_GIMBAL - share) / (1.0 - share)).max(0.0)
    }

    /// Draws a recorded or procedural pose, with jitter. It is either arm of a frame.
    fn draw(&self, rng: &mut Pcg64, from_recording: bool, mixture: &Mixture) -> Limbs {
        let arm = if from_recording && !self.frames.is_empty() {
            let frame = &self.frames[rng.random_range(0..self.frames.len())];
            frame[rng.random_range(0..2)]
        } else {
            procedural(rng)
        };
        jittered(rng, &arm, mixture)
    }
}

impl Default for Mixture {
    /// Errors on the validation clips after 4,000 steps were 3.20, 3.15 and 3.03 degrees (2026-11-21). The
    /// torso / limb jitter was 0 / 0, 5 / 1.5 and 10 / 3 degrees.
    fn default() -> Self {
        Self {
            procedural: 0.5,
            torso_jitter_rad: 10_f32.to_radians(),
            limb_jitter_rad: 3_f32.to_radians(),
            gimbal: 0.0,
        }
    }
}

/// One batch: human poses, robot postures, and the triplets that they form. All vectors have `rows` rows.
#[derive(Clone, Debug)]
pub struct Batch {
    /// `[rows, inputs of the human encoder]`.
    pub features: Vec<f32>,
    /// `[rows]` human limb rotations.
    pub human: Vec<Limbs>,
    /// `[rows, joints]` joint positions, normalised to -1..1 over the limits.
    pub posture: Vec<f32>,
    /// `[rows]` limb rotations of the postures.
    pub robot: Vec<Limbs>,
    /// Row i forms a triplet of human i, human (i + shift) mod rows and robot i.
    pub shift: usize,
    /// Index of the anchor: 0 and 1 are the humans, 2 is the robot.
    pub anchor: Vec<u8>,
}

impl Batch {
    pub fn new(rows: usize) -> Self {
        assert!(rows >= 2, "a triplet needs two human poses");
        let identity = [[0.0, 0.0, 0.0, 1.0]; 2];
        Self {
            features: vec![0.0; rows * FEATURES],
            human: vec![identity; rows],
            posture: vec![0.0; rows * ARM],
            robot: vec![identity; rows],
            shift: 1,
            anchor: vec![0; rows],
        }
    }

    pub fn rows(&self) -> usize {
        self.anchor.len()
    }

    /// Returns true if this row may repeat the previous one with a tracker's noise. This is one row in eight.
    /// The other rows are enough to learn from.
    pub const fn is_noisy_copy(row: usize) -> bool {
        row % 8 == 1
    }

    /// Draws the batch of `shard` at `step`. The same arguments give the same batch.
    pub fn draw(&mut self, seed: u64, step: u64, shard: u64, arm: &Arm, recorded: &Recorded, mixture: &Mixture) {
        let mut rng = Pcg64::new(u128::from(seed) << 64 | u128::from(step), u128::from(shard) + 1);
        let rows = self.rows();
        let from_recording = ((1.0 - mixture.procedural) * rows as f64).round() as usize;
        let mut before = [[0.0, 0.0, 0.0, 1.0]; 2];
        let gimbal = Gimbal::new(arm);
        for (row, arm) in self.human.iter_mut().enumerate() {
            if Self::is_noisy_copy(row) {
                *arm = noisy(&mut rng, &before);
            } else {
                *arm = recorded.draw(&mut rng, row < from_recording, mixture);
                let has_noisy_copy = Self::is_noisy_copy(row + 1) && row < from_recording;
                if mixture.gimbal > 0.0 && has_noisy_copy && rng.random_bool(mixture.gimbal) {
                    *arm = near(&mut rng, &gimbal, arm);
                }
            }
            before = *arm;
        }
        self.posture.fill_with(|| rng.random_range(-1.0..1.0));
        for (posture, half) in self.posture.iter_mut().zip(arm.half.iter().cycle()).filter(|(_, half)| **half == 0.0) {
            *posture = *half;
        }
        self.anchor.fill_with(|| rng.random_range(0..3));
        self.shift = rng.random_range(1..rows);
        for (limbs, row) in self.human.iter().zip(self.features.as_chunks_mut::<FEATURES>().0) {
            *row = features(limbs);
        }
        for (limbs, posture) in self.robot.iter_mut().zip(self.posture.as_chunks::<ARM>().0) {
            *limbs = arm.forward(&arm.denormalised(posture));
        }
    }
}

/// Draws a procedural human left arm. The bone's azimuth is -50..130 degrees (0 is straight to the side, 90 to the
/// front). The sine of its elevation is -1..0.95. Humeral twist is +-100, elbow -3..145 and pronation +-85 degrees.
pub fn procedural(rng: &mut Pcg64) -> Limbs {
    let mut degrees = |low: f32, high: f32| rng.random_range(low..high).to_radians();
    let azimuth = degrees(-50.0, 130.0);
    let twist = degrees(-100.0, 100.0);
    let elbow = degrees(-3.0, 145.0);
    let pronation = degrees(-85.0, 85.0);
    let elevation = rng.random_range(-1.0_f32..0.95).asin();
    let upper = product(
        product(about([0.0, 0.0, 1.0], -azimuth), about([1.0, 0.0, 0.0], elevation)),
        about([0.0, 1.0, 0.0], twist),
    );
    let fore = product(product(upper, about([0.0, 0.0, 1.0], -elbow)), about([0.0, 1.0, 0.0], -pronation));
    [upper, fore]
}

/// Noise of a tracker, for each limb about each axis. It is uniform up to 0.87 degrees, which is a standard
/// deviation of half a degree.
const NOISE_RAD: f32 = 0.0151;

pub(crate) fn noisy(rng: &mut Pcg64, limbs: &Limbs) -> Limbs {
    limbs.map(|q| product(small(rng, NOISE_RAD), q))
}

pub(crate) fn near(rng: &mut Pcg64, gimbal: &Gimbal, limbs: &Limbs) -> Limbs {
    let away = small(rng, GIMBAL_SPREAD_RAD);
    gimbal.turned(limbs).map(|q| product(away, q))
}

fn jittered(rng: &mut Pcg64, limbs: &Limbs, mixture: &Mixture) -> Limbs {
    let common = small(rng, mixture.torso_jitter_rad);
    limbs.map(|q| product(product(common, small(rng, mixture.limb_jitter_rad)), q))
}

/// Returns a normally distributed number (Box and Muller).
pub(crate) fn normal(rng: &mut Pcg64) -> f64 {
    let (size, phase) = (1.0 - rng.random_range(0.0..1.0_f64), rng.random_range(0.0..TAU));
    (-2.0 * size.ln()).sqrt() * phase.cos()
}

/// Returns a random rotation of up to `bound` rad about each axis.
fn small(rng: &mut Pcg64, bound: f32) -> [f32; 4] {
    let mut half = || if bound > 0.0 { 0.5 * rng.random_range(-bound..bound) } else { 0.0 };
    let v = [half(), half(), half()];
    let scale = 1.0 / (1.0 + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    [v[0] * scale, v[1] * scale, v[2] * scale, scale]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{rotate, tests::example_arm};
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn procedural_arms_stay_inside_the_stated_ranges_and_fill_them() {
        let mut rng = Pcg64::new(1, 1);
        let (mut lowest, mut highest, mut behind, mut across) = (1.0_f32, -1.0_f32, 0, 0);
        for _ in 0..4000 {
            let [upper, fore] = procedural(&mut rng);
            let bone = rotate(upper, [0.0, 1.0, 0.0]);
            let elbow = bone.iter().zip(rotate(fore, [0.0, 1.0, 0.0])).map(|(a, b)| a * b).sum::<f32>();
            assert!(elbow >= 145_f32.to_radians().cos() - 1e-4);
            assert!(bone[2] <= 0.95 + 1e-4);
            lowest = lowest.min(bone[2]);
            highest = highest.max(bone[2]);
            behind += i32::from(bone[0] < -0.3);
            across += i32::from(bone[1] < -0.3);
        }
        assert!(lowest < -0.99 && highest > 0.94, "{lowest} {highest}");
        assert!(behind > 100 && across > 100, "{behind} {across}");
    }

    #[test]
    fn batch_depends_on_its_seed_step_and_shard_alone() {
        let recorded = Recorded { frames: vec![[[[0.0, 0.0, 0.0, 1.0]; 2]; 2]; 3] };
        let draw = |seed, step, shard| {
            let mut batch = Batch::new(16);
            batch.draw(seed, step, shard, &example_arm(), &recorded, &Mixture::default());
            batch
        };
        let first = draw(1, 5, 0);
        let again = draw(1, 5, 0);
        assert_eq!(first.features, again.features);
        assert_eq!((first.shift, &first.anchor), (again.shift, &again.anchor));
        for other in [draw(2, 5, 0), draw(1, 6, 0), draw(1, 5, 1)] {
            assert_ne!(first.features, other.features);
            assert_ne!(first.posture, other.posture);
        }
    }

    #[test]
    fn hanging_people_are_turned_to_other_gimbals_alone() {
        let hanging = about([1.0, 0.0, 0.0], -FRAC_PI_2);
        let recorded = Recorded { frames: vec![[[hanging; 2]; 2]; 3] };
        let mut sideways = example_arm();
        (sideways.axes[0], sideways.axes[1]) = ([0.0, 1.0, 0.0], [1.0, 0.0, 0.0]);
        for (arm, least, most) in [(example_arm(), 0.99, 1.0), (sideways, 0.25, 0.55)] {
            let gimbal = Gimbal::new(&arm);
            let mixture = Mixture { procedural: 0.0, gimbal: recorded.share_to_turn(&gimbal), ..Mixture::default() };
            let mut batch = Batch::new(1600);
            batch.draw(1, 1, 0, &arm, &recorded, &mixture);
            let near = |rows: &[Limbs]| rows.iter().filter(|limbs| gimbal.is_near(limbs)).count() as f64;
            let noisy_copies: Vec<Limbs> = batch.human.iter().copied().skip(1).step_by(8).collect();
            let share = near(&noisy_copies) / noisy_copies.len() as f64;
            assert!((least..=most).contains(&share), "{share}");
        }
    }

    #[test]
    fn jitter_keeps_rotations_unit_and_within_its_bounds() {
        let mut rng = Pcg64::new(3, 3);
        let mixture = Mixture { procedural: 1.0, torso_jitter_rad: 0.1, limb_jitter_rad: 0.02, ..Mixture::default() };
        for _ in 0..200 {
            let pose = procedural(&mut rng);
            let moved = jittered(&mut rng, &pose, &mixture);
            for (a, b) in pose.iter().zip(&moved) {
                assert!((b.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5);
                assert!(crate::kinematics::limb_degrees(*a, *b).to_radians() < 0.12 * 3_f32.sqrt() + 1e-3);
            }
        }
    }
}
