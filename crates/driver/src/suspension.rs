//! A driver that was suspended while the robot moved begins again where the robot is measured.

use crate::acceptance::GAP_MAX_TICKS;
use crate::follower::{Config, ENCODER_NOISE, Input, NOISE, State, Step, StepKind};
use crate::plan::Motion;
use crate::port::Measured;
use messages::{JOINTS, Stamp, TICK_HZ, TICK_S, known_bug};

/// Largest noise of a measured speed, rad/s or m/s: eight standard deviations of the simulated drives'. Assumption.
const SPEED_NOISE: f64 = 0.036;

/// The longest delay of a robot that follows its setpoints, ticks: 10 ms. The simulated drives (15 Hz, 1 ms of transport) stay
/// 20 mrad behind at 2 rad/s. Assumption.
const FOLLOWING_DELAY_TICKS: u64 = 15;

/// A setpoint is on its way to the drives for so long, ticks: 2 ms. Assumption.
const SETPOINT_TICKS: u64 = 3;

/// How much faster than its limit a sound joint may be measured. As `safety` judges measurements.
const OVERSPEED: f64 = 1.25;

/// A robot that stops by itself brakes this much harder than its limit at most. Assumption.
const BRAKING_FACTOR: f64 = 5.0;

/// Age of a measurement, ns, beyond which it does not say where the robot stands now: 10 ms, the silence after which its
/// drives act by themselves.
const MEASURED_AGE_MAX_NS: u64 = 10_000_000;

