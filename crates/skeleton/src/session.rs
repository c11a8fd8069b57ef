//! What is remembered of one operator of one client, and the checks from frame to frame.

use crate::config::{Config, DropReason};
use crate::limbs::{ARMS, Hold, torso_rotation};
use crate::person::Person;
use crate::plausible::{Chirality, chirality};
use crate::reference::Learnt;
use messages::{LIMBS, RawSkeleton, Smpl, Stamp, comes_after, known_bug};
use nalgebra::Vector3;

/// Frames over which the evidence on left and right is averaged: half a second at 60 Hz. Dancers turn shoulders and feet
/// against the hips for a moment (CMU 005_16), a mirrored tracker does so always.
const CHIRALITY_FRAMES: f64 = 30.0;
/// Least mean cosine between shoulders and hips. CMU clips: above 0; swapped sides: -0.9.
const SIDES_MIN: f64 = -0.3;
/// Least mean evidence of feet and knees, of -4 to 4. CMU clips: mean 2.3, never below 0 over a second; mirrored: -2.3.
const FRONT_MIN: f64 = -1.0;
/// Time without a frame after which the evidence on left and right begins anew, ns: a period at 20 Hz. A jump over the
/// time between may be an exchange of the sides.
const UNSEEN_NS: u64 = 50_000_000;
/// A step that noise alone may cause, m: 10 mm at each end of a bone and of the hips, three times.
const NOISE_M: f64 = 0.03;

/// One operator of one client's session.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Session {
    pub(crate) nonce: u64,
    pub(crate) operator_id: u32,
    incarnation: u32,
    sequence: u64,
    origin: Stamp,
    pub(crate) hold: Hold,
    pub(crate) learnt_hinges: Learnt,
    /// The last frame looked at, accepted or not.
    previous: Option<Body>,
    /// Coherent frames still missing before frames are accepted again.
    settling: u32,
    /// Sum of limb lengths over the frames learnt from.
    lengths: [f64; LIMBS],
    learnt: u32,
    learning_until: Stamp,
    /// Since when lengths have been refused without a break.
    lengths_refused_since: Stamp,
    /// Low-passed evidence on left and right.
    chirality: Option<Chirality>,
    upright: bool,
    /// Hash of the last frame of which all else was right.
    payload: Option<u64>,
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
}

impl Body {
    fn read(raw: &RawSkeleton, person: &Person) -> Self {
        let hips = person.hips();
        let arms = ARMS.map(|joints| {
            joints.map(|joint| if person.has(joint) { person.at(joint) - hips } else { Vector3::zeros() })
        });
        let mut lengths = [None; LIMBS];
        for (side, [shoulder, elbow, wrist]) in ARMS.into_iter().enumerate() {
            for (limb, [from, to]) in [[shoulder, elbow], [elbow, wrist]].into_iter().enumerate() {
                if person.has(from) && person.has(to) {
                    lengths[2 * side + limb] = Some((person.at(to) - person.at(from)).norm());
                }
            }
        }
        Self { origin: raw.header.origin, arms, lengths }
    }
}

impl Session {
    pub(crate) fn new(raw: &RawSkeleton) -> Self {
        Self {
            nonce: raw.session_nonce,
            operator_id: raw.operator_id,
            incarnation: raw.header.incarnation,
            sequence: 0,
            origin: Stamp::NONE,
            hold: Hold::default(),
            learnt_hinges: Learnt::default(),
            previous: None,
            settling: 0,
            lengths: [0.0; LIMBS],
            learnt: 0,
            learning_until: Stamp::NONE,
            lengths_refused_since: Stamp::NONE,
            chirality: None,
            upright: false,
            payload: None,
            moved: false,
            frozen_since: Stamp::NONE,
        }
    }
}

impl Session {
    /// Forgets the person, but not which frames were seen.
    pub(crate) fn forget(&mut self, raw: &RawSkeleton) {
        let Self { sequence, origin, .. } = *self;
        *self = Self { sequence, origin, ..Self::new(raw) };
    }

