//! The stage: one frame of a client in, a validated person or the reason for dropping it out.

use crate::geometry::vector;
use crate::limbs::{ARMS, Hold, limbs_from_positions_rotations, torso_rotation};
use crate::plausible::chirality;
use messages::{
    HingeCalibration, LIMBS, Layout, RawSkeleton, SMPL_JOINTS, Skeleton, SkeletonLayout, Smpl, Stamp, calibration_flag,
    raw_flag,
};
use nalgebra::Vector3;

/// Bounds of a plausible person. The defaults are this project's fault table; each can be tightened or, for a noisy
/// tracker, loosened by its owner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// A frame whose origin is older than this on arrival is dropped (ns): one stale-after of `skeleton`.
    pub age_max_ns: u64,
    /// A frame whose origin lies further in the future than this is dropped (ns): two clocks of one machine agree, the
    /// rest is scheduling.
    pub future_max_ns: u64,
    /// Joints below this confidence are not used.
    pub confidence_min: f32,
    /// Largest error of a quaternion's norm that is renormalised; beyond it the frame is dropped.
    pub quaternion_error_max: f64,
    /// Largest distance of a joint from the pelvis (m): arms up is 1.3 m at 2.2 m of stature. Catches mm and cm.
    pub reach_max_m: f64,
    /// Largest coordinate (m): a large hall.
    pub coordinate_max_m: f64,
    /// Hips to shoulders (m): 0.288 of a stature of 1.2 to 2.2 m (Winter, Biomechanics, 4th ed., fig. 4.1), widened by 15 %.
    pub trunk_m: [f64; 2],
    /// Largest change of a limb's length against the session's first second (fraction).
    pub length_change_max: f64,
    /// Largest change of a limb's length from frame to frame (fraction).
    pub length_step_max: f64,
    /// Largest speed of a used joint relative to the hips (m/s); boxers reach 9 (CMU clips: 5.1 at most).
    pub speed_max_m_per_s: f64,
    /// Largest step of a used joint relative to the hips between two frames (m).
    pub step_max_m: f64,
    /// Coherent frames after a teleport before frames are accepted again.
    pub coherent_frames: u32,
    /// A payload that repeats bit for bit for this long after it had moved is a stuck tracker (ns); 0 turns it off.
    pub frozen_after_ns: u64,
    /// After a gap of this length (ns) the person may have changed: lengths are learnt and uprightness is asked for again.
    pub gap_ns: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            age_max_ns: 100_000_000,
            future_max_ns: 2_000_000,
            confidence_min: 0.5,
            quaternion_error_max: 1e-3,
            reach_max_m: 1.5,
            coordinate_max_m: 100.0,
            trunk_m: [0.29, 0.73],
            length_change_max: 0.05,
            length_step_max: 0.02,
            speed_max_m_per_s: 10.0,
            step_max_m: 0.15,
            coherent_frames: 5,
            frozen_after_ns: 200_000_000,
            gap_ns: 1_000_000_000,
        }
    }
}

