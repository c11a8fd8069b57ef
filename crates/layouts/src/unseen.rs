//! Marks of joints that a sender does not see. They cost what hangs on the joint its confidence, and nothing else.
//!
//! Trackers send NaN, or zeros in place of a position or a quaternion. Nobody has another joint exactly at the origin than the
//! pelvis, which is the origin of many data.

use crate::map::{Map, NONE};
use messages::{RawSkeleton, Smpl, raw_flag};

/// Joints of each arm from the trunk on. An unknown rotation of one moves those after the shoulder.
const ARMS: [[Smpl; 4]; 2] = [
    [Smpl::LeftCollar, Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist],
    [Smpl::RightCollar, Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist],
];
/// First joint of an arm that an unknown rotation moves.
const ELBOW: usize = 2;
/// Joints whose local rotations turn both arms.
const TRUNK: [Smpl; 4] = [Smpl::Pelvis, Smpl::Spine1, Smpl::Spine2, Smpl::Spine3];

/// Takes the confidence of the client's joints that are marked as not seen. A marked rotation becomes the identity.
pub(crate) fn settle(map: &Map, raw: &mut RawSkeleton) {
    let (turns, local) = (raw.flags & raw_flag::ROTATIONS != 0, raw.flags & raw_flag::LOCAL != 0);
    let identity = if map.w_first { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 0.0, 0.0, 1.0] };
    for joint in 0..map.joints {
        let (place, turn) = (raw.positions[joint], raw.rotations[joint]);
        let is_pelvis = usize::from(map.from[Smpl::Pelvis as usize][0]) == joint;
        let is_placed = place.iter().all(|x| x.is_finite()) && (is_pelvis || place != [0.0; 3]);
        // Of local rotations, only the pelvis has a position.
        if raw.confidence[joint].is_nan() || !is_placed && (is_pelvis || !local) {
            raw.confidence[joint] = 0.0;
        }
        if turns && (turn == [0.0; 4] || turn.iter().any(|x| !x.is_finite())) {
            raw.rotations[joint] = identity;
            leave(map, raw, joint, local);
        }
    }
}

/// Takes the confidence of what an unknown rotation of this joint moves.
fn leave(map: &Map, raw: &mut RawSkeleton, joint: usize, local: bool) {
    let is = |smpl: &Smpl| usize::from(map.from[*smpl as usize][0]) == joint;
    for arm in &ARMS {
        let Some(first) = arm.iter().position(is) else { continue };
        for moved in &arm[first.max(ELBOW)..] {
            let moved = map.from[*moved as usize][0];
            if moved != NONE {
                raw.confidence[usize::from(moved)] = 0.0;
            }
        }
    }
    // The robot's head follows the head's own rotation, which a local neck turns.
    if is(&Smpl::Head) || local && is(&Smpl::Neck) {
        let head = map.from[Smpl::Head as usize][0];
        if head != NONE {
            raw.confidence[usize::from(head)] = 0.0;
        }
    }
    if local && (TRUNK.iter().any(is) || map.from.iter().all(|from| usize::from(from[0]) != joint)) {
        raw.confidence[joint] = 0.0;
    }
}
