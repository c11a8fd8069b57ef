//! Faults of the content that a stage publishes.

use crate::active::{Active, Faults};
use crate::kinds::{Content, Fault};
use crate::subject::Subject;
use messages::{ALL_JOINTS, JOINTS_MAX, JointCommand, JointTarget, RobotState, Skeleton, TICK_HZ};
use rand::{Rng, RngExt};
use world::Tamper;

/// Number of past commands that are kept: 20 ms.
const PAST: usize = 30;

#[derive(Clone, Default)]
pub struct Memory {
    skeleton: Option<Skeleton>,
    target: Option<JointTarget>,
    state: Option<RobotState>,
    commands: Vec<JointCommand>,
}

/// Applies the faults in force at the places where messages are published.
pub struct Tampering<'a> {
    pub faults: &'a mut Faults,
    pub memory: &'a mut Memory,
    pub subject: &'a Subject,
}

fn as_content(fault: Fault) -> Option<Content> {
    if let Fault::Content(content) = fault { Some(content) } else { None }
}

impl Tamper for Tampering<'_> {
    fn skeleton(&mut self, skeleton: &mut Skeleton) -> bool {
        let before = self.memory.skeleton.replace(*skeleton);
        let mut frozen = None;
        self.faults.each(as_content, |active, content| match content {
            Content::SkeletonLies => {
                skeleton.limbs.iter_mut().for_each(|limb| *limb = unit(active));
                true
            }
            Content::SkeletonBits if active.acts() => {
                let (limb, axis) = (active.rng.random_range(0..4), active.rng.random_range(0..4));
                let x = &mut skeleton.limbs[limb][axis];
                *x = f32::from_bits(x.to_bits() ^ 1 << active.rng.random_range(0..32));
                true
            }
            Content::SkeletonFrozen => {
                frozen = before;
                before.is_some()
            }
            _ => false,
        });
        freeze(frozen, skeleton, &mut self.memory.skeleton);
        true
    }

    fn target(&mut self, target: &mut JointTarget) -> bool {
        let before = self.memory.target.replace(*target);
        let (mut sent, mut frozen) = (true, None);
        let subject = self.subject;
        self.faults.each(as_content, |active, content| match content {
            Content::TargetFrozen => {
                frozen = before;
                before.is_some()
            }
            Content::TargetLate => {
                // Late for 1, 3 or 15 ticks, then on time for as long.
                let late = [1, 3, 15][(active.episode.param % 3) as usize];
                let now = (active.age / late).is_multiple_of(2);
                sent &= !now;
                now
            }
            content => alter(active, content, target, subject),
        });
        freeze(frozen, target, &mut self.memory.target);
        sent
    }

    fn command(&mut self, command: &mut JointCommand) -> bool {
        let past = &mut self.memory.commands;
        if past.len() == PAST {
            past.remove(0);
        }
        past.push(*command);
        self.faults.each(as_content, |active, content| match content {
            Content::CommandOld if active.acts() => {
                *command = past[active.rng.random_range(0..past.len())];
                true
            }
            Content::CommandFrozen => {
                // The command from the beginning of the episode, as long as it is kept.
                let back = (active.age as usize).min(past.len() - 1);
                *command = past[past.len() - 1 - back];
                back > 0
            }
            _ => false,
        });
        true
    }

    fn state(&mut self, state: &mut RobotState) -> bool {
        let before = self.memory.state.replace(*state);
        let model = self.subject.model();
        let (mut sent, mut frozen) = (true, None);
        self.faults.each(as_content, |active, content| match content {
            Content::StateSilent => {
                sent = false;
                true
            }
            Content::StateNan => {
                let joint = active.rng.random_range(0..model.count);
                let value = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][active.rng.random_range(0..3)];
                state.q_measured[joint] = value;
                true
            }
            Content::StateSwapped => {
                let [left, right] = model.arms.each_ref().map(robot::Arm::range);
                let joint = (active.episode.param % left.len() as u64) as usize;
                state.q_measured.swap(left.start + joint, right.start + (joint + 1) % right.len());
                true
            }
            Content::StateFrozen => {
                frozen = before;
                before.is_some()
            }
            _ => false,
        });
        freeze(frozen, state, &mut self.memory.state);
        sent
    }
}

/// Sends a frozen message again, and remembers it.
fn freeze<M: Copy>(frozen: Option<M>, message: &mut M, memory: &mut Option<M>) {
    if let Some(before) = frozen {
        (*message, *memory) = (before, frozen);
    }
}

