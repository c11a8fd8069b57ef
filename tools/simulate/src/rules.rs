//! Standing promises between neighbouring stages.

use crate::modes::{Broken, follows, moves};
use crate::oracle::{RESTING, Seen};
use driver::Refusal;
use messages::{GripperMotion, JointCommand, JointTarget, Mode, RobotState, TICK_HZ, TICK_S, Transition, state_flag};

/// Rounding of a target's step, rad.
const ROUNDING: f64 = 1e-6;
/// How far outside its limits a measured robot may start, rad or m: encoder noise and the sag of a servo.
const OUTSIDE: f64 = 0.006;
/// Consecutive targets with NaN or infinity after which the robot must have stopped following.
const NO_NUMBERS: u32 = 3 + 1;
/// Ticks after which frames of another `ingest` must have been noticed, or be too old. It is the same as for
/// any silence.
const STRANGE: u64 = TICK_HZ / 10 + 100;
/// Ticks without a command after which a driver must report that it has latched: 10 ms, and as much again.
const SILENCE: u64 = 30;

/// Refusals that concern the motion of a command, not the time of its arrival.
const ASKED: [Refusal; 4] = [Refusal::NotFinite, Refusal::NotAStop, Refusal::Jump, Refusal::OutsideLimits];

#[derive(Clone, Default)]
pub struct Rules {
    refused: [u64; Refusal::COUNT],
    target: Option<JointTarget>,
    command: Option<JointCommand>,
    measured: Option<RobotState>,
    denials: u32,
    no_numbers: u32,
    /// True if the mode of the previous tick permitted motion.
    moved: bool,
    /// The tick at which a restarted `ingest` passed a frame on, if the operator has not enabled since.
    strange_k: Option<u64>,
    restarted: bool,
    /// Ticks in which the driver ran without a new command. `executed` also holds the reset count that it had seen.
    silent: u64,
    /// True if the driver has taken a command since it last reported a latched fault.
    hears: bool,
    executed: (u64, u32),
    /// Tick and motion of the grippers in the last robot state.
    gripped: Option<(u64, GripperMotion)>,
}

impl Rules {
    pub fn check(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        if seen.control_restarted {
            (self.denials, self.no_numbers, self.command) = (0, 0, None);
        }
        self.velocity(seen)?;
        self.refusals(seen)?;
        self.silence(seen)?;
        self.grippers(seen)?;
        self.stranger(seen);
        let Some(control) = &seen.moment.control else { return Ok(()) };
        self.measured = seen.moment.state_seen.or(self.measured);
        if control.status.gate_denials != self.denials {
            let (why, about) = (control.status.denied_why, control.status.denied_about);
            let detail = format!("whole-body control proposed what the gate denies (reason {why}, about {about})");
            return Err(("proposal", detail));
        }
        if let Some(target) = &seen.moment.target_seen {
            let sound = target.q.iter().chain(&target.dq).all(|x| x.is_finite());
            self.no_numbers = if sound { 0 } else { self.no_numbers + 1 };
        }
        if self.no_numbers > NO_NUMBERS && follows(mode) && seen.is_person_leading() {
            let detail = format!("{} targets in a row are NaN or infinite, but it follows", self.no_numbers);
            return Err(("no number", detail));
        }
        if let (Some(operator), Some(made)) = (&seen.operator, control.transition) {
            let held = operator.enable_level || operator.recover_level;
            self.begins(seen, made.why, held)?;
        }
        if let Some(k) =
            self.strange_k.filter(|k| moves(mode) && self.moved && seen.k > k + STRANGE && seen.policy.leads == 0)
        {
            let detail = format!("another ingest since {} ticks, but the robot still moves", seen.k - k);
            return Err(("new engage", detail));
        }
        if !moves(mode) {
            self.strange_k = None;
        }
        (self.moved, self.command) = (moves(mode), control.command.or(self.command));
        Ok(())
    }

