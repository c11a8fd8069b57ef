//! Bones that change their length: estimates of networks, and joints that move. Directions move the robot, lengths do not.

use crate::{Frame, Motion};
use messages::{SMPL_JOINTS, SMPL_NAMES, SMPL_PARENT};
use nalgebra::Vector3;

/// Ends of the bones of arms and legs: knees, ankles, elbows, wrists. In the trunk a rig may have joints between ours, so that
/// their distances change.
const ENDS: [usize; 8] = [4, 5, 7, 8, 18, 19, 20, 21];

/// Bits of the joints from which the limbs are computed: hips, shoulders, elbows, wrists.
const ARMS: u32 = 0b11_1111 << 16 | 0b110;

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
    let unseen = motion.frames.iter().map(|frame| ARMS & !frame.seen()).enumerate();
    let mut unseen = unseen.filter(|(_, joints)| *joints != 0);
    let (n, joints) = unseen.next()?;
    let (n, name, more) = (n + first, SMPL_NAMES[joints.trailing_zeros() as usize], unseen.count());
    Some(format!("frame {n} and {more} more: {name} or another joint is not seen (0, 0, 0): its limbs are held"))
}

/// Returns a question about the first joint that is where no person's is. `first` is the file's number of the first frame.
pub(crate) fn doubt_of_place(motion: &Motion, first: usize) -> Option<String> {
    let apart = |a: [f32; 3], b: [f32; 3]| f64::from((Vector3::from(a) - Vector3::from(b)).norm());
    let step_m = STEP_M.max(SPEED_M_PER_S / motion.frame_rate_hz);
    motion.frames.iter().enumerate().find_map(|(n, Frame { positions, .. })| {
        let moved = apart(positions[0], motion.frames[n.saturating_sub(1)].positions[0]);
        let seen = (1..SMPL_JOINTS).filter(|joint| motion.frames[n].seen() >> joint & 1 == 1);
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
    let both = |frame: &Frame, joint: usize| {
        let ends = 1 << joint | 1 << SMPL_PARENT[joint];
        frame.seen() & ends == ends
    };
    let (mut medians, mut worst) = ([None; SMPL_JOINTS], (0.0_f32, 0));
    let mut lengths = Vec::with_capacity(frames.len());
    for joint in ENDS {
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
