//! Gives a person in camera data the lengths that the session showed, before the frame is judged. A camera guesses depth,
//! so the lengths of bones change, while the robot follows their directions.
//!
//! ```text
//! T += clamp(t - T, -T / 10, T / 10) / n,  r += clamp(x / t - r, -r / 10, r / 10) / n
//! hips stay, all joints scale by T / t, elbow = shoulder + r T u, wrist = elbow + r T v
//! ```
//!
//! t is the trunk's length in this frame (hips to shoulders), x that of a bone of an arm with direction u or v. T and r
//! are robust means over the session. Both arms share the ratios r. n counts frames up to `FRAMES_MAX`. A bone that looks
//! short or long shows that the landmarker is unsure: it lowers the confidence of the joint at its end. One that is too
//! unsure to be used does not count for r.

use messages::{RawSkeleton, SMPL_JOINTS, Smpl};
use nalgebra::Vector3;

/// Frames over which the means are taken at most: ten seconds at 30 Hz. Assumption.
const FRAMES_MAX: f64 = 300.0;
/// Largest share by which one frame may differ from a mean, and count.
const STEP_MAX: f64 = 0.1;
/// Lengths of bones over that of the trunk: confidence rises with the length up to the first one, and is zero above the
/// second. Arms have 0.51 to 0.65 (Winter, Biomechanics, 4th ed., fig. 4.1), swapped joints 0.95 and more. Below half the
/// first one a landmarker was off by 40 degrees on average, in the camera's axes.
const BONE_PER_TRUNK: [f64; 2] = [0.4, 0.9];
/// Trunks that can be measured, m.
const TRUNK_M: [f64; 2] = [0.05, 2.0];

const TRUNK: [[Smpl; 2]; 2] = [[Smpl::LeftHip, Smpl::RightHip], [Smpl::LeftShoulder, Smpl::RightShoulder]];
const ARMS: [[Smpl; 3]; 2] =
    [[Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist], [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist]];

/// A robust mean.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    value: f64,
    count: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.count = (self.count + 1.0).min(FRAMES_MAX);
        let step_max = if self.count > 1.0 { STEP_MAX * self.value } else { f64::INFINITY };
        self.value += (value - self.value).clamp(-step_max, step_max) / self.count;
    }
}

/// Confidence in a bone of this length over that of the trunk.
fn sureness(share: f64) -> f32 {
    (share / BONE_PER_TRUNK[0]) as f32
}

/// Lengths of one person.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lengths {
    session: (u64, u32, u32),
    /// Positions of the last frame. One that repeats teaches nothing, so its result repeats too.
    came: [[f32; 3]; SMPL_JOINTS],
    trunk_m: Mean,
    /// Upper arm and forearm over the trunk.
    bones: [Mean; 2],
}

impl Lengths {
    /// Learns the lengths of a frame of SMPL-22, m, and gives it those of the session. Joints below `confidence_min` do
    /// not count. `layout` is the one that the client sent. Never allocates or panics, whatever the bits.
    pub fn settle(&mut self, layout: u32, confidence_min: f32, frame: &mut RawSkeleton) {
        let session = (frame.session_nonce, frame.operator_id, layout);
        if session != self.session {
            *self = Self { session, ..Self::default() };
        }
        let mut places = [Vector3::zeros(); SMPL_JOINTS];
        let mut seen = [false; SMPL_JOINTS];
        for joint in 0..SMPL_JOINTS {
            let place = frame.positions[joint];
            places[joint] = Vector3::from(place.map(f64::from));
            seen[joint] = frame.confidence[joint] >= confidence_min && place.iter().all(|x| x.is_finite());
        }
        let [hips, shoulders] = TRUNK.map(|[left, right]| (places[left as usize] + places[right as usize]) / 2.0);
        let trunk_m = (shoulders - hips).norm();
        let is_seen = TRUNK.as_flattened().iter().all(|&joint| seen[joint as usize]);
        if !is_seen || !(TRUNK_M[0]..=TRUNK_M[1]).contains(&trunk_m) {
            return;
        }
        let repeats = frame.positions[..SMPL_JOINTS].as_flattened().iter().eq(self.came.as_flattened());
        self.came.copy_from_slice(&frame.positions[..SMPL_JOINTS]);
        let arms = ARMS.map(|arm| arm.map(|joint| joint as usize));
        let share = |[from, to]: [usize; 2]| {
            let known = seen[from] && seen[to];
            known.then(|| (places[to] - places[from]).norm() / trunk_m).filter(|share| *share <= BONE_PER_TRUNK[1])
        };
        if !repeats {
            self.trunk_m.add(trunk_m);
            for (bone, mean) in self.bones.iter_mut().enumerate() {
                let shares = arms.iter().filter_map(|arm| share([arm[bone], arm[bone + 1]]));
                shares.filter(|share| sureness(*share) >= confidence_min).for_each(|share| mean.add(share));
            }
        }
        let mut scaled = places.map(|place| hips + (place - hips) * (self.trunk_m.value / trunk_m));
        for arm in arms {
            for (bone, mean) in self.bones.iter().enumerate() {
                let [from, to] = [arm[bone], arm[bone + 1]];
                let Some(share) = share([from, to]) else {
                    // The bone's start is hidden, or the bone is too long: where it ends is not known.
                    if seen[to] {
                        frame.confidence[to] = 0.0;
                    }
                    break;
                };
                frame.confidence[to] = frame.confidence[to].min(sureness(share));
                if share > 0.0 {
                    let along = (places[to] - places[from]) / (share * trunk_m);
                    let length = if mean.count > 0.0 { mean.value } else { share };
                    scaled[to] = scaled[from] + along * (length * self.trunk_m.value);
                }
            }
        }
        for joint in (0..SMPL_JOINTS).filter(|&joint| seen[joint]) {
            frame.positions[joint] = scaled[joint].map(|x| x as f32).into();
        }
    }
}
