//! The stage: it takes one frame of a client, and returns a validated person or the reason for dropping the frame.

use crate::clock::ClientClock;
use crate::config::{Config, DROP_REASONS, DropReason};
use crate::limbs::{limbs_against, torso_rotation_leaning};
use crate::person::Person;
use crate::reference::Calibration;
use crate::session::Session;
use messages::{
    CalibrationSource, HingeCalibration, Layout, PersonChange, RawSkeleton, SMPL_JOINTS, Skeleton, SkeletonLayout,
    Stamp, raw_flag, skeleton_flag,
};

/// Input of this tick.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The client's frame, copied once out of shared memory.
    pub raw: &'a RawSkeleton,
    /// Stored calibration of this operator, for the layout that the client sends.
    pub stored: Option<&'a Calibration>,
}

/// Result for the frame. Exactly one of both fields is `Some`.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// The person. `header.origin` is the client's on our clock. The process fills in the rest of the header.
    pub skeleton: Option<Skeleton>,
    /// Reason for dropping the frame.
    pub drop: Option<DropReason>,
}

/// 2^32 over the golden ratio. It is odd, so different counts stay different.
const PERSON_MIX: u32 = 0x9E37_79B1;

/// Decides whether the person of this frame is the one of the frames before.
#[derive(Clone, Copy, Debug, Default)]
struct Trust {
    /// Number of times that the person may have changed.
    persons: u32,
    /// Why the last of them may be somebody else.
    change: PersonChange,
    /// The client reported it since a frame was accepted.
    named: bool,
    /// Time at which a frame was last accepted without any error.
    accepted: Stamp,
    /// True if a frame since then, or an arm in one, was refused because it contradicts the person.
    contradicted: bool,
}

impl Trust {
    fn refuse(&mut self, reason: DropReason) {
        self.contradicted |= reason.contradicts();
        match reason {
            DropReason::OperatorChanged => {
                self.persons = self.persons.wrapping_add(1);
                (self.change, self.named) = (PersonChange::Operator, true);
            }
            DropReason::SessionChanged => (self.change, self.named) = (PersonChange::Session, true),
            _ => {}
        }
    }

    /// Returns true if the person may be another one than before.
    fn accept(&mut self, config: &Config, now: Stamp) -> bool {
        let unseen = self.accepted != Stamp::NONE && now.since(self.accepted) > config.distrust_after_ns;
        let doubtful = unseen && self.contradicted;
        if doubtful {
            self.persons = self.persons.wrapping_add(1);
            self.change = if self.named { self.change } else { PersonChange::Doubtful };
        }
        (self.accepted, self.contradicted, self.named) = (now, false, false);
        doubtful
    }
}

/// State for one client.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    session: Option<Session>,
    /// The newest accepted origin of any session. If the session changes and changes back, old frames stay old.
    newest: Stamp,
    clock: ClientClock,
    trust: Trust,
    dropped: [u64; DROP_REASONS],
    accepted: u64,
}

impl State {
    /// Number of frames dropped so far for this reason. An accepted frame counts once for each arm that was not used.
    pub const fn dropped(&self, reason: DropReason) -> u64 {
        self.dropped[reason as usize]
    }

    /// Drops a frame for an error that was found earlier, and counts it as [`tick`] counts its own.
    pub fn refuse(&mut self, reason: DropReason) -> Output {
        self.trust.refuse(reason);
        let count = &mut self.dropped[reason as usize];
        *count = count.saturating_add(1);
        Output { skeleton: None, drop: Some(reason) }
    }

    /// Source of the newest accepted frame's hinges.
    pub fn calibration(&self) -> CalibrationSource {
        self.session.map_or(CalibrationSource::None, |session| session.learnt_hinges.source())
    }

    /// Share of the client's newest 128 frames that never came, 1/1000.
    pub fn lost_permille(&self) -> u32 {
        self.session.map_or(0, |session| session.lost_permille())
    }

    /// Estimate of the hinges from this session's movements so far.
    pub fn online(&self) -> HingeCalibration {
        self.session.map_or(HingeCalibration::ZERO, |session| session.learnt_hinges.estimate())
    }

    /// Number of frames accepted so far.
    pub const fn accepted(&self) -> u64 {
        self.accepted
    }
}