    /// A start and a reset require the robot to be in a permitted state.
    fn begins(&self, seen: &Seen<'_>, why: u32, held: bool) -> Result<(), Broken> {
        if why == Transition::RESET {
            if held {
                return Err(("reset", "with the enable held".into()));
            }
            if let Some(v) = self.command.and_then(|command| command.v.into_iter().find(|v| v.abs() > RESTING)) {
                return Err(("reset", format!("while a joint is commanded at {v}")));
            }
        }
        if let (Transition::ENABLED, Some(state)) = (why, &self.measured) {
            let outside = |j: usize| {
                let (q, limits) = (state.q_measured[j], &seen.robot.limits[j]);
                q < limits.q_min - OUTSIDE || q > limits.q_max + OUTSIDE
            };
            if let Some(j) = (0..seen.robot.count).find(|&j| outside(j)) {
                return Err(("starts outside", format!("joint {j} at {}", state.q_measured[j])));
            }
        }
        Ok(())
    }

    /// A target's velocity equals that of its positions, and is no faster.
    fn velocity(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let Some(target) = &seen.moment.target else { return Ok(()) };
        let before = self.target.replace(*target);
        let Some(before) = before.filter(|before| before.header.incarnation == target.header.incarnation) else {
            return Ok(());
        };
        let dt = target.k.saturating_sub(before.k) as f64 * TICK_S;
        let both = target.valid_mask & before.valid_mask;
        for j in (0..seen.robot.count).filter(|&j| both & 1 << j != 0) {
            let step = (target.q[j] - before.q[j]).abs();
            if (target.dq[j] * dt).abs() > step + ROUNDING {
                let detail = format!("joint {j} at {} rad/s, moved {step} in {dt} s", target.dq[j]);
                return Err(("target velocity", detail));
            }
        }
        Ok(())
    }

    /// `control` sends nothing that the driver has to refuse because of the motion.
    fn refusals(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let [before, now] = [self.refused, seen.refused];
        self.refused = now;
        match ASKED.iter().find(|&&reason| now[reason as usize] > before[reason as usize]) {
            Some(reason) if !seen.driver_restarted => Err(("refused", format!("a command of control: {reason:?}"))),
            _ => Ok(()),
        }
    }

    /// A driver without commands reports it.
    fn silence(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let Some(robot) = &seen.moment.robot else { return Ok(()) };
        let executed = (robot.executed_k, robot.reset_count);
        let commanded = robot.flags & state_flag::COMMANDED != 0;
        let latched = robot.flags & state_flag::DRIVER_FAULT != 0;
        // After a reset it waits for the first command without a time limit.
        self.hears = !latched && !seen.driver_restarted && (self.hears || executed.0 != self.executed.0);
        let silent = commanded && self.hears && executed == self.executed;
        (self.silent, self.executed) = (if silent { self.silent + 1 } else { 0 }, executed);
        if self.silent > SILENCE {
            return Err(("silence", format!("no command for {} ticks, but the driver reports nothing", self.silent)));
        }
        Ok(())
    }

    /// The grippers keep their range, their speed and the 0.1 s in which they get it, whatever the hands do.
    fn grippers(&mut self, seen: &Seen<'_>) -> Result<(), Broken> {
        let Some(robot) = &seen.moment.robot else { return Ok(()) };
        let now = robot.grippers;
        let before = self.gripped.replace((seen.k, now)).filter(|(k, _)| !seen.driver_restarted && *k < seen.k);
        for side in 0..2 {
            let (closure, rate) = (now.closure[side], now.rate[side]);
            let speed = seen.robot.grippers[side].as_ref().map_or(0.0, |gripper| gripper.speed);
            let at_end = rate == 0.0 && [0.0, 1.0].contains(&closure);
            let fits = before.is_none_or(|(k, before)| {
                let elapsed_s = (seen.k - k) as f64 * TICK_S;
                let (moved, sped) = (closure - before.closure[side], rate - before.rate[side]);
                moved.abs() <= speed * elapsed_s + ROUNDING
                    && (at_end || sped.abs() <= speed / driver::GRIPPER_RAMP_S * elapsed_s + ROUNDING)
            });
            if !(fits && (0.0..=1.0).contains(&closure) && rate.abs() <= speed + ROUNDING) {
                return Err(("gripper", format!("hand {side} at {closure} with {rate} 1/s, before {before:?}")));
            }
        }
        Ok(())
    }

    fn stranger(&mut self, seen: &Seen<'_>) {
        self.restarted |= seen.ingest_restarted;
        if self.restarted && !seen.accepted.is_empty() {
            (self.restarted, self.strange_k) = (false, Some(seen.k));
        }
    }
}
