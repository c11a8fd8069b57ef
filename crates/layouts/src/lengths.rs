//! Gives a person in camera data the lengths that the session showed, before the frame is judged. A camera guesses depth,
//! so the lengths of bones change, while the robot follows their directions.
//!
//! ```text
//! T += clamp(t - T, -T / 10, T / 10) / n,  r += clamp(x / t - r, -r / 10, r / 10) / n,  R += (t - R) dt / 0.25 s
//! hips stay, all joints scale by T / t, elbow = shoulder + r T u, wrist = elbow + r T v
//! ```
//!
//! t is the trunk's length in this frame (hips to shoulders), x that of a bone of an arm with direction u or v. T and r
//! are robust means over the session. Both arms share the ratios r. n counts frames up to `FRAMES_MAX`. A bone that looks
//! short or long shows that the landmarker is unsure: it lowers the confidence of the joint at its end. One that is too
//! unsure to be used does not count for r. R is the trunk's length of late. If it differs from T by a quarter, the body is
//! another one: its frames are not used, and after a while its lengths are learnt.

use crate::lifter::LENGTHS;
use messages::{RawSkeleton, SMPL_JOINTS, Smpl};
use nalgebra::Vector3;

/// Frames over which the means are taken at most: ten seconds at 30 Hz. Assumption.
const FRAMES_MAX: f64 = 300.0;
/// Frames after which a mean is used: one second at 30 Hz.
const FRAMES_KNOWN: f64 = 30.0;
/// Frames of a plain mean, so that a wrong first one is forgotten.
const FRAMES_PLAIN: f64 = 10.0;
/// Largest share by which a later frame may differ from a mean, and count.
const STEP_MAX: f64 = 0.1;
/// Time over which a trunk's length counts as that of late, s. With a real landmarker it came within 0.07 of T in nine clips of
/// ten, within 0.28 in all of 48.
const RECENT_S: f64 = 0.25;
/// Share of T by which another body's trunk differs. Assumption.
const OTHER: f64 = 0.25;
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
        let step_max = if self.count > FRAMES_PLAIN { STEP_MAX * self.value } else { f64::INFINITY };
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
    /// The trunk's length of late, m, and the origin of the frame that it rests on, ns.
    recent: (f64, u64),
    /// Origin of the first frame in which the body was another one, ns. Zero while it is not.
    other_since_ns: u64,
    /// Upper arm and forearm over the trunk.
    bones: [Mean; 2],
}

impl Lengths {
    /// Lengths of upper arm and forearm over the trunk's, as a [`Lifter`](crate::Lifter) takes them. `None` until the session
    /// has shown both for a second.
    pub fn over_trunk(&self) -> Option<[f64; LENGTHS]> {
        let known = self.bones.iter().all(|mean| mean.count >= FRAMES_KNOWN);
        known.then_some(self.bones.map(|mean| mean.value))
    }

    /// Learns the lengths of a frame of SMPL-22, m, and gives it those of the session. Joints below `confidence_min` do
    /// not count. `layout` is the one that the client sent. Returns false if the body is another one: the frame then stays as it
    /// is. After `other_ns` of such frames that body's lengths are learnt. `None` if a trunk's length tells nobody from another.
    /// Never allocates or panics, whatever the bits.
    pub fn settle(&mut self, layout: u32, confidence_min: f32, other_ns: Option<u64>, frame: &mut RawSkeleton) -> bool {
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
            return true;
        }
        if let Some(other_ns) = other_ns
            && self.is_other(trunk_m, frame.header.origin.0)
        {
            if frame.header.origin.0.saturating_sub(self.other_since_ns) > other_ns {
                *self = Self { session, ..Self::default() };
            }
            return false;
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
        true
    }

    /// Adds the trunk of a frame to that of late. Returns true if it is another body's.
    fn is_other(&mut self, trunk_m: f64, origin_ns: u64) -> bool {
        let (recent_m, before_ns) = self.recent;
        let share = origin_ns.saturating_sub(before_ns) as f64 * 1e-9 / RECENT_S;
        self.recent = (recent_m + (trunk_m - recent_m) * share.min(1.0), origin_ns);
        let known = self.trunk_m.count >= FRAMES_KNOWN;
        let is_other = known && (self.recent.0 / self.trunk_m.value - 1.0).abs() > OTHER;
        self.other_since_ns = match self.other_since_ns {
            _ if !is_other => 0,
            0 => origin_ns,
            since => since,
        };
        is_other
    }
}
