//! A client that shows the person to one camera: the landmarks of layout 8, with the errors that a landmarker was seen to have.
//!
//! ```text
//! image = f (y, -z) / (d - x) + s (c + w + e),   world = (y, -z, -0.7 x) + 2 s (c + w)
//! ```
//!
//! (x, y, z) is the place of a joint from the hips, f = 1, d = 3 m, s the trunk's size. c is constant, w wanders and e is new in each image.

use messages::{RawSkeleton, SMPL_JOINTS, SkeletonLayout, Smpl};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Landmarks of one list.
const LANDMARKS: usize = 33;
/// Joints of the landmarks of arms and legs, left first.
const JOINTS: [(usize, [Smpl; 2]); 10] = [
    (11, [Smpl::LeftShoulder, Smpl::RightShoulder]),
    (13, [Smpl::LeftElbow, Smpl::RightElbow]),
    (15, [Smpl::LeftWrist, Smpl::RightWrist]),
    (17, [Smpl::LeftWrist, Smpl::RightWrist]),
    (19, [Smpl::LeftWrist, Smpl::RightWrist]),
    (21, [Smpl::LeftWrist, Smpl::RightWrist]),
    (23, [Smpl::LeftHip, Smpl::RightHip]),
    (25, [Smpl::LeftKnee, Smpl::RightKnee]),
    (27, [Smpl::LeftAnkle, Smpl::RightAnkle]),
    (31, [Smpl::LeftFoot, Smpl::RightFoot]),
];
/// Knuckles and thumb continue the forearm by this share of it.
const HAND: [(usize, f64); 3] = [(17, 0.33), (19, 0.36), (21, 0.2)];
/// Landmarks of the face, m, from the head's joint: ahead, to the left, up.
const FACE: [(usize, [f64; 3]); 5] = [
    (0, [0.11, 0.0, 0.04]),
    (2, [0.08, 0.033, 0.08]),
    (5, [0.08, -0.033, 0.08]),
    (7, [0.0, 0.075, 0.06]),
    (8, [0.0, -0.075, 0.06]),
];
/// Heels are behind the ankles, m.
const HEEL: [f64; 3] = [-0.05, 0.0, -0.05];
const DISTANCE_M: f64 = 3.0;
/// Slope of the arms' depth in the landmarker's world.
const DEPTH: f64 = 0.7;
/// Standard deviations of the errors as shares of the trunk: constant, wandering, of each image; and the share of the wandering
/// that is new in each image (0.27 s at 30 Hz).
const CONSTANT: f64 = 0.04;
const WANDERING: f64 = 0.04;
const TREMBLING: f64 = 0.015;
const RENEWED: f64 = 0.12;
/// Chances that an image begins a loss of the person, an exchange of the sides, and a guess of an arm; and the most images of each.
/// People were lost in 0 to 3 of 100 images, and the lite network exchanged the sides in two of them.
const CHANCES: [f64; 3] = [0.004, 0.002, 0.006];
const MOST: u32 = 12;

#[derive(Clone)]
pub struct Camera {
    rng: Pcg64Mcg,
    constant: [[f64; 2]; LANDMARKS],
    wandering: [[f64; 2]; LANDMARKS],
    /// Images for which the person is still lost, the sides exchanged, and an arm guessed.
    left: [u32; 3],
}

