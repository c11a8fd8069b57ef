//! Faults of the content of a client's frame.

use crate::active::Active;
use crate::kinds::Frame;
use messages::{RawSkeleton, SMPL_JOINTS, Smpl, raw_flag};
use rand::{Rng, RngExt};
use rand_pcg::Pcg64Mcg;

/// Shoulder, elbow and wrist of both arms.
const ARMS: [[usize; 3]; 2] = [
    [Smpl::LeftShoulder as usize, Smpl::LeftElbow as usize, Smpl::LeftWrist as usize],
    [Smpl::RightShoulder as usize, Smpl::RightElbow as usize, Smpl::RightWrist as usize],
];

/// Alters `raw`, given the frame that was sent before it. Returns false if this frame is left alone.
pub fn alter(frame: Frame, active: &mut Active, raw: &mut RawSkeleton, last: Option<&RawSkeleton>) -> bool {
    // A stuck tracker repeats every frame. All other faults act on some frames only.
    if frame != Frame::Frozen && !active.acts() {
        return false;
    }
    match frame {
        Frame::Nan => number(active, raw, |_| f32::NAN),
        Frame::Infinite => number(active, raw, |rng| if rng.random() { f32::INFINITY } else { f32::NEG_INFINITY }),
        Frame::Denormal => {
            number(active, raw, |rng| if rng.random() { -0.0 } else { f32::from_bits(rng.random_range(1..0x7f_ffff)) })
        }
        Frame::Huge => number(active, raw, |rng| if rng.random() { f32::MAX } else { f32::MIN }),
        Frame::NotUnit => {
            let scale = if active.rng.random::<f64>() < 0.2 { 0.0 } else { active.rng.random_range(0.5..2.0) };
            raw.rotations[joint(active)].iter_mut().for_each(|x| *x *= scale);
        }
        Frame::SignFlip => raw.rotations[joint(active)].iter_mut().for_each(|x| *x = -*x),
        Frame::LimbLength
        | Frame::LimbCreep
        | Frame::Teleport
        | Frame::WalkAway
        | Frame::SidesSwapped
        | Frame::Mirrored
        | Frame::Unit
        | Frame::Axes => reshape(frame, active, raw),
        Frame::LowConfidence => {
            let joint = ARMS[active.rng.random_range(0..2)][active.rng.random_range(0..3)];
            raw.confidence[joint] = active.rng.random_range(0.0..0.5);
        }
        Frame::Frozen | Frame::Torn => return last.is_some_and(|last| repeat(frame, raw, last)),
        Frame::JointsMissing if active.episode.param.is_multiple_of(2) => {
            raw.joint_count = active.rng.random_range(0..SMPL_JOINTS as u32);
        }
        Frame::JointsMissing => {
            let side = (active.episode.param / 2 % 2) as usize;
            ARMS[side].into_iter().for_each(|joint| raw.confidence[joint] = 0.0);
        }
        Frame::OperatorChange => raw.operator_id ^= 1 + active.rng.random_range(0..3),
        Frame::Noise => noise(active, raw),
        Frame::Layout => match active.rng.random_range(0..3) {
            0 => raw.layout = active.rng.next_u32(),
            1 => raw.joint_count = active.rng.next_u32(),
            _ => raw.flags = active.rng.next_u32() | 4,
        },
        Frame::BitFlips => flip(active, raw),
    }
    true
}

