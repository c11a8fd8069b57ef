//! Mixes poses: upsamples slow sources, and makes seamless loops.

use crate::{Frame, Motion, RATE_MIN_HZ, RATE_UPSAMPLED_HZ};
use messages::{SMPL_PARENT, Smpl};
use nalgebra::{UnitQuaternion, Vector3};
use skeleton::slerp;

/// Speeds of the fastest wrist of a person who moves, relative to the pelvis, m/s. Boxers' fists reach 9 to 11 (Walilko et al.,
/// Br J Sports Med 39, 2005, 710).
const WRIST_M_PER_S: [f64; 2] = [0.3, 12.0];

/// Relative error of a rate from a time that is written as 0.033333 s. Also covers rounding. It adds no whole frame.
const RATE_ERROR: f64 = 1.1e-5;

/// Resamples a source below [`RATE_MIN_HZ`] to [`RATE_UPSAMPLED_HZ`]. Rotations use slerp, bones are mixed by
/// direction and length, so no limb shrinks between frames. Returns any other source unchanged.
pub fn upsample(motion: &Motion) -> Motion {
    if motion.frame_rate_hz >= RATE_MIN_HZ {
        return motion.clone();
    }
    resampled(motion, RATE_UPSAMPLED_HZ)
}

/// Number of frames of a motion of `frames` frames at `from_hz` after it is resampled to `to_hz`. The last one is not lost to
/// a time between frames that a file writes with six digits.
pub(crate) fn resampled_count(frames: usize, from_hz: f64, to_hz: f64) -> usize {
    let steps = frames.saturating_sub(1) as f64 * to_hz / from_hz;
    (steps + (RATE_ERROR * steps).min(0.5)).floor() as usize + 1
}

/// Number of frames of such a motion after [`upsample`].
pub(crate) fn upsampled_count(frames: usize, rate_hz: f64) -> usize {
    if rate_hz >= RATE_MIN_HZ || frames < 2 { frames } else { resampled_count(frames, rate_hz, RATE_UPSAMPLED_HZ) }
}

/// Returns a question about the rate if the fastest wrist is slower or faster than a person's.
pub(crate) fn doubt_of_rate(motion: &Motion) -> Option<String> {
    let wrists = [Smpl::LeftWrist, Smpl::RightWrist];
    let at = |frame: &Frame, joint: Smpl| {
        Vector3::from(frame.positions[joint as usize]) - Vector3::from(frame.positions[Smpl::Pelvis as usize])
    };
    let step = |pair: &[Frame]| wrists.map(|wrist| (at(&pair[1], wrist) - at(&pair[0], wrist)).norm());
    let mut steps: Vec<f32> = motion.frames.windows(2).flat_map(step).collect();
    // One step of a hundred may be a jump of the tracker.
    let rank = (steps.len() * 99 / 100).checked_sub(1)?;
    let fastest = f64::from(*steps.select_nth_unstable_by(rank, f32::total_cmp).1) * motion.frame_rate_hz;
    let [low, high] = WRIST_M_PER_S;
    (!(low..=high).contains(&fastest)).then(|| {
        format!(
            "the fastest wrist moves at {fastest:.1} m/s: is the rate {:.1} Hz? --frame-rate HZ changes it",
            motion.frame_rate_hz
        )
    })
}

/// Returns the same motion at `rate_hz`, as far as its frames reach. Interpolates like [`upsample`].
pub fn resampled(motion: &Motion, rate_hz: f64) -> Motion {
    let last = motion.frames.len().saturating_sub(1);
    if last == 0 || rate_hz == motion.frame_rate_hz {
        return motion.clone();
    }
    let mut out = Motion { frames: Vec::new(), guesses: motion.guesses.clone(), name: motion.name.clone(), ..*motion };
    let count = resampled_count(motion.frames.len(), motion.frame_rate_hz, rate_hz);
    let frame = |i: usize| {
        let at = i as f64 * motion.frame_rate_hz / rate_hz;
        let before = (at.floor() as usize).min(last);
        mix(&motion.frames[before], &motion.frames[(before + 1).min(last)], (at - before as f64) as f32)
    };
    out.frames = (0..count).map(frame).collect();
    out.frame_rate_hz = rate_hz;
    out
}

