//! What a page is told 60 times a second: one binary message of little-endian 32-bit floats.

use messages::{JOINTS, JointCommand, JointTarget, RobotState, SMPL_JOINTS, Skeleton, Status, deadline};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use robot::{Frames, Model, Solid, segment_distance};

/// Speed of all joints together above which a lag is measured, rad/s: an encoder's noise of 0.05 mrad is 0.25 ms then.
const MOVES_RAD_PER_S: f64 = 0.2;
/// Bodies of a robot: the base, and what each joint moves.
pub const BODIES: usize = JOINTS + 1;
/// Version of the order below; the page refuses another.
pub const VERSION: f32 = 2.0;

/// Bits of `Field::Present`.
pub mod present {
    /// There is a person.
    pub const PERSON: u32 = 1;
    /// The driver is heard.
    pub const MEASURED: u32 = 2;
    /// `retarget` is heard.
    pub const TARGET: u32 = 4;
    /// `control` is heard: its commands, and its status.
    pub const COMMAND: u32 = 8;
    /// The two points of the nearest pair are there.
    pub const PAIR: u32 = 16;
    /// The robot moves, so that its lag can be measured.
    pub const LAG: u32 = 32;
}

/// The numbers before the lists, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Field {
    /// [`VERSION`].
    Version,
    /// Since the page's server was started, or in the recording, s.
    AtS,
    /// A `Mode`.
    Mode,
    /// Bits of [`present`].
    Present,
    /// Age of the newest skeleton at control's last status, ms.
    InputAgeMs,
    /// How much after its deadline control's newest command was published, us.
    TickLateUs,
    /// Least clearance, measured, mm.
    ClearanceMm,
    /// Its pair, as in `Status::nearest_pair`.
    PairA,
    /// See `PairA`.
    PairB,
    /// Mean limb error of the target, deg.
    LimbTargetDeg,
    /// Mean limb error of the measured posture, deg.
    LimbMeasuredDeg,
    /// Speed scale, 0 to 1.
    SpeedScale,
    /// Bits of the joints that the target means.
    TargetMask,
    /// Time by which the measured joints trail the command, ms.
    LagMs,
}

/// How many numbers stand before the lists.
pub const FIELDS: usize = Field::LagMs as usize + 1;
/// Numbers of a body's pose: position in m, then the quaternion x, y, z, w.
pub const POSE: usize = 7;
/// Numbers of a frame: fields, the two points of the nearest pair (m, base), the person's joints (m, their own frame), the
/// poses of all bodies in the base frame as measured, wanted and commanded, joint positions in the same order, and the
/// measured velocities.
pub const LENGTH: usize = FIELDS + 6 + 3 * SMPL_JOINTS + 3 * BODIES * POSE + 4 * JOINTS;

/// The newest of every message; what was never heard, or not for too long, is not there.
#[derive(Clone, Copy, Debug, Default)]
pub struct LatestMessages {
    /// The person.
    pub skeleton: Option<Skeleton>,
    /// Where the arms should be.
    pub target: Option<JointTarget>,
    /// What is commanded.
    pub command: Option<JointCommand>,
    /// What is measured.
    pub state: Option<RobotState>,
    /// What control says.
    pub status: Option<Status>,
}

impl LatestMessages {
    /// Whether anybody is heard.
    pub fn is_anything(&self) -> bool {
        let Self { skeleton, target, command, state, status } = self;
        skeleton.is_some() || target.is_some() || command.is_some() || state.is_some() || status.is_some()
    }
}

