//! BVH: hierarchy and channels of any rig, forward kinematics, and the mapping to SMPL-22.

use crate::canonical::Canonical;
use crate::error::BvhError;
use crate::rig::{self, Mapping, Named};
use crate::scan::{Scan, shortened};
use crate::{FRAMES_MAX, Frame, Motion, mirror};
use messages::SMPL_JOINTS;
use nalgebra::{UnitQuaternion, Vector3};

/// Most joints and end sites of a rig. The largest production rigs have about 500.
const JOINTS_MAX: usize = 2048;
/// Largest depth of a rig. A spine, an arm and a finger make 20.
const DEPTH_MAX: usize = 128;
/// Largest length of a name, characters. Every joint may carry the names of the person and of the take. Assumption.
const NAME_MAX: usize = 256;
/// Largest length (units of the file) and largest angle (degrees). Larger values indicate damage. They are 10 km
/// in millimetres, and 27,000 turns.
const NUMBER_MAX: f64 = 1e7;

/// Fewest numbers in a frame: a moving root and four limbs. Fewer cannot move a person, and would let a small
/// file claim many frames.
const CHANNELS_MIN: usize = 18;

/// Largest change of a rotation from one frame to the next, degrees. Euler angles jump by a turn, and no person turns two.
const JUMP_DEG: f64 = 720.0;

/// Shortest and longest time between two frames, s. No camera is faster than 100 kHz. A step longer than 10 s is
/// no motion. Assumption.
const FRAME_TIME_S: [f64; 2] = [1e-5, 10.0];

/// Cosine of half the largest turn of a joint in a rest pose: 0.2 degrees are rounding.
const REST_COSINE: f32 = 0.999_998_5;
/// Distance by which a joint moves against the pelvis in a jump from the first frame, m. In each of the frames that follow it
/// moves this many times less. Assumptions: exporters put a T-pose before people whose arms hang.
const REST_JUMP_M: f32 = 0.1;
const REST_JUMP: f32 = 5.0;
const REST_JUMP_FRAMES: usize = 10;

/// Quantity that a number of a frame moves: position or rotation, with its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channel {
    Position(usize),
    Rotation(usize),
}

/// A joint or an end site.
#[derive(Clone, Debug)]
pub(crate) struct Joint {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    pub(crate) offset: [f64; 3],
    pub(crate) is_end: bool,
    channels: Vec<Channel>,
}

/// Global pose of a joint in the file's frame and unit.
#[derive(Clone, Copy)]
pub(crate) struct Pose {
    pub(crate) position: Vector3<f64>,
    pub(crate) rotation: UnitQuaternion<f64>,
}

/// SMPL-22 in the file's frame and unit.
pub(crate) type RigFrame = [Pose; SMPL_JOINTS];

/// Reads the text of a BVH file. Frame 0 becomes `first` if it is a rest pose. The other frames are the motion.
pub fn parse_bvh(name: &str, text: &[u8]) -> Result<Motion, BvhError> {
    let mut motion = parse(name, text, &Named::default())?;
    // Only a check: without `mirror` the frames do not change.
    mirror::settle(&mut motion.frames, false).map_err(BvhError::Mirror)?;
    Ok(motion)
}

/// Like [`parse_bvh`], but without the check of left and right.
pub(crate) fn parse(name: &str, text: &[u8], named: &Named) -> Result<Motion, BvhError> {
    let mut scan = Scan::new(text);
    if text.trim_ascii().is_empty() {
        return Err(BvhError::Empty);
    }
    let joints = parse_hierarchy(&mut scan)?;
    let mapping = rig::map(&joints, named)?;
    scan.expect("MOTION").map_err(|error| match error {
        BvhError::Unexpected { line, found, .. } if found.eq_ignore_ascii_case("ROOT") => {
            BvhError::TooMany { line, what: "people (ROOT)", value: 2, bound: 1 }
        }
        error => error,
    })?;
    let (frame_rate_hz, frames, jump) = parse_motion(&mut scan, &joints, &mapping)?;
    let canonical = Canonical::guess(&rest_pose(&joints, &mapping), &frames, frame_rate_hz, joints[0].offset)
        .map_err(|length| BvhError::NoSize { length })?;
    let mut warnings = mapping.warnings;
    warnings.extend(canonical.warning.clone().into_iter().chain(jump));
    let guesses = canonical.guesses(warnings);
    let mut frames: Vec<Frame> = frames.iter().map(|frame| canonical.apply(frame)).collect();
    let first = is_rest(&frames).then(|| frames.remove(0));
    Ok(Motion { name: name.to_owned(), frame_rate_hz, frames, first, has_rotations: true, guesses })
}

/// The hierarchy without rotations.
fn rest_pose(joints: &[Joint], mapping: &Mapping) -> RigFrame {
    let mut poses: Vec<Pose> = Vec::with_capacity(joints.len());
    for joint in joints {
        let parent = joint.parent.map_or_else(Vector3::zeros, |parent| poses[parent].position);
        poses.push(Pose { position: parent + Vector3::from(joint.offset), rotation: UnitQuaternion::identity() });
    }
    mapping.joints.map(|joint| poses[joint])
}