    /// Refuses what was seen before, and forgets the person after a gap, which it says.
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
        self.incarnation = raw.header.incarnation;
        self.sequence = raw.header.sequence;
        self.origin = origin;
        Ok(gap)
    }

    /// Checks a frame against those before it.
    pub(crate) fn check(
        &mut self,
        config: &Config,
        now: Stamp,
        raw: &RawSkeleton,
        person: &Person,
    ) -> Result<(), DropReason> {
        if self.previous.is_some_and(|previous| raw.header.origin.since(previous.origin) > UNSEEN_NS) {
            self.chirality = None;
        }
        self.check_posture(person)?;
        let body = Body::read(raw, person);
        let previous = self.previous.replace(body);
        if let Some(previous) = previous {
            if teleported(config, person, &previous, &body) {
                self.settling = config.coherent_frames;
                // It may be the two sides that jumped.
                self.chirality = None;
                return Err(DropReason::Teleport);
            }
            self.settling = self.settling.saturating_sub(1);
            if self.settling > 0 {
                return Err(DropReason::Teleport);
            }
            check_length_steps(config, &previous, &body)?;
        }
        self.check_lengths(config, &body)?;
        self.check_frozen(config, now, payload_hash(person))
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
        let now = chirality(&person.positions).ok_or(DropReason::Size)?;
        let legs =
            [Smpl::LeftKnee, Smpl::RightKnee, Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot];
        let sees_legs = legs.iter().all(|&joint| person.has(joint as usize));
        let was =
            self.chirality.unwrap_or(Chirality { sides: now.sides, front: if sees_legs { now.front } else { 0.0 } });
        let front = if sees_legs { was.front + (now.front - was.front) / CHIRALITY_FRAMES } else { was.front };
        let mean = Chirality { sides: was.sides + (now.sides - was.sides) / CHIRALITY_FRAMES, front };
        self.chirality = Some(mean);
        if mean.sides < SIDES_MIN || mean.front < FRONT_MIN { Err(DropReason::Chirality) } else { Ok(()) }
    }

    /// Compares with the last frame of which all else was right: one that is refused is no sign of life.
    fn check_frozen(&mut self, config: &Config, now: Stamp, payload: u64) -> Result<(), DropReason> {
        let last = self.payload.replace(payload);
        if last != Some(payload) {
            self.moved |= last.is_some();
            self.frozen_since = Stamp::NONE;
            return Ok(());
        }
        if self.frozen_since == Stamp::NONE {
            self.frozen_since = now;
        }
        let still_ns = now.since(self.frozen_since);
        if still_ns > config.gap_ns {
            // By now everything downstream has stopped; a client may hold a frame until it is engaged anew.
            self.moved = false;
        }
        // A client holds its first frame until it is engaged: only what moved before can freeze.
        let frozen = config.frozen_after_ns > 0 && self.moved && still_ns >= config.frozen_after_ns;
        let frozen = frozen && !known_bug!(FrozenAccepted);
        if frozen { Err(DropReason::Frozen) } else { Ok(()) }
    }

    /// Lengths of the limbs in the newest frame, m, where they are seen.
    pub(crate) fn lengths_m(&self) -> [Option<f64>; LIMBS] {
        self.previous.map_or([None; LIMBS], |body| body.lengths)
    }

    /// Of the frames that were learnt from, m.
    fn mean_length(&self, limb: usize) -> Option<f64> {
        (self.learnt > 0).then(|| self.lengths[limb] / f64::from(self.learnt))
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
            if let (Some(length), Some(mean)) = (body.lengths[limb], self.mean_length(limb))
                && (length - mean).abs() > config.length_change_max * mean
            {
                self.refuse_lengths(config, body.origin);
                return Err(DropReason::LengthChange);
            }
        }
        self.lengths_refused_since = Stamp::NONE;
        if let (Some(lengths), true) = (all, learning) {
            for (sum, length) in self.lengths.iter_mut().zip(lengths) {
                *sum += length;
            }
            self.learnt = self.learnt.saturating_add(1);
        }
        Ok(())
    }
}

impl Session {
    /// Learns anew when every frame of a gap's length was refused: what was learnt was wrong, or the person changed, and
    /// nothing downstream has followed for as long.
    fn refuse_lengths(&mut self, config: &Config, origin: Stamp) {
        if self.lengths_refused_since == Stamp::NONE {
            self.lengths_refused_since = origin;
        } else if origin.since(self.lengths_refused_since) >= config.gap_ns {
            self.learnt = 0;
            self.lengths = [0.0; LIMBS];
            self.learning_until = Stamp::NONE;
            self.lengths_refused_since = Stamp::NONE;
        }
    }
}

/// Whether a used joint jumped, relative to the hips.
fn teleported(config: &Config, person: &Person, previous: &Body, body: &Body) -> bool {
    let dt_s = body.origin.since(previous.origin) as f64 * 1e-9;
    // The step holds between frames of a tracker of 30 Hz or faster; after lost frames it grows with the time, and it
    // never falls below a tracker's noise when frames arrive bunched.
    let frames = (dt_s * 30.0).max(1.0);
    let step_max_m = config.step_max_m.max(NOISE_M) * frames;
    let step_max_m = (config.speed_max_m_per_s * dt_s).clamp(NOISE_M, step_max_m);
    ARMS.iter().enumerate().any(|(side, joints)| {
        joints.iter().enumerate().any(|(i, &joint)| {
            let (was, is) = (previous.arms[side][i], body.arms[side][i]);
            // Zero stands for a joint that was not seen: it appears, it does not jump.
            let jumps = (is - was).norm() > step_max_m && !known_bug!(TeleportAccepted);
            person.has(joint) && was != Vector3::zeros() && jumps
        })
    })
}

fn check_length_steps(config: &Config, previous: &Body, body: &Body) -> Result<(), DropReason> {
    for (was, is) in previous.lengths.iter().zip(body.lengths) {
        if let (Some(was), Some(is)) = (was, is)
            && (is - was).abs() > config.length_step_max * was
        {
            return Err(DropReason::LengthStep);
        }
    }
    Ok(())
}

/// FNV-1a over the bits of the used positions and rotations.
fn payload_hash(person: &Person) -> u64 {
    let positions = person.positions.iter().flatten();
    positions
        .chain(person.rotations.iter().flatten())
        .fold(0xcbf2_9ce4_8422_2325, |hash, value| (hash ^ u64::from(value.to_bits())).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(test)]
mod tests;
