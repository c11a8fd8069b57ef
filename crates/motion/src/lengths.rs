//! Bones that change their length: estimates of networks, and joints that move. Directions move the robot, lengths do not.

use crate::{Frame, Motion};
use messages::{SMPL_JOINTS, SMPL_NAMES, SMPL_PARENT, Smpl};
use nalgebra::Vector3;

/// Ends of the bones of arms and legs. In the trunk a rig may have joints between ours, so that their distances change.
#[rustfmt::skip]
const ENDS: [Smpl; 8] = [
    Smpl::LeftKnee, Smpl::RightKnee, Smpl::LeftAnkle, Smpl::RightAnkle,
    Smpl::LeftElbow, Smpl::RightElbow, Smpl::LeftWrist, Smpl::RightWrist,
];

/// Joints from which the arms' limbs are computed.
#[rustfmt::skip]
const ARMS: [Smpl; 8] = [
    Smpl::LeftHip, Smpl::RightHip, Smpl::LeftShoulder, Smpl::RightShoulder,
    Smpl::LeftElbow, Smpl::RightElbow, Smpl::LeftWrist, Smpl::RightWrist,
];

/// Change of a bone's length up to which it counts as constant: a fifth of what `ingest` refuses.
const CONSTANT: f32 = 0.01;

/// Largest distance of a joint from the pelvis, statures: twice that of a raised hand. Assumption.
const REACH: f64 = 1.5;
/// Largest step of the pelvis between two frames, m, and its largest speed, m/s. Assumptions: twice a sprinter's, or a jump of the
/// tracker.
const STEP_M: f64 = 2.0;
const SPEED_M_PER_S: f64 = 25.0;

/// Returns a sentence on the frames that do not see every joint of trunk and arms. `first` is the file's number of the first frame.
pub(crate) fn doubt_of_sight(motion: &Motion, first: usize) -> Option<String> {
    let unseen = |frame: &Frame| ARMS.into_iter().find(|&joint| !frame.sees(joint as usize));
    let mut frames = motion.frames.iter().enumerate().filter_map(|(n, frame)| Some((n + first, unseen(frame)?)));
    let (n, joint) = frames.next()?;
    let (name, more) = (SMPL_NAMES[joint as usize], frames.count());
    Some(format!("frame {n} and {more} more: {name} or another joint is not seen (0, 0, 0): its limbs are held"))
}

/// Returns a question about the first joint that is where no person's is. `first` is the file's number of the first frame.
pub(crate) fn doubt_of_place(motion: &Motion, first: usize) -> Option<String> {
    let apart = |a: [f32; 3], b: [f32; 3]| f64::from((Vector3::from(a) - Vector3::from(b)).norm());
    let step_m = STEP_M.max(SPEED_M_PER_S / motion.frame_rate_hz);
    motion.frames.iter().enumerate().find_map(|(n, frame @ Frame { positions, .. })| {
        let moved = apart(positions[0], motion.frames[n.saturating_sub(1)].positions[0]);
        let seen = (1..SMPL_JOINTS).filter(|&joint| frame.sees(joint));
        let out = seen.map(|joint| (joint, apart(positions[joint], positions[0])));
        let place = match out.clone().find(|(_, reach)| *reach > REACH * motion.guesses.stature_m) {
            _ if moved > step_m => format!("the pelvis moves by {moved:.1} m"),
            Some((joint, reach)) => format!("{} is {reach:.1} m from the pelvis", SMPL_NAMES[joint]),
            None => return None,
        };
        Some(format!("frame {}: {place}: is a number damaged?", n + first))
    })
}

/// Gives every bone of arms and legs its median length m, if one of them changes by more than 1 %:
///
/// ```text
/// p_j <- p_parent + m_j (p_j - p_parent) / |p_j - p_parent|
/// ```
///
/// Directions stay, and what a bone carries moves with it. Returns a warning with the largest change.
pub(crate) fn even(frames: &mut [Frame]) -> Option<String> {
    let bone = |frame: &Frame, joint: usize| {
        Vector3::from(frame.positions[joint]) - Vector3::from(frame.positions[SMPL_PARENT[joint]])
    };
    let both = |frame: &Frame, joint: usize| frame.sees(joint) && frame.sees(SMPL_PARENT[joint]);
    let (mut medians, mut worst) = ([None; SMPL_JOINTS], (0.0_f32, 0));
    let mut lengths = Vec::with_capacity(frames.len());
    for joint in ENDS.map(|end| end as usize) {
        lengths.clear();
        lengths.extend(frames.iter().filter(|frame| both(frame, joint)).map(|frame| bone(frame, joint).norm()));
        let middle = lengths.len() / 2;
        if lengths.is_empty() {
            continue;
        }
        let median = *lengths.select_nth_unstable_by(middle, f32::total_cmp).1;
        medians[joint] = Some(median);
        let change = lengths.iter().map(|length| (length - median).abs()).fold(0.0, f32::max) / median.max(1e-6);
        if change > worst.0 {
            worst = (change, joint);
        }
    }
    let (change, joint) = worst;
    if change <= CONSTANT {
        return None;
    }
    for frame in frames {
        let old = *frame;
        for joint in (1..SMPL_JOINTS).filter(|&joint| both(&old, joint)) {
            let measured = bone(&old, joint);
            // A bone without length has no direction to keep.
            let scaled = medians[joint].and_then(|median| Some(measured.try_normalize(1e-6)? * median));
            let parent = Vector3::from(frame.positions[SMPL_PARENT[joint]]);
            frame.positions[joint] = (parent + scaled.unwrap_or(measured)).into();
        }
    }
    let name = SMPL_NAMES[joint];
    Some(format!("limbs change their lengths ({name} by up to {:.0} %): uses the median of each", 100.0 * change))
}
