//! State of one operator of one client, and the checks from frame to frame.

use crate::config::{Config, DropReason};
use crate::limbs::{ARMS, Hold};
use crate::person::Person;
use crate::plausible::{Chirality, chirality, stands};
use crate::reference::Learnt;
use crate::steps::{Body, Part, Which};
use messages::{LIMBS, RawSkeleton, SMPL_JOINTS, Smpl, Stamp, comes_after};

/// Time over which the evidence on left and right is averaged, s. Dancers turn shoulders and feet against the hips
/// for a moment (CMU 005_16). A mirrored tracker does so always.
const CHIRALITY_S: f64 = 0.5;
/// Time without a frame after which the evidence on left and right restarts, ns: a period at 20 Hz, and half of
/// one for jitter. A jump in that time may be a swap of the sides.
const UNSEEN_NS: u64 = 75_000_000;

/// Reason for which each arm of a used frame is not used.
pub(crate) type Doubts = [Option<DropReason>; 2];

/// One operator of one client's session.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Session {
    pub(crate) nonce: u64,
    pub(crate) operator_id: u32,
    incarnation: u32,
    sequence: u64,
    /// The newest 128 numbers of frames, the newest in bit 0: 1 came, 0 did not. And how many numbers there were, up to 128.
    came: u128,
    numbers: u32,
    origin: Stamp,
    pub(crate) hold: Hold,
    pub(crate) learnt_hinges: Learnt,
    /// The last checked frame, accepted or not.
    previous: Option<Body>,
    trunk: Part,
    arms: [Part; 2],
    /// Sums of limb lengths over the learnt frames.
    lengths: [f64; LIMBS],
    learnt: u32,
    learning_until: Stamp,
    /// Time since which lengths have been refused without a break.
    lengths_refused_since: Stamp,
    /// Low-passed evidence on left and right, and the time of its last update.
    chirality: Option<Chirality>,
    posture_at: Stamp,
    upright: bool,
    /// Hash of the last frame that was otherwise right. An arm's hash is that of its last right frame.
    payload: Option<Payload>,
    moved: bool,
    frozen_since: Stamp,
}

impl Session {
    pub(crate) fn new(raw: &RawSkeleton) -> Self {
        let (nonce, operator_id, incarnation) = (raw.session_nonce, raw.operator_id, raw.header.incarnation);
        Self { nonce, operator_id, incarnation, ..Self::default() }
    }
}

impl Session {
    /// Forgets the person, but not which frames were received.
    pub(crate) fn forget(&mut self, raw: &RawSkeleton) {
        let Self { sequence, came, numbers, origin, .. } = *self;
        *self = Self { sequence, came, numbers, origin, ..Self::new(raw) };
    }

    /// Refuses frames that were received before. Forgets the person after a gap, and then returns true.
    pub(crate) fn check_order(&mut self, config: &Config, raw: &RawSkeleton) -> Result<bool, DropReason> {
        let origin = raw.header.origin;
        let same_writer = self.origin != Stamp::NONE && self.incarnation == raw.header.incarnation;
        if origin == self.origin || (same_writer && raw.header.sequence == self.sequence) {
            return Err(DropReason::Duplicate);
        }
        if origin < self.origin || (same_writer && !comes_after(raw.header.sequence, self.sequence)) {
            return Err(DropReason::Backwards);
        }
        let gap = self.origin != Stamp::NONE && origin.since(self.origin) > config.gap_ns;
        if gap {
            self.forget(raw);
        }
        self.note_number(if same_writer { raw.header.sequence.wrapping_sub(self.sequence) } else { 1 });
        self.incarnation = raw.header.incarnation;
        self.sequence = raw.header.sequence;
        self.origin = origin;
        Ok(gap)
    }

    /// Notes a frame whose number is `further` than that of the one before.
    fn note_number(&mut self, further: u64) {
        let further = u32::try_from(further).unwrap_or(u32::MAX);
        self.came = self.came.checked_shl(further).unwrap_or(0) | 1;
        self.numbers = self.numbers.saturating_add(further).min(u128::BITS);
    }

    /// Returns the share of the newest numbers whose frames did not come, 1/1000.
    pub(crate) fn lost_permille(&self) -> u32 {
        let lost = self.numbers.saturating_sub(self.came.count_ones());
        (1000 * lost).checked_div(self.numbers).unwrap_or(0)
    }