impl State {
    /// Begins at index `k` where the robot is measured: a robot whose last driver died may still move, and drives that
    /// follow at once would take a standing setpoint as a step of the velocity. Joints that move stop from their measured
    /// speed within the limits, latched; no certificate covers that stop. A speed is believed where the positions of an
    /// `earlier` measurement confirm it; otherwise what is measured is held. Returns `None` if a number is not finite.
    pub fn begin(config: &Config, k: u64, earlier: &Measured, measured: &Measured) -> Option<Self> {
        let mut state = Self::hold(k, &measured.q)?;
        if !measured.dq.iter().all(|v| v.is_finite()) {
            return None;
        }
        let elapsed_s = measured.stamp.since(earlier.stamp) as f64 * 1e-9;
        let v = measured.dq.map(|v| if v.abs() <= SPEED_NOISE { 0.0 } else { v });
        let confirmed = (0..JOINTS).all(|j| {
            let limits = &config.limits[j];
            // A joint that brakes has come farther than its speed of now says, and never less far.
            let farther = (measured.q[j] - earlier.q[j] - v[j] * elapsed_s) * v[j].signum();
            let noise = ENCODER_NOISE + SPEED_NOISE * elapsed_s;
            let braked = BRAKING_FACTOR * limits.a_max * elapsed_s * elapsed_s;
            let alike = elapsed_s > 0.0 && (-noise..=noise + braked).contains(&farther);
            v[j] == 0.0 || (v[j].abs() <= OVERSPEED * limits.v_max && alike)
        });
        if confirmed && v.iter().any(|&v| v != 0.0) {
            let q = core::array::from_fn(|j| arrival(config, j, measured.q[j], v[j]));
            state.motion = Motion::stopping(&config.limits, q, &v, &[0.0; JOINTS]);
            state.holds_measured = false;
            state.latched = true;
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
    /// identity. If the driver missed more ticks than the silence that latches, or has no measurement to believe, it latches.
    /// Without a measurement it goes on with the certified stop, which is where the limits allow the robot to be.
    pub(crate) fn begin_again(
        &mut self,
        config: &Config,
        now: Stamp,
        input: &Input<'_>,
        ticks: u64,
        each: &mut impl FnMut(&Step),
    ) {
        let fresh = |measured: &&Measured| measured.apart_ns(now) <= MEASURED_AGE_MAX_NS;
        let finite = |measured: &&Measured| measured.dq.iter().all(|v| v.is_finite());
        let measured = input.measured.filter(fresh).filter(finite);
        let on_plan = measured.is_some_and(|measured| self.is_on_plan(config, now, ticks, measured));
        let place = measured.filter(|_| !on_plan).and_then(|measured| self.place(config, now, ticks, measured));
        self.latched |= ticks > config.silence_ticks || !(on_plan || place.is_some());
        let Some([q, v, a]) = place else {
            self.play(ticks, each);
            return;
        };
        // The index that is due is not missed: it is executed now.
        (self.executed_k, self.plan_ticks_played, self.chain) = (input.due_k, 0, None);
        self.motion = Motion::stopping(&config.limits, q, &v, &a);
        each(&Step { kind: StepKind::Measured, setpoint: self.setpoint() });
    }

    /// Where the motion begins again after `ticks`: positions and velocities as measured, and the accelerations of the plan. None
    /// if what is measured cannot be.
    fn place(&mut self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> Option<[[f64; JOINTS]; 3]> {
        let mut planned = self.motion;
        planned.play(ticks);
        let (elapsed_s, age_s) = (ticks as f64 * TICK_S, now.since(measured.stamp) as f64 * 1e-9);
        // The measurement may be older than the last setpoint, by so much.
        let sooner_s = (age_s + (FOLLOWING_DELAY_TICKS + SETPOINT_TICKS) as f64 * TICK_S - elapsed_s).max(0.0);
        // Each joint carried on or braked: its speed lies between the last one and rest, and is no farther from the last one
        // than the limit of acceleration allows, but for noise. A robot that braked harder is believed.
        let speed = |j: usize| {
            let (v, ahead, a_max) = (self.motion.v[j], planned.v[j], config.limits[j].a_max);
            let between = measured.dq[j].clamp(v.min(ahead).min(0.0), v.max(ahead).max(0.0));
            let allowed = between.clamp(v - a_max * elapsed_s, v + a_max * elapsed_s);
            if (allowed - between).abs() <= SPEED_NOISE + a_max * sooner_s { allowed } else { between }
        };
        let v = core::array::from_fn(speed);
        let believed = self.believe(config, self.index() + ticks, measured)?;
        let q = core::array::from_fn(|j| arrival(config, j, believed[j] + age_s * v[j], v[j]));
        Some([q, v, planned.a])
    }

    /// Whether every joint is near its setpoint. A robot that follows is at most [`FOLLOWING_DELAY_TICKS`] behind.
    pub(crate) fn is_near(&self, config: &Config, measured: &Measured) -> bool {
        let delay_s = (FOLLOWING_DELAY_TICKS + 2 * config.interface_delay_ticks) as f64 * TICK_S;
        let near = |j: usize| ENCODER_NOISE + delay_s * config.limits[j].v_max;
        (0..JOINTS).all(|j| (measured.q[j] - self.motion.q[j]).abs() <= near(j))
    }

    /// Whether the robot went on with the plan in the `ticks` since the last setpoint. The measurement is compared with two points of
    /// the plan: that of its own time, and the one [`FOLLOWING_DELAY_TICKS`] before. Every joint must lie between them, in position
    /// and in speed.
    fn is_on_plan(&self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> bool {
        let age_ticks = now.since(measured.stamp) * TICK_HZ / 1_000_000_000;
        // An interface delays by its mean, or by twice as much, or not at all.
        let delay_ticks = age_ticks + FOLLOWING_DELAY_TICKS + 2 * config.interface_delay_ticks;
        let (mut ahead, mut behind) = (self.motion, self.motion);
        ahead.play(ticks.saturating_sub(age_ticks));
        behind.play(ticks.saturating_sub(delay_ticks));
        // Before the last setpoint the robot came with its speed.
        let sooner_s = delay_ticks.saturating_sub(ticks) as f64 * TICK_S;
        (0..JOINTS).all(|j| {
            let limits = &config.limits[j];
            let (q, v) = (behind.q[j] - sooner_s * behind.v[j], behind.v[j]);
            let noise = SPEED_NOISE + sooner_s * limits.a_max;
            let apart = ENCODER_NOISE + sooner_s * sooner_s * limits.a_max / 2.0;
            measured.q[j] >= q.min(ahead.q[j]) - apart
                && measured.q[j] <= q.max(ahead.q[j]) + apart
                && measured.dq[j] >= v.min(ahead.v[j]) - noise
                && measured.dq[j] <= v.max(ahead.v[j]) + noise
        })
    }
}

/// Where joint `j`, now at `q` with speed `v`, will be when a setpoint that is sent now reaches it, rad or m. A servo may stand a
/// little beyond a limit; a setpoint may not.
fn arrival(config: &Config, j: usize, q: f64, v: f64) -> f64 {
    let way = config.interface_delay_ticks as f64 * TICK_S * v;
    let nearest = (q + way).clamp(config.limits[j].q_min, config.limits[j].q_max);
    if (nearest - q - way).abs() <= NOISE + way.abs() { nearest } else { q + way }
}
