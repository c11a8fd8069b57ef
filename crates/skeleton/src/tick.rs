//! The stage: one frame of a client in, a validated person or the reason for dropping it out.

use crate::config::{Config, DROP_REASONS, DropReason};
use crate::limbs::limbs_from_positions_rotations;
use crate::person::Person;
use crate::session::Session;
use messages::{Layout, RawSkeleton, SMPL_JOINTS, Skeleton, SkeletonLayout, Stamp, raw_flag};

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
    /// The newest origin that was accepted, of whatever session: a change of session there and back makes no old frame new.
    newest: Stamp,
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
        Self { session: None, newest: Stamp::NONE, dropped: [0; DROP_REASONS], accepted: 0 }
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

/// Checks one frame and turns it into a person. Never allocates, blocks, logs, reads a clock or panics, whatever the bits.
///
/// `now` is when the frame arrived, on the same clock as its origin.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    match look(config, &mut state.session, state.newest, now, input.raw) {
        Ok(skeleton) => {
            state.newest = skeleton.header.origin;
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
    newest: Stamp,
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
    current.check_order(config, raw)?;
    if raw.header.origin <= newest {
        return Err(DropReason::Backwards);
    }
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