    /// Checks a frame against the previous ones. An error in one arm concerns that arm only: the frame is used
    /// without it, and the result gives the reason.
    pub(crate) fn check(
        &mut self,
        config: &Config,
        now: Stamp,
        raw: &RawSkeleton,
        person: &Person,
    ) -> Result<Doubts, DropReason> {
        let since = self.previous.map(|previous| raw.header.origin.since(previous.origin));
        if since.is_some_and(|since| since > UNSEEN_NS) {
            self.chirality = None;
        }
        let body = Body::read(raw, person);
        if self.previous.is_some_and(|previous| body.across().dot(&previous.across()) <= 0.0) {
            // Nobody turns by a quarter between two frames. The two sides may have been swapped.
            self.chirality = None;
        }
        let judged = std::mem::replace(&mut self.posture_at, raw.header.origin);
        self.check_posture(person, raw.header.origin.since(judged))?;
        let (mut trunk, mut doubts) = (None, Doubts::default());
        if let Some(previous) = self.previous.replace(body) {
            trunk = self.trunk.judge(config, Which::Trunk, person, &previous, &body);
            for (side, (doubt, arm)) in doubts.iter_mut().zip(&mut self.arms).enumerate() {
                *doubt = arm.judge(config, Which::Arm(side), person, &previous, &body);
            }
        }
        if let Some(reason) = trunk {
            // The two sides may have been swapped.
            self.chirality = None;
            self.used(&body, false, [false; 2]);
            return Err(reason);
        }
        let mut steady = body;
        for side in (0..2).filter(|&side| doubts[side].is_some()) {
            steady.lengths[2 * side..2 * side + 2].fill(None);
        }
        for (doubt, changed) in doubts.iter_mut().zip(self.check_lengths(config, &steady)) {
            *doubt = doubt.or(changed);
        }
        let used = doubts.map(|doubt| doubt.is_none());
        self.used(&body, true, used);
        // Without a visible, right arm there is nothing to follow.
        let seen = [0, 1].map(|side| ARMS[side].iter().all(|&joint| person.has(joint)));
        let any = (0..2).any(|side| seen[side] && used[side]);
        if let (Some(reason), false) = (doubts.into_iter().flatten().next(), any) {
            return Err(reason);
        }
        self.check_frozen(config, now, &payload(person), used)?;
        Ok(doubts)
    }

    fn used(&mut self, body: &Body, trunk: bool, arms: [bool; 2]) {
        self.trunk.used(body, trunk);
        for (part, used) in self.arms.iter_mut().zip(arms) {
            part.used(body, used);
        }
    }

    /// Requires a person who stands or sits at the start, and never a mirror image.
    fn check_posture(&mut self, person: &Person, since_ns: u64) -> Result<(), DropReason> {
        if !self.upright {
            let sees_legs = [Smpl::LeftAnkle, Smpl::RightAnkle].iter().all(|&joint| person.has(joint as usize));
            if !stands(&person.positions, sees_legs).ok_or(DropReason::Size)? {
                return Err(DropReason::NotUpright);
            }
            self.upright = true;
        }
        let now = chirality(&person.positions).ok_or(DropReason::Size)?;
        let legs =
            [Smpl::LeftKnee, Smpl::RightKnee, Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot];
        let sees_legs = legs.iter().all(|&joint| person.has(joint as usize));
        // Legs that are not seen say nothing new.
        let known = self.chirality.unwrap_or_default();
        let (front, weight) = if sees_legs { (now.front, now.weight) } else { (known.front, known.weight) };
        let now = Chirality { sides: now.sides, front, weight };
        let share = (since_ns as f64 * 1e-9 / CHIRALITY_S).min(1.0);
        let mean = self.chirality.map_or(now, |was| was.toward(now, share));
        self.chirality = Some(mean);
        if mean.is_swapped() || mean.is_mirrored() { Err(DropReason::Chirality) } else { Ok(()) }
    }

