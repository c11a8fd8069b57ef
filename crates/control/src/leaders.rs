//! The leader of each arm while a policy holds its lease: the policy, or the person who took the arm over. A person leads
//! from where the arm stands: the target is q_person + (q_command - q_person) with the difference of the moment of the takeover.
//! When the person lets go, the arm stays until the policy sends a chunk that rests on a later observation.

use messages::{JOINTS_MAX, JointTarget, Mode, Stamp, source_flag, target_flag};
use robot::Model;

/// The leader of one arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Leader {
    #[default]
    Policy,
    Person,
    /// The policy, once it has observed the arm after this time.
    PolicyAfter(Stamp),
}

/// The leaders of both arms.
#[derive(Clone, Debug, Default)]
pub(super) struct Leaders {
    arms: [Leader; 2],
    /// Session of the person who leads, as it was at the takeover. Another person leads nothing.
    pub(super) person: u64,
    /// The command less the person's target at the takeover, rad or m.
    offset: [f64; JOINTS_MAX],
    /// Positions of the joints that nobody leads, rad or m.
    rest: [f64; JOINTS_MAX],
}

impl Leaders {
    /// Decides who leads at this tick. `q` is the command of the last tick. While the robot follows nobody, joints rest where
    /// they are, and a person who leads begins from there. What an arm waits for outlives a hold, but no release.
    pub(super) fn update(
        &mut self,
        model: &Model,
        now: Stamp,
        (person, policy): (Option<&JointTarget>, &JointTarget),
        takes_over: [bool; 2],
        (q, mode): (&[f64; JOINTS_MAX], Mode),
    ) {
        let follows = matches!(mode, Mode::Engaging | Mode::Engaged);
        let is_released = matches!(mode, Mode::Disengaged | Mode::Faulted | Mode::Recovering);
        if takes_over != [false; 2] && (is_released || self.taken() == [false; 2]) {
            self.person = person.map_or(0, |person| person.session_nonce);
        }
        for (side, takes) in takes_over.into_iter().enumerate() {
            let leader = self.arms[side];
            if takes && (leader != Leader::Person || !follows) {
                for j in model.arms[side].range() {
                    self.offset[j] = q[j] - person.map_or(0.0, |person| person.q[j]);
                }
            }
            self.arms[side] = match leader {
                _ if takes => Leader::Person,
                _ if is_released => Leader::Policy,
                Leader::Person => Leader::PolicyAfter(now),
                Leader::PolicyAfter(since) if policy.header.origin < since => leader,
                _ => Leader::Policy,
            };
        }
        for (j, &q) in q.iter().enumerate().take(model.count) {
            if !follows || self.leader(model, (person, policy), j).is_some() {
                self.rest[j] = q;
            }
        }
    }

    /// The target that leads joint `j`, and what is added to its position. `None` for a joint that nobody leads. The joints of
    /// no arm rest while an arm is not the policy's, because they carry it.
    fn leader<'a>(
        &self,
        model: &Model,
        (person, policy): (Option<&'a JointTarget>, &'a JointTarget),
        j: usize,
    ) -> Option<(&'a JointTarget, f64)> {
        let side = (0..2).find(|&side| model.arms[side].range().contains(&j));
        let (target, offset) = match side.map(|side| self.arms[side]) {
            Some(Leader::Person) => (person?, self.offset[j]),
            Some(Leader::PolicyAfter(_)) => return None,
            None if self.arms != [Leader::Policy; 2] => return None,
            _ => (policy, 0.0),
        };
        (target.valid_mask & 1 << j != 0).then_some((target, offset))
    }

    /// The arms that a person leads.
    pub(super) fn taken(&self) -> [bool; 2] {
        self.arms.map(|arm| arm == Leader::Person)
    }

    /// Bits of `source_flag`. An arm that waits for its policy is led by nobody.
    pub(super) fn sources(&self) -> u32 {
        let bit = |side: usize| match self.arms[side] {
            Leader::Person => source_flag::PERSON[side],
            Leader::Policy => source_flag::POLICY[side],
            Leader::PolicyAfter(_) => 0,
        };
        bit(0) | bit(1)
    }

    /// The target of this tick: the policy's joints, those of the arms that the person leads, and all others at rest.
    pub(super) fn target(&self, model: &Model, person: Option<&JointTarget>, policy: &JointTarget) -> JointTarget {
        let mut target = JointTarget { q: self.rest, dq: [0.0; JOINTS_MAX], ..*policy };
        target.valid_mask = (1 << model.count) - 1;
        for j in 0..model.count {
            if let Some((leads, offset)) = self.leader(model, (person, policy), j) {
                (target.q[j], target.dq[j]) = (leads.q[j] + offset, leads.dq[j]);
            }
        }
        for side in (0..2).filter(|&side| matches!(self.arms[side], Leader::PolicyAfter(_))) {
            target.flags &= !target_flag::CLOSURE[side];
        }
        for side in (0..2).filter(|&side| self.arms[side] == Leader::Person) {
            let Some(person) = person else { continue };
            target.header.origin = person.header.origin;
            target.human_limbs[2 * side..2 * side + 2].copy_from_slice(&person.human_limbs[2 * side..2 * side + 2]);
            target.closure[side] = person.closure[side];
            target.flags = target.flags & !target_flag::CLOSURE[side] | person.flags & target_flag::CLOSURE[side];
        }
        target
    }
}