/// Checks one frame and turns it into a person. Never allocates, blocks, logs, reads a clock or panics, whatever
/// the bits.
///
/// `now` is the arrival time of the frame, on the clock of its origin.
///
/// ```
/// use messages::{Layout, RawSkeleton, SkeletonLayout, Stamp};
/// use skeleton::{Config, DropReason, Input, State, tick};
///
/// let mut state = State::default();
/// let raw = RawSkeleton { layout: SkeletonLayout::Smpl22 as u32, joint_count: 22, ..RawSkeleton::ZERO };
/// let out = tick(&Config::default(), &mut state, Stamp(1_000_000), Input { raw: &raw, stored: None });
/// assert!(out.skeleton.is_none());
/// assert_eq!(out.drop, Some(DropReason::NoOrigin));
/// assert_eq!(state.dropped(DropReason::NoOrigin), 1);
/// ```
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    match look(config, state, now, input) {
        Ok(skeleton) => {
            state.newest = skeleton.header.origin;
            state.accepted = state.accepted.saturating_add(1);
            Output { skeleton: Some(skeleton), drop: None }
        }
        Err(reason) => state.refuse(reason),
    }
}

fn look(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Result<Skeleton, DropReason> {
    let raw = input.raw;
    check_envelope(raw)?;
    let State { session, newest, clock, trust, dropped, .. } = state;
    let known = session.is_some_and(|session| session.nonce == raw.session_nonce);
    let mut placed = if known { *clock } else { ClientClock::default() };
    let origin = placed.place(config, now, raw.header.origin)?;
    *clock = placed;
    let first = session.is_none();
    let current = session.get_or_insert_with(|| Session::new(raw));
    if !first && !known {
        *current = Session::new(raw);
        return Err(DropReason::SessionChanged);
    }
    let operator_id = current.operator_id;
    // After a gap, as after contradicting frames, the person may be another one.
    trust.contradicted |= current.check_order(config, raw)?;
    if operator_id != raw.operator_id {
        current.forget(raw);
        return Err(DropReason::OperatorChanged);
    }
    if origin <= *newest {
        return Err(DropReason::Backwards);
    }
    let mut person = Person::read(config, raw)?;
    let doubts = current.check(config, now, raw, &person)?;
    person.leave_out(doubts.map(|doubt| doubt.is_some()));
    let lengths_m = current.lengths_m();
    let reference = current.learnt_hinges.next(origin, &person, lengths_m, input.stored);
    let limbs = limbs_against(
        &person.positions,
        person.has_rotations.then_some(&person.rotations),
        &reference,
        person.usable,
        &mut current.hold,
    );
    match doubts.into_iter().flatten().next() {
        None if trust.accept(config, now) => current.learnt_hinges.forget_head(),
        None => {}
        Some(reason) => trust.refuse(reason),
    }
    for reason in doubts.into_iter().flatten() {
        dropped[reason as usize] = dropped[reason as usize].saturating_add(1);
    }
    let mut skeleton = Skeleton::ZERO;
    skeleton.header.origin = origin;
    skeleton.received = now;
    skeleton.session_nonce = raw.session_nonce;
    skeleton.operator_id = raw.operator_id ^ trust.persons.wrapping_mul(PERSON_MIX);
    skeleton.flags = limbs.flags | trust.change.flags();
    skeleton.limbs = limbs.rotations;
    skeleton.hands = limbs.hands;
    let torso = torso_rotation_leaning(&person.positions, reference.torso_lean_rad);
    let head = torso.and_then(|torso| current.learnt_hinges.head(&person, &torso));
    skeleton.head = head.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    skeleton.flags |= if head.is_some() { skeleton_flag::HEAD } else { 0 };
    skeleton.flags |= if raw.flags & raw_flag::CLUTCH != 0 { skeleton_flag::CLUTCH } else { 0 };
    for (side, closure) in messages::closure_of(raw.flags).into_iter().enumerate() {
        let Some(closure) = closure else { continue };
        skeleton.closure[side] = closure;
        skeleton.flags |= skeleton_flag::CLOSURE[side];
    }
    skeleton.positions = person.positions;
    Ok(skeleton)
}

fn check_envelope(raw: &RawSkeleton) -> Result<(), DropReason> {
    if raw.layout != SkeletonLayout::Smpl22 as u32 {
        return Err(DropReason::Layout);
    }
    let known = raw_flag::MIRRORED | raw_flag::ROTATIONS | raw_flag::CLUTCH | raw_flag::CLOSURE;
    if raw.joint_count as usize != SMPL_JOINTS || raw.flags & !known != 0 {
        return Err(DropReason::Count);
    }
    if raw.flags & raw_flag::MIRRORED != 0 {
        return Err(DropReason::Mirrored);
    }
    if raw.header.origin == Stamp::NONE {
        return Err(DropReason::NoOrigin);
    }
    Ok(())
}
