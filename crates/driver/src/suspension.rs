//! A driver that was suspended while the robot moved begins again where the robot is measured.

use crate::acceptance::GAP_MAX_TICKS;
use crate::follower::{Config, ENCODER_NOISE, Input, NOISE, State, Step, StepKind};
use crate::plan::Motion;
use crate::port::Measured;
use messages::{JOINTS, Stamp, TICK_S, known_bug};

/// Largest noise of a measured speed, rad/s or m/s: eight standard deviations of the simulated drives'. Assumption.
const SPEED_NOISE: f64 = 0.036;

/// Delay of a robot that follows its setpoints, s. The simulated drives (15 Hz, 1 ms of transport) stay 20 mrad behind at
/// 2 rad/s. Assumption.
const FOLLOWING_DELAY_S: f64 = 0.010;

/// Age of a measurement, ns, beyond which it does not say where the robot stands now: 10 ms, the silence after which its
/// drives act by themselves.
const MEASURED_AGE_MAX_NS: u64 = 10_000_000;

impl State {
    /// Begins at index `k` where the robot is measured: a robot whose last driver died may still move, and drives that
    /// follow at once would take a standing setpoint as a step of the velocity. Joints that move stop from their measured
    /// speed within the limits; no certificate covers that stop. Returns `None` if a number is not finite.
    pub fn begin(config: &Config, k: u64, measured: &Measured) -> Option<Self> {
        let mut state = Self::hold(k, &measured.q)?;
        let moves = |v: f64| if v.abs() <= SPEED_NOISE { 0.0 } else { v };
        let v = measured.dq.map(moves);
        if !v.iter().all(|v| v.is_finite()) {
            return None;
        }
        if v.iter().any(|&v| v != 0.0) {
            state.motion = Motion::stopping(&config.limits, measured.q, &v, &[0.0; JOINTS]);
            state.holds_measured = false;
        }
        Some(state)
    }

    /// The ticks for which the driver was suspended, if those are too many for one motion.
    pub(crate) fn suspension(&self, due_k: u64) -> Option<u64> {
        let ticks = due_k.saturating_sub(self.index());
        (ticks > GAP_MAX_TICKS && !self.motion.at_rest() && !known_bug!(PauseBridged)).then_some(ticks)
    }

    /// The driver was suspended for `ticks` while the robot moved. A robot that carried on by itself is measured where the
    /// certified stop has come to meanwhile: then the driver goes on with that stop. Otherwise neither the plan nor a command says
    /// where the robot is, so the motion begins again where it is measured, stops from there within the limits, and has a new
    /// identity. If the driver missed as many ticks as the silence that latches, or has no measurement to believe, it latches.
    /// Without a measurement the last setpoint is held.
    pub(crate) fn begin_again(
        &mut self,
        config: &Config,
        now: Stamp,
        input: &Input<'_>,
        ticks: u64,
        each: &mut impl FnMut(&Step),
    ) {
        let fresh = |measured: &&Measured| now.since(measured.stamp) <= MEASURED_AGE_MAX_NS;
        let finite = |measured: &&Measured| measured.dq.iter().all(|v| v.is_finite());
        let measured = input.measured.filter(fresh).filter(finite);
        let mut planned = self.motion;
        planned.play(ticks);
        if measured.is_some_and(|measured| self.is_on_plan(config, &planned, measured)) {
            self.latched |= ticks > config.silence_ticks;
            self.play(ticks, each);
            return;
        }
        (self.executed_k, self.plan_ticks_played, self.chain) = (input.due_k, 0, None);
        // Each joint carried on or braked: its speed lies between the last one and rest, and is no farther from the last one
        // than the limit of acceleration allows, but for noise. A robot that braked harder is believed.
        let speed = |measured: &Measured, j: usize| {
            let (v, change) = (self.motion.v[j], config.limits[j].a_max * ticks as f64 * TICK_S);
            let between = measured.dq[j].clamp(v.min(0.0), v.max(0.0));
            let allowed = between.clamp(v - change, v + change);
            if (allowed - between).abs() <= SPEED_NOISE { allowed } else { between }
        };
        let speeds = measured.map(|measured| core::array::from_fn(|j| speed(measured, j)));
        // A servo may stand a little beyond a limit; no setpoint does.
        let inside = |q: [f64; JOINTS]| {
            core::array::from_fn(|j| {
                let nearest = q[j].clamp(config.limits[j].q_min, config.limits[j].q_max);
                if (nearest - q[j]).abs() <= NOISE { nearest } else { q[j] }
            })
        };
        let place = measured.and_then(|measured| self.believe(config, measured)).map(inside).zip(speeds);
        // The index that is due is not missed: it is executed now.
        self.latched |= ticks > config.silence_ticks || place.is_none();
        self.motion = match place {
            Some((q, v)) => Motion::stopping(&config.limits, q, &v, &planned.a),
            None => Motion::rest(self.motion.q),
        };
        each(&Step { kind: StepKind::Measured, setpoint: self.setpoint() });
    }

    /// Whether every joint is measured where it is if it follows the plan, which has come to `planned` since the last setpoint:
    /// behind by the way of [`FOLLOWING_DELAY_S`] at most, and as fast but for what may change in that time.
    fn is_on_plan(&self, config: &Config, planned: &Motion, measured: &Measured) -> bool {
        (0..JOINTS).all(|j| {
            let way = FOLLOWING_DELAY_S * self.motion.v[j].abs().max(planned.v[j].abs());
            let change = FOLLOWING_DELAY_S * config.limits[j].a_max;
            (measured.q[j] - planned.q[j]).abs() <= way + ENCODER_NOISE
                && (measured.dq[j] - planned.v[j]).abs() <= change + SPEED_NOISE
        })
    }
}