/// Returns true if the first frame is a rest pose that an exporter put before the motion: no joint turns against the pelvis, or
/// the file jumps from it.
pub(crate) fn is_rest(frames: &[Frame]) -> bool {
    let [first, rest @ ..] = frames else { return false };
    let dot = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().abs();
    let step = |a: &Frame, b: &Frame| {
        let at =
            |frame: &Frame, joint: usize| Vector3::from(frame.positions[joint]) - Vector3::from(frame.positions[0]);
        (0..SMPL_JOINTS).map(|joint| (at(a, joint) - at(b, joint)).norm()).fold(0.0, f32::max)
    };
    let jump = rest.first().map_or(0.0, |next| step(first, next));
    let usual = rest.windows(2).take(REST_JUMP_FRAMES).map(|pair| step(&pair[0], &pair[1])).fold(0.0, f32::max);
    first.rotations.iter().all(|&turn| dot(turn, first.rotations[0]) > REST_COSINE)
        || jump > REST_JUMP_M.max(REST_JUMP * usual)
}

fn parse_hierarchy(scan: &mut Scan<'_>) -> Result<Vec<Joint>, BvhError> {
    scan.expect("HIERARCHY")?;
    let mut joints: Vec<Joint> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    scan.expect("ROOT")?;
    open_joint(scan, &mut joints, &mut open, false)?;
    while let Some(&current) = open.last() {
        let word = scan.expect_word("JOINT, End Site or }")?;
        match word.to_ascii_uppercase().as_slice() {
            b"JOINT" => open_joint(scan, &mut joints, &mut open, false)?,
            b"END" => open_joint(scan, &mut joints, &mut open, true)?,
            b"OFFSET" => {
                for axis in 0..3 {
                    joints[current].offset[axis] = scan.number("OFFSET", NUMBER_MAX)?;
                }
            }
            b"CHANNELS" => joints[current].channels = parse_channels(scan)?,
            b"}" => {
                open.pop();
            }
            _ => return Err(scan.unexpected(word, "JOINT, End Site, OFFSET, CHANNELS or }")),
        }
    }
    Ok(joints)
}

fn open_joint(
    scan: &mut Scan<'_>,
    joints: &mut Vec<Joint>,
    open: &mut Vec<usize>,
    is_end: bool,
) -> Result<(), BvhError> {
    let line = scan.line();
    let name = shortened(scan.rest_of_line(), NAME_MAX);
    scan.expect("{")?;
    for (what, value, bound) in [("joints", joints.len(), JOINTS_MAX), ("nested joints", open.len(), DEPTH_MAX)] {
        if value >= bound {
            return Err(BvhError::TooMany { line, what, value: value as u64 + 1, bound: bound as u64 });
        }
    }
    let parent = open.last().copied();
    open.push(joints.len());
    joints.push(Joint { name, parent, offset: [0.0; 3], is_end, channels: Vec::new() });
    Ok(())
}

fn parse_channels(scan: &mut Scan<'_>) -> Result<Vec<Channel>, BvhError> {
    let count = scan.count("CHANNELS", 0, 6)?;
    let mut channels = Vec::with_capacity(count as usize);
    for _ in 0..count {
        let word = scan.expect_word("a channel")?;
        let axis = match word.first().map(u8::to_ascii_uppercase) {
            Some(b'X') => 0,
            Some(b'Y') => 1,
            Some(b'Z') => 2,
            _ => return Err(scan.unexpected(word, "Xposition, Yrotation, ...")),
        };
        let kind = &word[1..];
        if kind.eq_ignore_ascii_case(b"position") {
            channels.push(Channel::Position(axis));
        } else if kind.eq_ignore_ascii_case(b"rotation") {
            channels.push(Channel::Rotation(axis));
        } else {
            return Err(scan.unexpected(word, "Xposition, Yrotation, ..."));
        }
    }
    Ok(channels)
}

/// The rate, the frames, and a warning if a rotation jumps.
type Moved = (f64, Vec<RigFrame>, Option<String>);