impl Camera {
    pub fn new(seed: u64) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let constant = std::array::from_fn(|_| [0, 1].map(|_| CONSTANT * normal(&mut rng)));
        Self { rng, constant, wandering: [[0.0; 2]; LANDMARKS], left: [0; 3] }
    }

    /// Replaces the person by what the landmarker finds. Returns false if it finds nobody. A frame that is no person stays.
    pub fn find(&mut self, raw: &mut RawSkeleton) -> bool {
        if raw.layout != SkeletonLayout::Smpl22 as u32 || raw.joint_count != SMPL_JOINTS as u32 {
            return true;
        }
        for (left, chance) in self.left.iter_mut().zip(CHANCES) {
            let begins = *left == 0 && self.rng.random_bool(chance);
            *left = if begins { self.rng.random_range(1..=MOST) } else { left.saturating_sub(1) };
        }
        let [lost, exchanged, guessed] = self.left.map(|left| left > 0);
        let rng = &mut self.rng;
        for wandering in self.wandering.as_flattened_mut() {
            *wandering += -RENEWED * *wandering + WANDERING * (2.0 * RENEWED).sqrt() * normal(rng);
        }
        let at = |joint: Smpl| raw.positions[joint as usize].map(f64::from);
        let hips: [f64; 3] = std::array::from_fn(|i| (at(Smpl::LeftHip)[i] + at(Smpl::RightHip)[i]) / 2.0);
        let size = at(Smpl::Neck).iter().zip(hips).map(|(neck, hip)| (neck - hip).powi(2)).sum::<f64>().sqrt();
        let mut found = RawSkeleton { layout: SkeletonLayout::MediaPipe66 as u32, joint_count: 66, ..*raw };
        for landmark in 0..LANDMARKS {
            let (joint, place) = place(raw, landmark);
            let [x, y, z]: [f64; 3] = std::array::from_fn(|i| place[i] - hips[i]);
            let wide = if guessed && (13..23).contains(&landmark) { 5.0 } else { 1.0 };
            let off: [f64; 2] =
                std::array::from_fn(|i| size * wide * (self.constant[landmark][i] + self.wandering[landmark][i]));
            let trembling = [0, 1].map(|_| size * TREMBLING * normal(rng));
            let far = DISTANCE_M - x;
            let image =
                [y / far + (off[0] + trembling[0]) / DISTANCE_M, -z / far + (off[1] + trembling[1]) / DISTANCE_M, 0.0];
            let world = [y + 2.0 * off[0], -z + 2.0 * off[1], -DEPTH * x];
            let to = if exchanged && landmark >= 11 { ((landmark - 11) ^ 1) + 11 } else { landmark };
            found.positions[to] = world.map(|value| value as f32);
            found.positions[LANDMARKS + to] = image.map(|value| value as f32);
            let seen = raw.confidence[joint as usize];
            (found.confidence[to], found.confidence[LANDMARKS + to]) = (seen, seen);
        }
        found.flags &= !messages::raw_flag::ROTATIONS;
        *raw = found;
        !lost
    }
}

/// Returns the joint of a landmark, and where the landmark is, m.
fn place(raw: &RawSkeleton, landmark: usize) -> (Smpl, [f64; 3]) {
    let at = |joint: Smpl| raw.positions[joint as usize].map(f64::from);
    let beside = |from: [f64; 3], by: [f64; 3]| std::array::from_fn(|i| from[i] + by[i]);
    let side = (landmark + 1) % 2;
    let pair = landmark - side;
    if landmark < 11 {
        let by = FACE.iter().find(|row| row.0 == landmark).map_or([0.0; 3], |row| row.1);
        return (Smpl::Head, beside(at(Smpl::Head), by));
    }
    if pair == 29 {
        let ankle = [Smpl::LeftAnkle, Smpl::RightAnkle][side];
        return (ankle, beside(at(ankle), HEEL));
    }
    let joint = JOINTS.iter().find(|row| row.0 == pair).map_or(Smpl::Head, |row| row.1[side]);
    let further = HAND.iter().find(|row| row.0 == pair).map_or(0.0, |row| row.1);
    let elbow = at([Smpl::LeftElbow, Smpl::RightElbow][side]);
    let wrist = at(joint);
    (joint, std::array::from_fn(|i| wrist[i] + further * (wrist[i] - elbow[i])))
}

/// A normally distributed number, by the sum of twelve uniform ones.
fn normal(rng: &mut Pcg64Mcg) -> f64 {
    (0..12).map(|_| rng.random_range(-0.5..0.5)).sum()
}