fn reshape(frame: Frame, active: &mut Active, raw: &mut RawSkeleton) {
    match frame {
        Frame::LimbLength => {
            let factor = active.rng.random_range(0.5..1.5);
            stretch(raw, active.rng.random_range(0..2), factor);
        }
        Frame::LimbCreep => stretch(raw, (active.episode.param % 2) as usize, 1.0 + 0.3 * active.progress() as f32),
        Frame::Teleport => {
            let side = active.rng.random_range(0..2);
            let by: [f32; 3] = std::array::from_fn(|_| active.rng.random_range(-1.0..1.0));
            for joint in &ARMS[side][1..] {
                shift(&mut raw.positions[*joint], &by);
            }
        }
        Frame::WalkAway => {
            let far = (active.strength * 20.0 * active.progress()) as f32;
            raw.positions[..SMPL_JOINTS].iter_mut().for_each(|p| shift(p, &[far, -far, 0.0]));
        }
        Frame::SidesSwapped => {
            for (left, right) in ARMS[0].into_iter().zip(ARMS[1]) {
                raw.positions.swap(left, right);
                raw.rotations.swap(left, right);
            }
        }
        Frame::Mirrored if active.episode.param.is_multiple_of(2) => raw.flags |= raw_flag::MIRRORED,
        Frame::Mirrored => raw.positions[..SMPL_JOINTS].iter_mut().for_each(|p| p[1] = -p[1]),
        Frame::Unit => {
            let unit = [1000.0, 100.0, 39.37, 3.281, 0.001][(active.episode.param % 5) as usize];
            raw.positions[..SMPL_JOINTS].iter_mut().flatten().for_each(|x| *x *= unit);
        }
        Frame::Axes => {
            let turn = active.episode.param % 3;
            raw.positions[..SMPL_JOINTS].iter_mut().for_each(|p| match turn {
                0 => *p = [p[0], p[2], -p[1]],
                1 => *p = [p[2], p[1], -p[0]],
                _ => *p = [p[0], -p[1], -p[2]],
            });
        }
        _ => {}
    }
}

fn joint(active: &mut Active) -> usize {
    active.rng.random_range(0..SMPL_JOINTS)
}

fn number(active: &mut Active, raw: &mut RawSkeleton, draw: impl FnOnce(&mut Pcg64Mcg) -> f32) {
    let value = draw(&mut active.rng);
    let (joint, axis) = (joint(active), active.rng.random_range(0..3));
    match active.rng.random_range(0..5) {
        0 => raw.rotations[joint][axis] = value,
        1 => raw.confidence[joint] = value,
        _ => raw.positions[joint][axis] = value,
    }
}

fn shift(p: &mut [f32; 3], by: &[f32; 3]) {
    p.iter_mut().zip(by).for_each(|(x, by)| *x += by);
}

/// Makes an arm `factor` times as long.
fn stretch(raw: &mut RawSkeleton, side: usize, factor: f32) {
    let [shoulder, elbow, wrist] = ARMS[side];
    let from = raw.positions[shoulder];
    for joint in [elbow, wrist] {
        raw.positions[joint] = std::array::from_fn(|i| from[i] + factor * (raw.positions[joint][i] - from[i]));
    }
}

fn repeat(frame: Frame, raw: &mut RawSkeleton, last: &RawSkeleton) -> bool {
    // Torn: the first half of the joints comes from the previous frame.
    let joints = if frame == Frame::Frozen { SMPL_JOINTS } else { SMPL_JOINTS / 2 };
    raw.positions[..joints].copy_from_slice(&last.positions[..joints]);
    raw.rotations[..joints].copy_from_slice(&last.rotations[..joints]);
    true
}

/// Adds up to 6 cm of noise to every joint, scaled by the strength. The mean strength gives 3 cm, ten times the
/// noise of a tracker.
fn noise(active: &mut Active, raw: &mut RawSkeleton) {
    let size = (0.06 * active.strength) as f32 + 0.001;
    for p in &mut raw.positions[..SMPL_JOINTS] {
        p.iter_mut().for_each(|x| *x += active.rng.random_range(-size..size));
    }
}

/// Flips one to three bits of the payload.
fn flip(active: &mut Active, raw: &mut RawSkeleton) {
    for _ in 0..active.rng.random_range(1..4) {
        let (joint, bit) = (joint(active), 1 << active.rng.random_range(0..32));
        let x = match active.rng.random_range(0..8) {
            0 => &mut raw.confidence[joint],
            1..4 => &mut raw.rotations[joint][active.rng.random_range(0..4)],
            _ => &mut raw.positions[joint][active.rng.random_range(0..3)],
        };
        *x = f32::from_bits(x.to_bits() ^ bit);
    }
}
