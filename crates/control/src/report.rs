//! Bookkeeping: the tick writes its status here. Nothing in this module decides a motion.

use crate::following::Reference;
use crate::robot_state::{Posture, Robot};
use crate::target::Target;
use crate::tick::Gated;
use crate::{Commanded, Config, Input, limited, payload, status};
use messages::{Fault, Header, InputStatus, Mode, PersonChange, Stamp, Status, Subject, Transition, source_flag};
use safety::engage::{self, MotionView};

/// Silence of `ingest` after which its status is ignored, ns: ten of its periods.
const INGEST_GONE_NS: u64 = 1_000_000_000;
/// A frame that was dropped within this time counts as dropped now, ns. The time is as long as `ingest`'s own window.
const DROPPED_NOW_NS: u64 = 1_000_000_000;

/// The status that is published, and the newest one of `ingest`.
#[derive(Clone, Debug, Default)]
pub(super) struct Report {
    pub(super) status: Status,
    ingest: Option<(InputStatus, Stamp)>,
}

impl Report {
    /// Keeps a new status of `ingest`.
    pub(super) fn receive(&mut self, now: Stamp, ingest: Option<&InputStatus>) {
        if let Some(ingest) = ingest {
            self.ingest = Some((*ingest, now));
        }
    }

    /// Reports what the robot measures. The tracking error is that of the joint with the largest share of its bound.
    /// The unsteady joint is the one that does not move as commanded. `motion` is that of the last tick.
    pub(super) fn record_robot(&mut self, config: &Config, robot: &Robot, posture: &Posture, motion: MotionView) {
        let status = &mut self.status;
        let Posture { clearance, outside } = posture;
        (status.clearance_measured_m, status.nearest_pair_measured) = (clearance.distance_m, clearance.pair);
        status.joint_outside = outside.map_or(0, |outside| outside.joint as u32 + 1);
        status.outside_by = outside.map_or(0.0, |outside| outside.by);
        let [angle_rad, length_m] = robot.tracking;
        let [angle_max_rad, length_max_m] = config.tracking_max;
        let by_length = length_m.error * angle_max_rad > angle_rad.error * length_max_m;
        let worst = if by_length { length_m } else { angle_rad };
        status.tracking_error = worst.error;
        status.tracking_joint = worst.joint as u32 + 1;
        let restless = (motion.at_rest && !robot.moved.at_rest).then_some(robot.moved.restless);
        let unsteady = robot.moved.velocity_error.or(robot.moved.standstill_lost).or(restless);
        status.unsteady_joint = unsteady.map_or(0, |joint| joint as u32 + 1);
    }

    /// Returns the code of what a transition is about: a joint, a pair or a change of the person.
    pub(super) fn subject_of(&self, transition: &Transition, change: PersonChange) -> Option<u32> {
        let fault = Fault::from_u32(transition.why)?;
        let person = (fault == Fault::PersonChanged).then_some(Subject::Person(change));
        let subject = person.or_else(|| self.status.about(fault));
        Some(subject.map_or(0, Subject::code))
    }

    /// Reports the command of this tick, and why it differs from its reference.
    pub(super) fn record_command(&mut self, config: &Config, mode: Mode, reference: Option<&Reference>, gated: &Gated) {
        let status = &mut self.status;
        let Commanded { motion, proposed, .. } = &gated.arms;
        if let Some(denial) = gated.denied {
            status.denied_why = denial.code();
            status.denied_about = denial.subject().map_or(0, Subject::code);
            status.gate_denials += 1;
        }
        status.torso_to_go_m = match (mode, reference) {
            (Mode::Engaging, Some(reference)) => status::torso_to_go(&config.model, reference, &motion.q),
            _ => 0.0,
        };
        (status.clearance_command_m, status.nearest_pair) = (proposed.clearance_m, proposed.nearest_pair);
        let follows = matches!(mode, Mode::Engaging | Mode::Engaged);
        limited::report(status, follows, motion, &config.wbc, &config.model);
        status.fallbacks = status.fallbacks.wrapping_add(proposed.fallbacks);
        if proposed.fallbacks > 0 {
            // A motion that was refused for a hand's speed concerns no pair.
            let overloaded = proposed.overloaded_joint.map(|joint| Subject::Joint(joint as usize));
            status.refused_about = overloaded.or(proposed.refused_pair.map(Subject::Pair)).map_or(0, Subject::code);
        }
    }

    /// Reports the decision of this tick, and the ages and errors of what it saw.
    pub(super) fn record_tick(
        &mut self,
        config: &Config,
        (now, missed): (Stamp, u64),
        input: &Input<'_>,
        decided: &engage::Output,
        incarnation: u32,
    ) {
        let status = &mut self.status;
        status.ticks += 1;
        status.missed_deadlines += missed;
        let (config_hash, sequence) = (config.config_hash, status.ticks);
        status.header = Header { sequence, stamp: now, origin: Stamp::NONE, config_hash, incarnation, reserved: 0 };
        status.k = input.k;
        status.mode = decided.mode as u32;
        status.faults = decided.active.0;
        status.latched = decided.latched.0;
        status.fault_counts = decided.fault_counts;
        status.moving = u32::from(!decided.at_rest);
        status.speed_scale = decided.permit.speed_scale();
        status.reduced = decided.reduced;
        status.realtime = u32::from(config.realtime);
        if let Some(transition) = decided.transition {
            status.transitions[status.transition_count as usize % messages::TRANSITIONS_KEPT] = transition;
            status.transition_count += 1;
        }
        let ingest = self.ingest.as_ref().filter(|(_, received)| now.since(*received) <= INGEST_GONE_NS);
        let dropped = ingest.filter(|(ingest, _)| now.since(ingest.dropped_at) <= DROPPED_NOW_NS);
        status.input_drop = dropped.map_or(0, |(ingest, _)| ingest.dropped_why);
        status.lost_permille = ingest.map_or(0, |(ingest, _)| ingest.lost_permille);
        let [left, right] = input.operator.left_out.map(u32::from);
        status.left_out = left | right << 1;
        status.calibration = ingest.map_or(0, |(ingest, _)| ingest.calibration);
    }

    /// Reports what the robot and the target are at this tick.
    pub(super) fn record_following(&mut self, config: &Config, now: Stamp, robot: &Robot, target: Option<&Target>) {
        let status = &mut self.status;
        if let Some(received) = robot.received() {
            status.state_stamp = received;
        }
        let Some(target) = target else { return };
        let leads = |side: usize| target.sources & source_flag::PERSON[side] != 0;
        let unseen = [0, 1].map(|side| u32::from(leads(side) && target.limbs[side].is_none()));
        status.left_out |= unseen[0] << 2 | unseen[1] << 3;
        status.target_stamp = target.received;
        status.input_age_ns = now.since(target.input_received);
        // A robot that moves relative to a person is not behind them.
        let error = |q| if target.is_relative { 0.0 } else { status::limb_error(config, &target.limbs, q) };
        status.limb_error_target_rad = error(&target.q);
        if let Some(state) = robot.state() {
            status.limb_error_measured_rad = error(&state.q_measured);
        }
    }

    /// Reports the payloads of the hands.
    pub(super) fn record_payload(&mut self, payload: &[robot::Payload; 2]) {
        payload::report(&mut self.status, payload);
    }
}
