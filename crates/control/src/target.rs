//! A `JointTarget` enters the tick here, and only here. On its arrival it is checked. In each tick, it is reduced to
//! the arms that follow. A policy has targets of its own. While it holds its lease, it leads, except for the arms that the
//! person takes over.

use crate::Config;
use crate::leaders::Leaders;
use messages::{
    HAND_NODES, JOINTS_MAX, JointTarget, LIMBS, Mode, PersonChange, Stamp, TRAJECTORY_NODES, source_flag, target_flag,
};
use retarget::Limbs;
use robot::Model;
use safety::engage::TargetView;
use safety::monitor::TargetSteps;

/// Age at which a policy's target counts as gone beside a newer one of the person, ns. Both come in every tick.
const POLICY_SILENT_NS: u64 = 100_000_000;
/// Session after a policy that left while nobody else is there: its return needs a new enable.
const GONE: u64 = u64::MAX;

/// The newest targets of the person and of the policy, and who leads.
#[derive(Clone, Debug, Default)]
pub(super) struct Targets {
    person: Arrived,
    policy: Arrived,
    leaders: Leaders,
    /// Target of this tick that a policy and a person lead together. `None` without a policy.
    led: Option<JointTarget>,
    /// Steps of that target.
    steps: TargetSteps,
    jumped: bool,
    /// The session that counted in the last tick, and why it is another one than before.
    session: u64,
    pub(super) change: PersonChange,
}

/// The newest target of one source, and what the check on its arrival found.
#[derive(Clone, Debug, Default)]
struct Arrived {
    newest: Option<JointTarget>,
    view: TargetView,
    steps: TargetSteps,
}

/// The target as it counts in one tick: without the arms that the operator leaves out.
pub(super) struct Target {
    /// The input is fresh, and the joints are those of this robot.
    pub(super) may_be_followed: bool,
    /// Time at which the target was published.
    pub(super) stamp: Stamp,
    /// `origin` of the skeleton behind it.
    pub(super) origin: Stamp,
    /// Arrival time of the target, and of the skeleton behind it.
    pub(super) received: Stamp,
    pub(super) input_received: Stamp,
    /// Joint positions, rad or m.
    pub(super) q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub(super) dq: [f64; JOINTS_MAX],
    /// Bit j: joint j is valid.
    pub(super) valid_mask: u32,
    /// The person's limbs of the left and the right arm. `None` for an arm without a person.
    pub(super) limbs: [Option<Limbs>; 2],
    /// The person's motion ahead. `None` if the joints are followed.
    pub(super) ahead: Option<Ahead>,
    /// Closure of the left and the right hand, from 0 to 1. `None` for a hand that is not known.
    pub(super) closure: [Option<f64>; 2],
    /// Bits of `source_flag`: who leads each arm.
    pub(super) sources: u32,
    /// A policy holds its lease, so a person only leads relative to where an arm is.
    pub(super) is_relative: bool,
}

/// The person's motion ahead, at the nodes after the target's tick. See `JointTarget`.
pub(super) struct Ahead {
    pub(super) first_node: u64,
    pub(super) limbs: [[[f32; 4]; LIMBS]; TRAJECTORY_NODES],
    pub(super) hands: [[[f32; 4]; 2]; HAND_NODES],
    pub(super) places: [[[f32; 4]; 2]; TRAJECTORY_NODES],
}

impl Arrived {
    /// Checks a new target, and keeps it. Without one, the newest target stays.
    fn receive(&mut self, config: &Config, now: Stamp, target: Option<&JointTarget>) {
        self.view.jumped = false;
        let Some(target) = target else { return };
        let limbs = has_motion_ahead(target).then_some(&target.human_limbs);
        self.view = TargetView {
            received: now,
            incarnation: target.header.incarnation,
            session_nonce: target.session_nonce,
            config_matches: target.header.config_hash == config.config_hash && target.robot == config.model.id(),
            input_fresh: target.flags & target_flag::INPUT_FRESH != 0,
            input_received: target.input_received,
            clutch: target.flags & target_flag::CLUTCH != 0,
            implausible: implausible(target),
            jumped: self.steps.jumped(&config.model, target.k, &target.q, target.valid_mask, limbs),
        };
        self.newest = Some(*target);
    }
}

impl Targets {
    /// Checks new targets of the person and of the policy, and keeps them.
    pub(super) fn receive(&mut self, config: &Config, now: Stamp, [person, policy]: [Option<&JointTarget>; 2]) {
        self.person.receive(config, now, person);
        self.policy.receive(config, now, policy);
    }