/// Writes one frame at `at_s` into `out`, which is emptied first.
pub fn encode(model: &Model, frames: &mut Frames, heard: &LatestMessages, at_s: f64, out: &mut Vec<u8>) {
    let mut numbers = Vec::with_capacity(LENGTH);
    numbers.resize(FIELDS, 0.0);
    let mut bits = 0;
    let mut set = |field: Field, value: f64| numbers[field as usize] = value as f32;
    set(Field::Version, f64::from(VERSION));
    set(Field::AtS, at_s);
    if let Some(status) = &heard.status {
        set(Field::Mode, f64::from(status.mode));
        set(Field::InputAgeMs, pipeline::input_age_ms(status).unwrap_or(0.0));
        set(Field::ClearanceMm, status.clearance_measured_m * 1e3);
        set(Field::PairA, f64::from(status.nearest_pair_measured[0]));
        set(Field::PairB, f64::from(status.nearest_pair_measured[1]));
        set(Field::LimbTargetDeg, status.limb_error_target_rad.to_degrees());
        set(Field::LimbMeasuredDeg, status.limb_error_measured_rad.to_degrees());
        set(Field::SpeedScale, status.speed_scale);
    }
    if let Some(command) = &heard.command {
        bits |= present::COMMAND;
        set(Field::TickLateUs, command.header.stamp.since(deadline(command.k)) as f64 * 1e-3);
    }
    let lag_s = heard.command.zip(heard.state).and_then(|(command, state)| lag_s(&command, &state));
    if let Some(lag_s) = lag_s {
        bits |= present::LAG;
        set(Field::LagMs, lag_s * 1e3);
    }
    // A joint that no target means is drawn where it is.
    let measured = heard.state.map_or(model.home, |state| state.q_measured);
    let target = heard.target.map(|target| {
        bits |= present::TARGET;
        set(Field::TargetMask, f64::from(target.valid_mask));
        core::array::from_fn(|j| if target.valid_mask & 1 << j == 0 { measured[j] } else { target.q[j] })
    });
    bits |= if heard.skeleton.is_some() { present::PERSON } else { 0 };
    bits |= if heard.state.is_some() { present::MEASURED } else { 0 };
    let command = heard.command.map(|command| command.q);
    model.forward(&measured, frames);
    let pair = heard.status.filter(|_| heard.state.is_some()).and_then(|status| nearest(model, frames, &status));
    bits |= if pair.is_some() { present::PAIR } else { 0 };
    numbers[Field::Present as usize] = bits as f32;
    numbers.extend(pair.unwrap_or_default().iter().flat_map(|point| point.iter().map(|&x| x as f32)));
    let person = heard.skeleton.map_or([[0.0; 3]; SMPL_JOINTS], |skeleton| skeleton.positions);
    numbers.extend(person.as_flattened());
    let postures = [measured, target.unwrap_or(measured), command.unwrap_or(measured)];
    for q in &postures {
        poses(model, frames, q, &mut numbers);
    }
    let velocities = heard.state.map_or([0.0; JOINTS], |state| state.dq_measured);
    numbers.extend(postures.iter().chain([&velocities]).flatten().map(|&value| value as f32));
    out.clear();
    // What is no number is no place to draw anything.
    out.extend(numbers.iter().flat_map(|&x| if x.is_finite() { x } else { 0.0 }.to_le_bytes()));
}

/// The least-squares time by which the measured joints trail the command: sum of (q_c - q) v over the sum of v^2. None where
/// the robot hardly moves, because noise would decide then.
fn lag_s(command: &JointCommand, state: &RobotState) -> Option<f64> {
    let joints = || command.q.iter().zip(&state.q_measured).zip(&state.dq_measured);
    let speeds: f64 = joints().map(|(_, v)| v * v).sum();
    let trailed: f64 = joints().map(|((command, measured), v)| (command - measured) * v).sum();
    (speeds.sqrt() > MOVES_RAD_PER_S).then_some((trailed / speeds).max(0.0))
}

fn poses(model: &Model, frames: &mut Frames, q: &[f64; JOINTS], numbers: &mut Vec<f32>) {
    model.forward(q, frames);
    for pose in &frames.base_from_body {
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.r));
        numbers.extend(pose.t.iter().chain(turn.coords.iter()).map(|&value| value as f32));
    }
}

/// The two points that are nearest to one another, on the surfaces, m in the base frame; none where the pair is unknown or is
/// one with a box.
fn nearest(model: &Model, frames: &Frames, status: &Status) -> Option<[Vector3<f64>; 2]> {
    let [first, second] = status.nearest_pair_measured.map(|index| index as usize);
    let ends = |index: usize| {
        let capsule = model.capsules.get(index)?;
        let pose = &frames.base_from_body[capsule.body];
        Some((pose.transform_point(&capsule.a), pose.transform_point(&capsule.b), capsule.radius_m))
    };
    let (a, b, radius_m) = ends(first)?;
    if let Some((c, d, other_m)) = ends(second) {
        let near = segment_distance(&a, &b, &c, &d);
        let (p, r) = (a + (b - a) * near.s, c + (d - c) * near.t);
        let along = (r - p).try_normalize(1e-9)?;
        return Some([p + along * radius_m, r - along * other_m]);
    }
    match &model.obstacles.get(second.checked_sub(model.capsules.len())?)?.solid {
        Solid::HalfSpace { normal, offset_m } => {
            let low = if normal.dot(&a) < normal.dot(&b) { a } else { b };
            let height_m = normal.dot(&low) - offset_m;
            Some([low - normal * radius_m, low - normal * height_m])
        }
        Solid::Box { .. } => None,
    }
}
