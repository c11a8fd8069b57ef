//! The message that the server sends to a page 60 times a second: one binary frame of little-endian 32-bit floats.

use messages::{
    GripperState, JOINTS_MAX, JointCommand, JointTarget, RobotState, SMPL_JOINTS, Skeleton, Status, deadline,
    skeleton_flag,
};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use robot::{Frames, Model};

/// Least speed of all joints together at which a lag is measured, rad/s. At this speed the encoder noise of 0.05
/// mrad equals 0.25 ms.
const MOVES_RAD_PER_S: f64 = 0.2;
/// Version of the order below. The page rejects other versions.
pub const VERSION: f32 = 6.0;

/// Bits of `Field::Present`.
pub mod present {
    /// There is a person.
    pub const PERSON: u32 = 1;
    /// The driver's messages arrive.
    pub const MEASURED: u32 = 2;
    /// The messages of `retarget` arrive.
    pub const TARGET: u32 = 4;
    /// The messages of `control` arrive: its commands and its status.
    pub const COMMAND: u32 = 8;
    /// The arms' nearest places are valid.
    pub const PAIR: u32 = 16;
    /// The robot moves, so its lag can be measured.
    pub const LAG: u32 = 32;
    /// The newest messages are about another robot. Nothing of it is shown.
    pub const OTHER_ROBOT: u32 = 64;
    /// The person is seen by one camera without depth.
    pub const ONE_CAMERA: u32 = 128;
}

/// Fields at the start of a frame, in order. The lists follow them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Field {
    /// [`VERSION`].
    Version,
    /// Time since the server started, or position in the recording, s.
    AtS,
    /// Number of the `Mode`.
    Mode,
    /// Bits of [`present`].
    Present,
    /// Age of the newest skeleton at control's last status, ms.
    InputAgeMs,
    /// Time from its deadline to the publication of control's newest command, us.
    TickLateUs,
    /// Smallest measured clearance, mm.
    ClearanceMm,
    /// First index of its pair, as in `Status::nearest_pair`.
    PairA,
    /// Second index of the pair. See `PairA`.
    PairB,
    /// Mean limb error of the target, deg.
    LimbTargetDeg,
    /// Mean limb error of the measured posture, deg.
    LimbMeasuredDeg,
    /// Speed scale, 0 to 1.
    SpeedScale,
    /// Bit mask of the joints that the target sets.
    TargetMask,
    /// Time by which the measured joints trail the command, ms.
    LagMs,
    /// Measured closure of the left gripper, 0 to 1.
    GripLeft,
    /// The same of the right one.
    GripRight,
    /// Force between the fingers of the left gripper, N.
    ForceLeftN,
    /// The same of the right one.
    ForceRightN,
}

/// Number of fields before the lists.
pub const FIELDS: usize = Field::ForceRightN as usize + 1;
/// Number of floats in a body's pose: position in m, then the quaternion x, y, z, w.
pub const POSE: usize = 7;
/// Number of floats for the person's hands and head: for the left and the right hand, rotation and closure as in
/// `Skeleton`, then the head's rotation. A rotation that is not known is zero, and so is a closure.
pub const TURNS: usize = 14;
/// Number of floats in a frame of a robot with `count` joints. The fields come first. Then, for each arm, the place that
/// is nearest to something and the place there (m, base frame). Then the person's joints (m, their own frame), hands and
/// head ([`TURNS`]). Then the poses of all bodies in the base frame: measured, target, commanded. Then the joint positions
/// in the same order, and the measured velocities. A robot has one body per joint, and its base.
pub const fn length(count: usize) -> usize {
    FIELDS + 12 + 3 * SMPL_JOINTS + TURNS + 3 * (count + 1) * POSE + 4 * count
}

/// Newest message of every kind. A message is `None` if it never arrived, or if the last one is too old.
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs, reason = "the names say it")]
pub struct LatestMessages {
    pub skeleton: Option<Skeleton>,
    pub target: Option<JointTarget>,
    pub command: Option<JointCommand>,
    pub state: Option<RobotState>,
    pub status: Option<Status>,
}

impl LatestMessages {
    /// Returns true if any message is present.
    pub fn is_anything(&self) -> bool {
        let Self { skeleton, target, command, state, status } = self;
        skeleton.is_some() || target.is_some() || command.is_some() || state.is_some() || status.is_some()
    }

    /// Removes what is about another robot than `model`: its joints mean something else. Returns true if there was
    /// anything.
    fn without_other_robot(&self, model: &Model) -> (Self, bool) {
        let robots = [
            self.target.as_ref().map(|target| target.robot),
            self.command.as_ref().map(|command| command.robot),
            self.state.as_ref().map(|state| state.robot),
        ];
        match robots.iter().flatten().any(|robot| *robot != model.id()) {
            true => (Self { skeleton: self.skeleton, ..Self::default() }, true),
            false => (*self, false),
        }
    }
}