fn parse_motion(scan: &mut Scan<'_>, joints: &[Joint], mapping: &Mapping) -> Result<Moved, BvhError> {
    scan.expect_label("Frames:")?;
    let line = scan.line();
    let frames = scan.count("Frames", 2, FRAMES_MAX as u64)?;
    scan.expect("Frame")?;
    scan.expect_label("Time:")?;
    let time_line = scan.line();
    let frame_time_s = scan.any_number("Frame Time")?;
    let [low_s, high_s] = FRAME_TIME_S;
    // NaN is in no range.
    if !(low_s..=high_s).contains(&frame_time_s) {
        return Err(BvhError::FrameTime { line: time_line, value_s: frame_time_s, low_s, high_s });
    }
    let channels: usize = joints.iter().map(|joint| joint.channels.len()).sum();
    if channels < CHANNELS_MIN {
        return Err(BvhError::TooFewChannels { line, channels, bound: CHANNELS_MIN });
    }
    let begin = *scan;
    // Each number needs a digit and a space. The claim is therefore checked before memory is reserved for it.
    if frames.saturating_mul(channels as u64 * 2) > scan.rest() as u64 + 1 {
        return Err(misfit(begin, frames, channels));
    }
    let needed = mapping.needed(joints);
    let mut added = vec![false; joints.len()];
    let identity = Pose { position: Vector3::zeros(), rotation: UnitQuaternion::identity() };
    let mut poses = vec![identity; joints.len()];
    let (mut values, mut before) = (vec![0.0; channels], vec![0.0; channels]);
    let mut jump = None;
    let mut out = Vec::with_capacity(frames as usize);
    for frame in 0..frames {
        std::mem::swap(&mut values, &mut before);
        for value in &mut values {
            *value = scan.number("a number of the frame", NUMBER_MAX).map_err(|error| match error {
                BvhError::Truncated { .. } => misfit(begin, frames, channels),
                error => error,
            })?;
        }
        if frame > 0 && jump.is_none() {
            jump = jumped(joints, &before, &values).map(|text| format!("frame {frame}: {text}"));
        }
        let mut rest = values.as_slice();
        for (i, joint) in joints.iter().enumerate() {
            let parent = joint.parent.map_or(identity, |p| poses[p]);
            let numbers = rest.split_off(..joint.channels.len()).unwrap_or_default();
            if !needed[i] {
                poses[i] = parent;
                continue;
            }
            let (position, rotation) = local_pose(joint, numbers);
            let offset = Vector3::from(joint.offset);
            if frame == 0 {
                // A zero position in the first frame would make a bone of no length. Such a file writes positions
                // relative to the joint's offset.
                added[i] = joint.parent.is_some() && position == Some(Vector3::zeros()) && offset.norm() > 0.0;
            }
            let way = if added[i] { position.map(|p| p + offset) } else { position };
            poses[i] = Pose {
                position: parent.position + parent.rotation * way.unwrap_or(offset),
                rotation: parent.rotation * rotation,
            };
        }
        out.push(mapping.joints.map(|joint| poses[joint]));
    }
    if scan.word().is_some() {
        return Err(misfit(begin, frames, channels));
    }
    Ok((1.0 / frame_time_s, out, jump))
}

/// Returns why there are more or fewer numbers than the file claims. If frames stand on lines, it is the first line with another
/// count. A last line with fewer was cut.
fn misfit(mut begin: Scan<'_>, claimed: u64, channels: usize) -> BvhError {
    let line = begin.line();
    let lines = begin.lines();
    let last = lines.clone().last().map_or(line, |(line, _)| line);
    let whole = lines.clone().map(|(_, words)| words).sum::<usize>() / channels;
    let by_line = lines.clone().any(|(_, words)| words == channels);
    let odd = lines.clone().find(|&(line, words)| words > channels || words < channels && line < last);
    match odd.filter(|_| by_line) {
        Some((line, found)) => BvhError::FrameLine { line, found, channels },
        None if whole as u64 >= claimed => BvhError::Trailing { line: last, frames: claimed },
        None => BvhError::Cut { line: last, whole, claimed },
    }
}

/// Returns a sentence on the first rotation that changes between two frames by more than angles do.
fn jumped(joints: &[Joint], before: &[f64], after: &[f64]) -> Option<String> {
    let channels = joints.iter().flat_map(|joint| joint.channels.iter().map(move |channel| (&joint.name, channel)));
    let ((name, _), (before, after)) =
        channels.zip(before.iter().zip(after)).find(|((_, channel), (before, after))| {
            matches!(channel, Channel::Rotation(_)) && (*after - *before).abs() > JUMP_DEG
        })?;
    Some(format!("{name} turns from {before:?} to {after:?} degrees at once: is a number damaged?"))
}

/// Returns a joint's position, if any component is written, and its rotation. The offset supplies the missing
/// components. A position channel replaces the offset's component, because exporters write the whole translation.
/// Readers disagree here (`findings/bvh_positions.sh`). A later step guesses the meaning of the root's channels.
fn local_pose(joint: &Joint, numbers: &[f64]) -> (Option<Vector3<f64>>, UnitQuaternion<f64>) {
    let mut position = Vector3::from(joint.offset);
    let mut rotation = UnitQuaternion::identity();
    let mut moves = false;
    for (&channel, &value) in joint.channels.iter().zip(numbers) {
        match channel {
            Channel::Position(axis) => (position[axis], moves) = (value, true),
            Channel::Rotation(axis) => {
                let axis = nalgebra::Unit::new_unchecked(Vector3::ith(axis, 1.0));
                rotation *= UnitQuaternion::from_axis_angle(&axis, value.to_radians());
            }
        }
    }
    (moves.then_some(position), rotation)
}