macro_rules! reasons {
    ($($(#[$meta:meta])* $name:ident,)*) => {
        /// Why a frame was dropped.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(usize)]
        pub enum DropReason { $($(#[$meta])* $name,)* }

        impl DropReason {
            /// Every reason, by its number.
            pub const ALL: [Self; DROP_REASONS] = [$(Self::$name),*];

            /// Name in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name),)* }
            }
        }

        /// Number of reasons.
        pub const DROP_REASONS: usize = [$(stringify!($name)),*].len();
    };
}

reasons! {
    /// The layout is unknown.
    Layout,
    /// The count of joints is not that of the layout, or an unknown flag is set.
    Count,
    /// Left and right are swapped by a mirrored image.
    Mirrored,
    /// The frame has no origin.
    NoOrigin,
    /// The origin lies in the future.
    Future,
    /// The origin is too old.
    Old,
    /// The session nonce changed: everything is learnt anew, from the next frame on.
    SessionChanged,
    /// The operator changed: everything is learnt anew, from the next frame on.
    OperatorChanged,
    /// The origin or the sequence was seen before.
    Duplicate,
    /// The origin or the sequence went backwards.
    Backwards,
    /// A number of a used joint or of the calibration is not finite.
    NotFinite,
    /// A coordinate, a confidence or a distance from the pelvis is out of range.
    OutOfRange,
    /// A quaternion or a calibrated hinge is not a unit vector.
    NotUnit,
    /// Shoulders or hips are not seen.
    TrunkLost,
    /// The trunk's size is no person's.
    Size,
    /// The trunk does not stand upright at the start of a session: probably another up-axis.
    NotUpright,
    /// Shoulders and hips disagree on left and right, or the body is a mirror image.
    Chirality,
    /// A joint jumped, or frames after a jump are not coherent for long enough.
    Teleport,
    /// A limb's length jumped from one frame to the next.
    LengthStep,
    /// A limb's length left that of the session's first second.
    LengthChange,
    /// The payload repeats bit for bit.
    Frozen,
}

/// The sample of this tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The client's frame, copied once out of shared memory.
    pub raw: &'a RawSkeleton,
}

/// What became of the frame; exactly one of both is `Some`.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// The person; `header.origin` is the client's, the rest of the header is the shell's to fill.
    pub skeleton: Option<Skeleton>,
    /// Why there is none.
    pub drop: Option<DropReason>,
}

/// Everything remembered of one client.
#[derive(Clone, Copy, Debug)]
pub struct State {
    session: Option<Session>,
    dropped: [u64; DROP_REASONS],
    accepted: u64,
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

impl State {
    /// Nothing seen yet.
    pub const fn new() -> Self {
        Self { session: None, dropped: [0; DROP_REASONS], accepted: 0 }
    }

    /// Frames dropped so far for this reason.
    pub const fn dropped(&self, reason: DropReason) -> u64 {
        self.dropped[reason as usize]
    }

    /// Frames accepted so far.
    pub const fn accepted(&self) -> u64 {
        self.accepted
    }
}

/// One operator of one client's session.
#[derive(Clone, Copy, Debug)]
struct Session {
    nonce: u64,
    operator_id: u32,
    incarnation: u32,
    sequence: u64,
    origin: Stamp,
    hold: Hold,
    /// The last frame looked at, accepted or not.
    previous: Option<Body>,
    /// Coherent frames still missing before frames are accepted again.
    settling: u32,
    /// Sum of limb lengths over the frames learnt from.
    lengths: [f64; LIMBS],
    learnt: u32,
    learning_until: Stamp,
    chirality: f64,
    upright: bool,
    moved: bool,
    frozen_since: Stamp,
}

/// What is compared from frame to frame.
#[derive(Clone, Copy, Debug)]
struct Body {
    origin: Stamp,
    /// Relative to the middle of the hips, m, with NaN-free values; shoulders, elbows, wrists of both arms.
    arms: [[Vector3<f64>; 3]; 2],
    lengths: [Option<f64>; LIMBS],
    payload: u64,
}

impl Session {
    fn new(raw: &RawSkeleton) -> Self {
        Self {
            nonce: raw.session_nonce,
            operator_id: raw.operator_id,
            incarnation: raw.header.incarnation,
            sequence: 0,
            origin: Stamp::NONE,
            hold: Hold::default(),
            previous: None,
            settling: 0,
            lengths: [0.0; LIMBS],
            learnt: 0,
            learning_until: Stamp::NONE,
            chirality: 0.0,
            upright: false,
            moved: false,
            frozen_since: Stamp::NONE,
        }
    }
}

/// Checks one frame and turns it into a person. Never allocates, blocks, logs, reads a clock or panics, whatever the bits.
///
/// `now` is when the frame arrived, on the same clock as its origin.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    match look(config, &mut state.session, now, input.raw) {
        Ok(skeleton) => {
            state.accepted = state.accepted.saturating_add(1);
            Output { skeleton: Some(skeleton), drop: None }
        }
        Err(reason) => {
            let count = &mut state.dropped[reason as usize];
            *count = count.saturating_add(1);
            Output { skeleton: None, drop: Some(reason) }
        }
    }
}

fn look(
    config: &Config,
    session: &mut Option<Session>,
    now: Stamp,
    raw: &RawSkeleton,
) -> Result<Skeleton, DropReason> {
    check_envelope(config, now, raw)?;
    let first = session.is_none();
    let current = session.get_or_insert_with(|| Session::new(raw));
    if !first && current.nonce != raw.session_nonce {
        *current = Session::new(raw);
        return Err(DropReason::SessionChanged);
    }
    if !first && current.operator_id != raw.operator_id {
        *current = Session::new(raw);
        return Err(DropReason::OperatorChanged);
    }
    check_order(config, current, raw)?;
    let person = Person::read(config, raw)?;
    current.check(config, now, raw, &person)?;
    let limbs = limbs_from_positions_rotations(
        &person.positions,
        person.has_rotations.then_some(&person.rotations),
        &person.calibration,
        person.usable,
        &mut current.hold,
    );
    let mut skeleton = Skeleton::ZERO;
    skeleton.header.origin = raw.header.origin;
    skeleton.received = now;
    skeleton.session_nonce = raw.session_nonce;
    skeleton.operator_id = raw.operator_id;
    skeleton.flags = limbs.flags;
    skeleton.limbs = limbs.rotations;
    skeleton.positions = person.positions;
    Ok(skeleton)
}

fn check_envelope(config: &Config, now: Stamp, raw: &RawSkeleton) -> Result<(), DropReason> {
    if raw.layout != SkeletonLayout::Smpl22 as u32 {
        return Err(DropReason::Layout);
    }
    if raw.joint_count as usize != SMPL_JOINTS || raw.flags & !(raw_flag::MIRRORED | raw_flag::ROTATIONS) != 0 {
        return Err(DropReason::Count);
    }
    if raw.flags & raw_flag::MIRRORED != 0 {
        return Err(DropReason::Mirrored);
    }
    let origin = raw.header.origin;
    if origin == Stamp::NONE {
        return Err(DropReason::NoOrigin);
    }
    if origin.since(now) > config.future_max_ns {
        return Err(DropReason::Future);
    }
    if now.since(origin) > config.age_max_ns {
        return Err(DropReason::Old);
    }
    Ok(())
}

fn check_order(config: &Config, session: &mut Session, raw: &RawSkeleton) -> Result<(), DropReason> {
    let origin = raw.header.origin;
    let same_writer = session.incarnation == raw.header.incarnation;
    if origin == session.origin || (same_writer && raw.header.sequence == session.sequence) {
        return Err(DropReason::Duplicate);
    }
    if origin < session.origin || (same_writer && raw.header.sequence < session.sequence) {
        return Err(DropReason::Backwards);
    }
    let gap = session.origin != Stamp::NONE && origin.since(session.origin) > config.gap_ns;
    if gap {
        *session = Session::new(raw);
    }
    session.incarnation = raw.header.incarnation;
    session.sequence = raw.header.sequence;
    session.origin = origin;
    Ok(())
}

/// The numbers of a frame, checked one by one.
struct Person {
    positions: [[f32; 3]; SMPL_JOINTS],
    rotations: [[f32; 4]; SMPL_JOINTS],
    has_rotations: bool,
    calibration: HingeCalibration,
    /// Bit per joint.
    usable: u32,
}

impl Person {
    fn read(config: &Config, raw: &RawSkeleton) -> Result<Self, DropReason> {
        let has_rotations = raw.flags & raw_flag::ROTATIONS != 0;
        let mut person = Self {
            positions: [[0.0; 3]; SMPL_JOINTS],
            rotations: [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS],
            has_rotations,
            calibration: HingeCalibration::ZERO,
            usable: 0,
        };
        for joint in 0..SMPL_JOINTS {
            let confidence = raw.confidence[joint];
            if !confidence.is_finite() {
                return Err(DropReason::NotFinite);
            }
            if !(0.0..=1.0).contains(&confidence) {
                return Err(DropReason::OutOfRange);
            }
            if confidence < config.confidence_min {
                continue; // Whatever stands there, nobody vouches for it.
            }
            person.positions[joint] = position(config, raw.positions[joint])?;
            if has_rotations {
                person.rotations[joint] = unit_quaternion(config, raw.rotations[joint])?;
            }
            person.usable |= 1 << joint;
        }
        person.calibration = read_calibration(config, &raw.calibration)?;
        person.check_trunk(config)?;
        Ok(person)
    }

    fn has(&self, joint: usize) -> bool {
        self.usable & (1 << joint) != 0
    }

    fn at(&self, joint: usize) -> Vector3<f64> {
        vector(self.positions[joint])
    }

    fn hips(&self) -> Vector3<f64> {
        (self.at(Smpl::LeftHip as usize) + self.at(Smpl::RightHip as usize)) / 2.0
    }

    fn check_trunk(&mut self, config: &Config) -> Result<(), DropReason> {
        let trunk = [Smpl::LeftHip, Smpl::RightHip, Smpl::LeftShoulder, Smpl::RightShoulder];
        if !trunk.iter().all(|&joint| self.has(joint as usize)) {
            return Err(DropReason::TrunkLost);
        }
        let hips = self.hips();
        for joint in 0..SMPL_JOINTS {
            if self.has(joint) && (self.at(joint) - hips).norm() > config.reach_max_m {
                return Err(DropReason::OutOfRange);
            }
        }
        let shoulders = (self.at(Smpl::LeftShoulder as usize) + self.at(Smpl::RightShoulder as usize)) / 2.0;
        let trunk = (shoulders - hips).norm();
        if !(config.trunk_m[0]..=config.trunk_m[1]).contains(&trunk) {
            return Err(DropReason::Size);
        }
        Ok(())
    }

    fn body(&self, raw: &RawSkeleton) -> Body {
        let hips = self.hips();
        let arms = ARMS.map(|joints| joints.map(|joint| if self.has(joint) { self.at(joint) - hips } else { Vector3::zeros() }));
        let mut lengths = [None; LIMBS];
        for (side, [shoulder, elbow, wrist]) in ARMS.into_iter().enumerate() {
            for (limb, [from, to]) in [[shoulder, elbow], [elbow, wrist]].into_iter().enumerate() {
                if self.has(from) && self.has(to) {
                    lengths[2 * side + limb] = Some((self.at(to) - self.at(from)).norm());
                }
            }
        }
        Body { origin: raw.header.origin, arms, lengths, payload: payload_hash(self) }
    }
}

fn position(config: &Config, position: [f32; 3]) -> Result<[f32; 3], DropReason> {
    if !position.iter().all(|c| c.is_finite()) {
        return Err(DropReason::NotFinite);
    }
    if position.iter().any(|&c| f64::from(c).abs() > config.coordinate_max_m) {
        return Err(DropReason::OutOfRange);
    }
    Ok(position)
}

fn unit_quaternion(config: &Config, q: [f32; 4]) -> Result<[f32; 4], DropReason> {
    if !q.iter().all(|c| c.is_finite()) {
        return Err(DropReason::NotFinite);
    }
    let norm = q.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > config.quaternion_error_max {
        return Err(DropReason::NotUnit);
    }
    Ok(q.map(|c| (f64::from(c) / norm) as f32))
}

fn read_calibration(config: &Config, raw: &HingeCalibration) -> Result<HingeCalibration, DropReason> {
    let mut out = HingeCalibration::ZERO;
    if raw.flags & !calibration_flag::ALL != 0 {
        return Err(DropReason::Count);
    }
    for limb in 0..LIMBS {
        if raw.flags & calibration_flag::LIMB[limb] == 0 {
            continue;
        }
        let hinge = vector(raw.hinge[limb]);
        if !hinge.iter().all(|c| c.is_finite()) {
            return Err(DropReason::NotFinite);
        }
        let norm = hinge.norm();
        if (norm - 1.0).abs() > config.quaternion_error_max {
            return Err(DropReason::NotUnit);
        }
        out.hinge[limb] = raw.hinge[limb];
    }
    out.flags = raw.flags;
    out.samples = raw.samples;
    Ok(out)
}

/// FNV-1a over the bits of the used positions and rotations.
fn payload_hash(person: &Person) -> u64 {
    let positions = person.positions.iter().flatten();
    positions.chain(person.rotations.iter().flatten()).fold(0xcbf2_9ce4_8422_2325, |hash, value| {
        (hash ^ u64::from(value.to_bits())).wrapping_mul(0x0100_0000_01b3)
    })
}

impl Session {
    fn check(&mut self, config: &Config, now: Stamp, raw: &RawSkeleton, person: &Person) -> Result<(), DropReason> {
        self.check_posture(person)?;
        let body = person.body(raw);
        let previous = self.previous.replace(body);
        if let Some(previous) = previous {
            self.check_frozen(config, now, &previous, &body)?;
            let jump = steps(config, person, &previous, &body);
            if jump.is_some() {
                self.settling = config.coherent_frames;
            } else if self.settling > 0 {
                self.settling -= 1;
            }
            if let Some(reason) = jump {
                return Err(reason);
            }
            if self.settling > 0 {
                return Err(DropReason::Teleport);
            }
        }
        self.check_lengths(config, &body)
    }

    /// Upright at the start, and never a mirror image.
    fn check_posture(&mut self, person: &Person) -> Result<(), DropReason> {
        let torso = torso_rotation(&person.positions).ok_or(DropReason::Size)?;
        if !self.upright {
            // 60 degrees: no start of a session leans further, and every wrong up-axis gives 90 or 180.
            if torso[(2, 2)] < 0.5 {
                return Err(DropReason::NotUpright);
            }
            self.upright = true;
        }
        let legs = [Smpl::LeftKnee, Smpl::RightKnee, Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot];
        let evidence = chirality(&person.positions).ok_or(DropReason::Size)?;
        // Shoulders never turn by more than 90 degrees against the hips; 100 leaves room for noise.
        if evidence.sides < -0.17 {
            return Err(DropReason::Chirality);
        }
        if legs.iter().all(|&joint| person.has(joint as usize)) {
            // About one second at 60 Hz; feet may turn for a moment, not for a second.
            self.chirality += (evidence.front - self.chirality) / 60.0;
            if self.chirality < -0.5 {
                return Err(DropReason::Chirality);
            }
        }
        Ok(())
    }

    fn check_frozen(&mut self, config: &Config, now: Stamp, previous: &Body, body: &Body) -> Result<(), DropReason> {
        if body.payload != previous.payload {
            self.moved = true;
            self.frozen_since = Stamp::NONE;
            return Ok(());
        }
        if self.frozen_since == Stamp::NONE {
            self.frozen_since = now;
        }
        // A client holds its first frame until it is engaged: only what moved before can freeze.
        let frozen = config.frozen_after_ns > 0 && self.moved && now.since(self.frozen_since) >= config.frozen_after_ns;
        if frozen { Err(DropReason::Frozen) } else { Ok(()) }
    }

    fn check_lengths(&mut self, config: &Config, body: &Body) -> Result<(), DropReason> {
        if self.learning_until == Stamp::NONE {
            self.learning_until = body.origin.plus_ns(config.gap_ns);
        }
        let all: Option<[f64; LIMBS]> = match body.lengths {
            [Some(a), Some(b), Some(c), Some(d)] => Some([a, b, c, d]),
            _ => None,
        };
        let learning = self.learnt == 0 || body.origin < self.learning_until;
        for limb in 0..LIMBS {
            if let (Some(length), true) = (body.lengths[limb], self.learnt > 0) {
                let mean = self.lengths[limb] / f64::from(self.learnt);
                if (length - mean).abs() > config.length_change_max * mean {
                    return Err(DropReason::LengthChange);
                }
            }
        }
        if let (Some(lengths), true) = (all, learning) {
            for (sum, length) in self.lengths.iter_mut().zip(lengths) {
                *sum += length;
            }
            self.learnt = self.learnt.saturating_add(1);
        }
        Ok(())
    }
}

/// Whether a joint or a length jumped between two frames.
fn steps(config: &Config, person: &Person, previous: &Body, body: &Body) -> Option<DropReason> {
    let dt_s = body.origin.since(previous.origin) as f64 * 1e-9;
    // The step holds between frames of a tracker of 30 Hz or faster; after lost frames it grows with the time, and it
    // never falls below a tracker's noise when frames arrive bunched (30 mm).
    let frames = (dt_s * 30.0).max(1.0);
    let step_max_m = (config.speed_max_m_per_s * dt_s).clamp(0.03, config.step_max_m.max(0.03) * frames);
    for (side, joints) in ARMS.iter().enumerate() {
        for (i, &joint) in joints.iter().enumerate() {
            let (was, is) = (previous.arms[side][i], body.arms[side][i]);
            if person.has(joint) && was != Vector3::zeros() && (is - was).norm() > step_max_m {
                return Some(DropReason::Teleport);
            }
        }
    }
    for (was, is) in previous.lengths.iter().zip(body.lengths) {
        if let (Some(was), Some(is)) = (was, is)
            && (is - was).abs() > config.length_step_max * was
        {
            return Some(DropReason::LengthStep);
        }
    }
    None
}