fn unit(active: &mut Active) -> [f32; 4] {
    let q: [f32; 4] = std::array::from_fn(|_| active.rng.random_range(-1.0..1.0));
    let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
    q.map(|x| x / norm)
}

/// Alters a target. Returns false if this kind does not concern targets, or leaves this one alone.
fn alter(active: &mut Active, content: Content, target: &mut JointTarget, subject: &Subject) -> bool {
    let (model, limits) = (subject.model(), &subject.model().limits);
    let joint = active.rng.random_range(0..model.count);
    match content {
        Content::TargetNan => target.q[joint] = f64::NAN,
        Content::TargetInfinite => target.dq[joint] = f64::INFINITY,
        Content::TargetJump => {
            // All joints jump for a share of the ticks, or once for all.
            let size = 3.0 * active.strength;
            let away = active.episode.param.is_multiple_of(2) || (active.age / 40).is_multiple_of(2);
            if !away {
                return false;
            }
            target.q.iter_mut().enumerate().for_each(|(j, q)| *q += if j.is_multiple_of(2) { size } else { -size });
        }
        Content::TargetBeyond => {
            let sign = if active.episode.param.is_multiple_of(2) { 1.0 } else { -1.0 };
            target.q = limits.map(|limits| if sign > 0.0 { limits.q_max + 1.0 } else { limits.q_min - 1.0 });
            target.q[joint] = 50.0 * sign;
        }
        Content::TargetFast => {
            let sign = if active.age.is_multiple_of(2) { 1.0 } else { -1.0 };
            target.dq = [50.0 * sign; JOINTS_MAX];
            target.q.iter_mut().for_each(|q| *q += sign);
        }
        Content::TargetPosture => posture(active, target, subject),
        Content::TargetTorso => {
            let up = (active.age / 450).is_multiple_of(2);
            // A robot without a lift is asked to move its first joint.
            let torso = model.lift.unwrap_or(0);
            target.q[torso] = if up { limits[torso].q_max } else { limits[torso].q_min };
            target.valid_mask |= 1 << torso;
        }
        Content::TargetBits => {
            let both = target.q.iter_mut().take(model.count).chain(target.dq.iter_mut().take(model.count));
            both.for_each(|x| *x = f64::from_bits(active.rng.next_u64()));
            target.valid_mask = active.rng.next_u32();
        }
        Content::TargetFlips if active.acts() => flip(active, target, joint),
        _ => return false,
    }
    true
}

/// Sends the same random posture for 0.3 s, then the next one. Half of the episodes instead move gradually to
/// one that is too close to self-collision.
fn posture(active: &mut Active, target: &mut JointTarget, subject: &Subject) {
    let (model, param) = (subject.model(), active.episode.param);
    target.dq = [0.0; JOINTS_MAX];
    if !param.is_multiple_of(2) {
        // The move takes one second, so that it is not a jump. A jump would make the robot slow.
        let share = (active.age as f64 / TICK_HZ as f64).min(1.0);
        let close = &subject.close[(param / 2) as usize % subject.close.len()];
        target.q.iter_mut().zip(close).for_each(|(q, close)| *q += share * (close - *q));
        target.valid_mask = ALL_JOINTS;
        return;
    }
    let part = param ^ (active.age / 450) << 32;
    let mut rng = <rand_pcg::Pcg64Mcg as rand::SeedableRng>::seed_from_u64(part);
    for (q, limits) in target.q.iter_mut().zip(&model.limits).take(model.count) {
        *q = rng.random_range(limits.q_min..=limits.q_max);
    }
}

/// Flips one to three bits anywhere in the fields that control reads.
fn flip(active: &mut Active, target: &mut JointTarget, joint: usize) {
    for _ in 0..active.rng.random_range(1..4) {
        let bit = active.rng.random_range(0..64);
        match active.rng.random_range(0..12) {
            0 => target.valid_mask ^= 1 << (bit % 32),
            1 => target.flags ^= 1 << (bit % 32),
            2 => target.session_nonce ^= 1 << bit,
            3 => target.header.incarnation ^= 1 << (bit % 32),
            4 => target.header.config_hash ^= 1 << bit,
            5 => target.input_received.0 ^= 1 << bit,
            6 => target.header.stamp.0 ^= 1 << bit,
            7 => target.k ^= 1 << bit,
            8 => target.dq[joint] = f64::from_bits(target.dq[joint].to_bits() ^ 1 << bit),
            _ => target.q[joint] = f64::from_bits(target.q[joint].to_bits() ^ 1 << bit),
        }
    }
}