    /// Decides who leads. `q` is the command of the last tick, `mode` the mode since then.
    pub(super) fn lead(&mut self, model: &Model, now: Stamp, takes_over: [bool; 2], q: &[f64; JOINTS_MAX], mode: Mode) {
        let (mut leaders, mut steps) = (std::mem::take(&mut self.leaders), std::mem::take(&mut self.steps));
        let was_led = self.led.take().is_some();
        if let (Some(policy), person) = (self.policy(), self.person.newest.as_ref()) {
            leaders.update(model, now, (person, policy), takes_over, (q, mode));
            let target = leaders.target(model, person, policy);
            let jumped = steps.jumped(model, target.k, &target.q, target.valid_mask, None);
            (self.leaders, self.led, self.steps, self.jumped) = (leaders, Some(target), steps, jumped);
        }
        let session = self.view().session_nonce;
        if session != std::mem::replace(&mut self.session, session) {
            let is_person = session == self.person.view.session_nonce.max(1) && (self.led.is_some() || !was_led);
            let person = self.person.newest.as_ref().filter(|_| is_person);
            self.change = person.map_or(PersonChange::Policy, |person| PersonChange::from_flags(person.flags));
        }
    }

    /// The policy's target while it holds its lease. A `retarget` that was restarted since knows of no policy.
    fn policy(&self) -> Option<&JointTarget> {
        let (person, policy) = (&self.person.newest, self.policy.newest.as_ref()?);
        let is_over = person.as_ref().is_some_and(|person| {
            let silent_ns = person.header.stamp.since(policy.header.stamp);
            person.header.incarnation != policy.header.incarnation || silent_ns > POLICY_SILENT_NS
        });
        (policy.session_nonce != 0 && !is_over).then_some(policy)
    }

    /// The targets as engagement sees them. While a policy holds its lease, its session counts. What leads must be fresh.
    pub(super) fn view(&self) -> TargetView {
        if self.led.is_none() {
            let mut view = self.person.view;
            if view.session_nonce == 0 && self.policy.newest.is_some() {
                view.session_nonce = GONE;
            }
            return view;
        }
        let (person, policy, taken) = (&self.person.view, &self.policy.view, self.leaders.taken());
        let mut view = TargetView { jumped: self.jumped, ..*policy };
        if taken.contains(&true) {
            view.input_fresh = person.input_fresh && (taken == [true; 2] || policy.input_fresh);
            if person.session_nonce != self.leaders.person {
                // Another person leads nothing: as a change of the session.
                view.session_nonce = person.session_nonce.max(1);
            }
            view.input_received = match taken {
                [true, true] => person.input_received,
                _ => person.input_received.min(policy.input_received),
            };
            view.config_matches &= person.config_matches;
            view.clutch |= person.clutch;
            view.implausible |= person.implausible;
        }
        view
    }

    /// Reduces the newest target: no joint of an arm that is left out is valid, and nobody drives the arm. `None`
    /// before the first target.
    pub(super) fn reduced(&self, model: &Model, left_out: [bool; 2]) -> Option<Target> {
        let view = self.view();
        let target = self.led.as_ref().or(self.person.newest.as_ref())?;
        let left_joints: u32 = (0..2)
            .filter(|&side| left_out[side])
            .flat_map(|side| model.arms[side].range())
            .fold(0, |joints, j| joints | 1 << j);
        let of_arm = |side: usize| (!left_out[side]).then_some(side);
        let nobody_else = source_flag::PERSON[0] | source_flag::PERSON[1];
        let sources = if self.led.is_some() { self.leaders.sources() } else { nobody_else };
        let of_side = |side: usize| source_flag::PERSON[side] | source_flag::POLICY[side];
        let closes = |side: usize| target.flags & target_flag::CLOSURE[side] != 0 && target.closure[side].is_finite();
        Some(Target {
            may_be_followed: view.input_fresh && target.robot == model.id(),
            stamp: target.header.stamp,
            origin: target.header.origin,
            received: view.received,
            input_received: view.input_received,
            q: target.q,
            dq: target.dq,
            valid_mask: target.valid_mask & !left_joints,
            limbs: core::array::from_fn(|side| of_arm(side).and_then(|side| limbs(target, side))),
            ahead: has_motion_ahead(target).then_some(Ahead {
                first_node: target.trajectory_first,
                limbs: target.limb_trajectory,
                hands: target.hand_trajectory,
                places: target.hand_places,
            }),
            closure: core::array::from_fn(|side| {
                of_arm(side).filter(|&side| closes(side)).map(|side| target.closure[side].into())
            }),
            sources: (0..2).filter_map(of_arm).fold(0, |all, side| all | sources & of_side(side)),
            is_relative: self.led.is_some(),
        })
    }
}

/// The person's limbs of an arm. `None` without a person.
pub(super) fn limbs(target: &JointTarget, side: usize) -> Option<Limbs> {
    Limbs::from_arm(side, [target.human_limbs[2 * side], target.human_limbs[2 * side + 1]])
}

/// Returns true if the command follows the limbs, and not the joints.
fn has_motion_ahead(target: &JointTarget) -> bool {
    target.trajectory_nodes as usize == TRAJECTORY_NODES
}

/// Returns true for values that no retargeting produces: not finite, or far outside any joint's range.
fn implausible(target: &JointTarget) -> bool {
    // Ten turns: no supported joint makes two, and the comparison with limits stays exact.
    let far = 20.0 * core::f64::consts::PI;
    target.q.iter().chain(&target.dq).any(|value| !value.is_finite() || value.abs() > far)
}