    /// Compares with the last frame that was otherwise right. A refused frame does not prove that the tracker
    /// runs, and neither does an arm that is not used.
    fn check_frozen(
        &mut self,
        config: &Config,
        now: Stamp,
        payload: &Payload,
        used: [bool; 2],
    ) -> Result<(), DropReason> {
        let last = self.payload.unwrap_or(*payload);
        let arms = [0, 1].map(|side| if used[side] { payload.arms[side] } else { last.arms[side] });
        let seen = Payload { rest: payload.rest, arms };
        let known = self.payload.replace(seen).is_some();
        if !known || last != seen {
            self.moved |= known;
            self.frozen_since = Stamp::NONE;
            return Ok(());
        }
        if self.frozen_since == Stamp::NONE {
            self.frozen_since = now;
        }
        let still_ns = now.since(self.frozen_since);
        if still_ns > config.learning_ns {
            // By now everything downstream has stopped. A client may hold a frame until it is engaged again.
            self.moved = false;
        }
        // A client holds its first frame until it is engaged. So only a payload that moved before can freeze.
        let frozen = config.frozen_after_ns > 0 && self.moved && still_ns >= config.frozen_after_ns;
        if frozen { Err(DropReason::Frozen) } else { Ok(()) }
    }

    /// Lengths of the limbs in the newest frame, m, where they are visible.
    pub(crate) fn lengths_m(&self) -> [Option<f64>; LIMBS] {
        self.previous.map_or([None; LIMBS], |body| body.lengths)
    }

    /// Mean length over the learnt frames, m.
    fn mean_length(&self, limb: usize) -> Option<f64> {
        (self.learnt > 0).then(|| self.lengths[limb] / f64::from(self.learnt))
    }

    fn check_lengths(&mut self, config: &Config, body: &Body) -> Doubts {
        if self.learning_until == Stamp::NONE {
            self.learning_until = body.origin.plus_ns(config.learning_ns);
        }
        let all: Option<[f64; LIMBS]> = match body.lengths {
            [Some(a), Some(b), Some(c), Some(d)] => Some([a, b, c, d]),
            _ => None,
        };
        let learning = self.learnt == 0 || body.origin < self.learning_until;
        let changed = |limb: usize| match (body.lengths[limb], self.mean_length(limb)) {
            (Some(length), Some(mean)) => (length - mean).abs() > config.length_change_max * mean,
            _ => false,
        };
        let doubts =
            [0, 1].map(|side| (changed(2 * side) || changed(2 * side + 1)).then_some(DropReason::LengthChange));
        if doubts != Doubts::default() {
            self.refuse_lengths(config, body.origin);
            return doubts;
        }
        self.lengths_refused_since = Stamp::NONE;
        if let (Some(lengths), true) = (all, learning) {
            for (sum, length) in self.lengths.iter_mut().zip(lengths) {
                *sum += length;
            }
            self.learnt = self.learnt.saturating_add(1);
        }
        doubts
    }
}

impl Session {
    /// Learns again after every frame of `learning_ns` was refused. Either the learnt lengths were wrong, or the
    /// person changed. Nothing downstream has followed for as long.
    fn refuse_lengths(&mut self, config: &Config, origin: Stamp) {
        if self.lengths_refused_since == Stamp::NONE {
            self.lengths_refused_since = origin;
        } else if origin.since(self.lengths_refused_since) >= config.learning_ns {
            self.learnt = 0;
            self.lengths = [0.0; LIMBS];
            self.learning_until = Stamp::NONE;
            self.lengths_refused_since = Stamp::NONE;
        }
    }
}

/// FNV-1a over the bits of the used positions and rotations of some joints.
fn hash(person: &Person, joints: impl Iterator<Item = usize> + Clone) -> u64 {
    let positions = joints.clone().flat_map(|joint| person.positions[joint]);
    positions
        .chain(joints.flat_map(|joint| person.rotations[joint]))
        .fold(0xcbf2_9ce4_8422_2325, |hash, value| (hash ^ u64::from(value.to_bits())).wrapping_mul(0x0100_0000_01b3))
}

/// Hashes of the data that repeats if the tracker is stuck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Payload {
    /// Elbow and wrist of each arm.
    arms: [u64; 2],
    /// All other joints.
    rest: u64,
}

fn payload(person: &Person) -> Payload {
    let of_arm = |joint: usize| ARMS.iter().any(|arm| arm[1..].contains(&joint));
    Payload {
        arms: ARMS.map(|[_, elbow, wrist]| hash(person, [elbow, wrist].into_iter())),
        rest: hash(person, (0..SMPL_JOINTS).filter(move |&joint| !of_arm(joint))),
    }
}

#[cfg(test)]
mod tests;