/// Returns a motion that can be repeated. Its last `seconds` are crossfaded, in the hips' frame, into its first
/// ones, which are cut from the beginning. The end then runs into the new beginning without a step in pose or
/// speed. A motion shorter than three times `seconds` is crossfaded over a third of its length.
pub fn loop_blend(motion: &Motion, seconds: f64) -> Motion {
    let mut out = motion.clone();
    let n = ((seconds.max(0.0) * motion.frame_rate_hz) as usize).min(motion.frames.len() / 3);
    if n == 0 {
        return out;
    }
    let tail = motion.frames.len() - n;
    out.frames = motion.frames[n..].to_vec();
    for i in 0..n {
        let t = (i + 1) as f32 / (n + 1) as f32;
        // The minimum-jerk profile. It has no step in speed or acceleration at either end.
        let weight = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        out.frames[tail - n + i] = mix(&motion.frames[tail + i], &motion.frames[i], weight);
    }
    out
}

/// Mixes `a` (t = 0) and `b` (t = 1). The pelvis moves on a line, all else in the hips' frame, bone by bone.
pub fn mix(a: &Frame, b: &Frame, t: f32) -> Frame {
    let (hips_a, hips_b) = (hips_rotation(a), hips_rotation(b));
    let hips = slerp(hips_a, hips_b, t);
    let [q_a, q_b, q] = [hips_a, hips_b, hips].map(quaternion);
    let mut out = *a;
    let hands = a.closure.into_iter().zip(b.closure);
    for (closure, (from, to)) in out.closure.iter_mut().zip(hands) {
        *closure = from.zip(to).map(|(from, to)| from + (to - from) * t).or(to);
    }
    for (joint, &parent) in SMPL_PARENT.iter().enumerate() {
        let in_hips = |q: UnitQuaternion<f64>, frame: &Frame| store(q.inverse() * quaternion(frame.rotations[joint]));
        let local = slerp(in_hips(q_a, a), in_hips(q_b, b), t);
        out.rotations[joint] = store(q * quaternion(local));
        // A joint whose parent is not seen moves on a line, like the pelvis.
        if joint == parent || !a.sees(parent) || !b.sees(parent) {
            let (from, to) = (Vector3::from(a.positions[joint]), Vector3::from(b.positions[joint]));
            out.positions[joint] = from.lerp(&to, t).into();
        } else {
            let bone = |frame: &Frame| Vector3::from(frame.positions[joint]) - Vector3::from(frame.positions[parent]);
            let (from, to) = (q_a.inverse() * bone(a).cast::<f64>(), q_b.inverse() * bone(b).cast::<f64>());
            let bone = q * turn(from, to, f64::from(t));
            out.positions[joint] = (Vector3::from(out.positions[parent]) + bone.cast::<f32>()).into();
        }
        if !a.sees(joint) || !b.sees(joint) {
            out.positions[joint] = [0.0; 3];
        }
    }
    out
}

/// Turns one bone into another along the arc. The length is interpolated.
fn turn(from: Vector3<f64>, to: Vector3<f64>, t: f64) -> Vector3<f64> {
    let length = from.norm() * (1.0 - t) + to.norm() * t;
    let (Some(a), Some(b)) = (from.try_normalize(1e-6), to.try_normalize(1e-6)) else {
        return from.lerp(&to, t);
    };
    let arc = UnitQuaternion::rotation_between(&a, &b).unwrap_or_else(|| {
        // For opposite directions, any half turn will do.
        let side = if a.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(a.cross(&side)), std::f64::consts::PI)
    });
    arc.powf(t) * a * length
}

/// Computes the hips' heading and lean from the pelvis' positions: y to the left hip, z to the first spine joint.
fn hips_rotation(frame: &Frame) -> [f32; 4] {
    let at = |joint: usize| Vector3::from(frame.positions[joint]).cast::<f64>();
    let y = at(1) - at(2);
    let z = at(3) - (at(1) + at(2)) / 2.0;
    let x = y.cross(&z);
    if x.norm() < 1e-9 {
        return [0.0, 0.0, 0.0, 1.0];
    }
    let m = nalgebra::Matrix3::from_columns(&[x.normalize(), y.normalize(), x.cross(&y).normalize()]);
    store(UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(m)))
}

fn quaternion(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [x, y, z, w] = q.map(f64::from);
    UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z))
}

fn store(q: UnitQuaternion<f64>) -> [f32; 4] {
    [q.i as f32, q.j as f32, q.k as f32, q.w as f32]
}