/// Writes one frame at `at_s` into `out`. Clears `out` first.
pub fn encode(model: &Model, frames: &mut Frames, heard: &LatestMessages, at_s: f64, out: &mut Vec<u8>) {
    let (heard, is_other) = heard.without_other_robot(model);
    let mut numbers = Vec::with_capacity(length(model.count));
    numbers.resize(FIELDS, 0.0);
    let mut bits = if is_other { present::OTHER_ROBOT } else { 0 };
    let mut set = |field: Field, value: f64| numbers[field as usize] = value as f32;
    set(Field::Version, f64::from(VERSION));
    set(Field::AtS, at_s);
    if let Some(status) = &heard.status {
        set(Field::Mode, f64::from(status.mode));
        set(Field::InputAgeMs, explain::input_age_ms(status).unwrap_or(0.0));
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
    if let Some(state) = &heard.state {
        let GripperState { closure, force_n, .. } = state.grippers_measured;
        set(Field::GripLeft, closure[0]);
        set(Field::GripRight, closure[1]);
        set(Field::ForceLeftN, force_n[0]);
        set(Field::ForceRightN, force_n[1]);
    }
    // A joint without a target is drawn where it is.
    let measured = heard.state.map_or(model.home, |state| state.q_measured);
    let target = heard.target.map(|target| {
        bits |= present::TARGET;
        set(Field::TargetMask, f64::from(target.valid_mask));
        core::array::from_fn(|j| if target.valid_mask & 1 << j == 0 { measured[j] } else { target.q[j] })
    });
    bits |= heard.skeleton.map_or(0, |person| match person.flags & skeleton_flag::ONE_CAMERA {
        0 => present::PERSON,
        _ => present::PERSON | present::ONE_CAMERA,
    });
    bits |= if heard.state.is_some() { present::MEASURED } else { 0 };
    let command = heard.command.map(|command| command.q);
    model.forward(&measured, frames);
    let near = heard.state.map_or_else(Default::default, |_| nearest(model, frames));
    bits |= if heard.state.is_some() { present::PAIR } else { 0 };
    numbers[Field::Present as usize] = bits as f32;
    numbers.extend(near.as_flattened().iter().flat_map(|point| point.iter().map(|&x| x as f32)));
    let person = heard.skeleton.map_or([[0.0; 3]; SMPL_JOINTS], |skeleton| skeleton.positions);
    numbers.extend(person.as_flattened());
    numbers.extend(heard.skeleton.as_ref().map_or([0.0; TURNS], turns));
    let postures = [measured, target.unwrap_or(measured), command.unwrap_or(measured)];
    for q in &postures {
        poses(model, frames, q, &mut numbers);
    }
    let velocities = heard.state.map_or([0.0; JOINTS_MAX], |state| state.dq_measured);
    let own = postures.iter().chain([&velocities]).flat_map(|all| &all[..model.count]);
    numbers.extend(own.map(|&value| value as f32));
    out.clear();
    // NaN and infinite values become 0, because nothing can be drawn there.
    out.extend(numbers.iter().flat_map(|&x| if x.is_finite() { x } else { 0.0 }.to_le_bytes()));
}

fn turns(skeleton: &Skeleton) -> [f32; TURNS] {
    let known = |bit: u32| if skeleton.flags & bit == 0 { 0.0 } else { 1.0 };
    let mut turns = [0.0; TURNS];
    for side in 0..2 {
        let (hand, closure) = (known(skeleton_flag::HAND[side]), known(skeleton_flag::CLOSURE[side]));
        turns[5 * side..][..4].copy_from_slice(&skeleton.hands[side].map(|x| x * hand));
        turns[5 * side + 4] = skeleton.closure[side] * closure;
    }
    turns[10..].copy_from_slice(&skeleton.head.map(|x| x * known(skeleton_flag::HEAD)));
    turns
}

/// Returns the least-squares time by which the measured joints trail the command, s: the sum of (q_c - q) v over
/// the sum of v^2. `None` if the robot hardly moves, because noise would dominate then.
fn lag_s(command: &JointCommand, state: &RobotState) -> Option<f64> {
    let joints = || command.q.iter().zip(&state.q_measured).zip(&state.dq_measured);
    let speeds: f64 = joints().map(|(_, v)| v * v).sum();
    let trailed: f64 = joints().map(|((command, measured), v)| (command - measured) * v).sum();
    (speeds.sqrt() > MOVES_RAD_PER_S).then_some((trailed / speeds).max(0.0))
}

fn poses(model: &Model, frames: &mut Frames, q: &[f64; JOINTS_MAX], numbers: &mut Vec<f32>) {
    model.forward(q, frames);
    for pose in &frames.base_from_body[..=model.count] {
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.r));
        numbers.extend(pose.t.iter().chain(turn.coords.iter()).map(|&value| value as f32));
    }
}

/// Returns two places for each arm, m in the base frame: the one on its surface that is nearest to something, and the one
/// there. Zeros if nothing is checked.
fn nearest(model: &Model, frames: &Frames) -> [[Vector3<f64>; 2]; 2] {
    [0, 1].map(|side| {
        let near = model.nearest_to_arm(frames, side);
        near.map_or([Vector3::zeros(); 2], |near| [near.from, near.from + near.towards * near.clearance_m])
    })
}
