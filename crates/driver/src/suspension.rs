//! Restarts a driver that was suspended while the robot moved: it continues from the measured motion.

use crate::acceptance::GAP_MAX_TICKS;
use crate::follower::{Config, Input, State, Step, StepKind};
use crate::limits::JointLimits;
use crate::plan::{PlanPlayback, duration_s, slowed, stopping};
use crate::port::{ENCODER_NOISE, Measured, NOISE};
use messages::{JOINTS_MAX, JointMotion, Stamp, TICK_HZ, TICK_S};

/// Largest noise of a measured speed, rad/s or m/s: eight standard deviations of the simulated drives' noise.
/// Assumption.
const SPEED_NOISE: f64 = 0.036;

/// The longest delay of a robot that follows its setpoints, ticks: 10 ms. The simulated drives (15 Hz, 1 ms of
/// transport) lag by 20 mrad at 2 rad/s. Assumption.
const FOLLOWING_DELAY_TICKS: u64 = 15;

/// Time of a setpoint on its way to the drives, ticks: 2 ms. Assumption.
const SETPOINT_TICKS: u64 = 3;

/// Largest measured speed of a sound joint, as a multiple of its limit. `safety` uses the same value.
const OVERSPEED: f64 = 1.25;

/// Largest braking of a robot that stops by itself, as a multiple of its limit. Assumption.
const BRAKING_FACTOR: f64 = 5.0;

/// A moving robot is near its certified stop if every joint is close to it: within the distance of this many
/// seconds at its largest speed. That is 10 mrad at 2 rad/s, half the lag of a simulated robot. Assumption.
const NEAR_S: f64 = 0.005;

/// A robot moves as the certified stop does if every joint's speed is close: within what the joint brakes by in
/// this many seconds. That is 0.2 rad/s at 10 rad/s^2, the overshoot of drives of 15 Hz when their reference begins
/// to brake. Assumption.
const AS_FAST_S: f64 = 0.02;

/// The longest remaining stop of a driver that goes on more slowly, s: twice the longest stop of the robots.
const STOP_MAX_S: f64 = 1.0;

/// A driver starts no sooner than this after another one ended, ticks: 20 ms. By then the robot stops by itself. It
/// compares the first setpoint with no older one. A process waits longer: for [`Standstill`].
pub const START_AFTER_TICKS: u64 = TICK_HZ / 50;

/// A driver that starts on a moving robot waits this long for it to stand, ticks: 1 s, twice the longest stop of
/// the robots. Meanwhile the robot stops by itself, if anything stops it. A driver that led it from the measured
/// posture would lead it off that path.
pub const STANDS_WITHIN_TICKS: u64 = TICK_HZ;

/// A robot stands once every joint has stayed in a band of `ENCODER_NOISE` for this long, ns: 100 ms. A joint
/// that creeps through the band in that time moves at 4 mrad/s or mm/s. `safety` judges rest over the same time.
pub const STOOD_FOR_NS: u64 = 100_000_000;

/// Decides when a robot stands. It counts the times of the robot's own measurements, so a silent robot never stands.
/// A measurement stamped `Stamp::NONE` was never made, so the count begins with the first other one.
#[derive(Clone, Copy, Debug)]
pub struct Standstill {
    /// The measurement at the centre of the band that no joint has left since.
    since: Measured,
    /// Stamp of the first measurement.
    first: Stamp,
}

impl Standstill {
    /// Begins at the robot's first measurement.
    #[must_use]
    pub fn new(measured: &Measured) -> Self {
        Self { since: *measured, first: measured.stamp }
    }

    /// Takes the next measurement. Returns true if the robot has stood for [`STOOD_FOR_NS`].
    pub fn stands(&mut self, measured: &Measured) -> bool {
        if self.first == Stamp::NONE {
            *self = Self::new(measured);
        }
        let stays = |j: usize| (measured.q[j] - self.since.q[j]).abs() <= ENCODER_NOISE;
        if !(0..JOINTS_MAX).all(stays) {
            self.since = *measured;
        }
        measured.stamp.since(self.since.stamp) >= STOOD_FOR_NS
    }

    /// Takes the next measurement. Returns true if the robot stands, or has not come to stand for
    /// [`STANDS_WITHIN_TICKS`] of its own time.
    pub fn is_over(&mut self, measured: &Measured) -> bool {
        let stands = self.stands(measured);
        stands || measured.stamp.since(self.first) >= STANDS_WITHIN_TICKS * 1_000_000_000 / TICK_HZ
    }
}

impl State {
    /// Begins at index `k` from the measured posture, [`START_AFTER_TICKS`] after any other driver ended. A robot
    /// whose last driver died may still move, and drives that follow at once would take a standing setpoint as a
    /// step of the velocity. Joints that move stop from their measured speed within the limits, and the fault is
    /// latched. No certificate covers that stop. A speed is believed if the positions of an `earlier` measurement
    /// confirm it. Otherwise the driver holds the measured posture. Returns `None` if a number is not finite.
    pub fn begin(config: &Config, k: u64, earlier: &Measured, measured: &Measured) -> Option<Self> {
        let mut state = Self::hold(k, &measured.q)?;
        if !measured.dq.iter().all(|v| v.is_finite()) {
            return None;
        }
        let elapsed_s = measured.stamp.since(earlier.stamp) as f64 * 1e-9;
        let v = measured.dq.map(|v| if v.abs() <= SPEED_NOISE { 0.0 } else { v });
        let confirmed = (0..JOINTS_MAX).all(|j| {
            let limits = &config.limits[j];
            // A braking joint has come at least as far as its present speed gives, because it was faster before.
            let farther = (measured.q[j] - earlier.q[j] - v[j] * elapsed_s) * v[j].signum();
            let noise = ENCODER_NOISE + SPEED_NOISE * elapsed_s;
            let braked = BRAKING_FACTOR * limits.a_max * elapsed_s * elapsed_s;
            let alike = elapsed_s > 0.0 && (-noise..=noise + braked).contains(&farther);
            v[j] == 0.0 || (v[j].abs() <= OVERSPEED * limits.v_max && alike)
        });
        if confirmed && v.iter().any(|&v| v != 0.0) {
            let q = core::array::from_fn(|j| arrival(config, j, measured.q[j], v[j]));
            state.motion = stopping(&config.limits, q, &v, &[0.0; JOINTS_MAX]);
            state.holds_measured = false;
            state.latched = true;
        }
        Some(state)
    }

    /// Returns the number of ticks for which the driver was suspended, if it is too large for one motion.
    pub(crate) fn suspension(&self, due_k: u64) -> Option<u64> {
        let ticks = due_k.saturating_sub(self.index());
        (ticks > GAP_MAX_TICKS && !self.motion.is_at_rest()).then_some(ticks)
    }

    /// Continues after the driver was suspended for `ticks` while the robot moved.
    ///
    /// - The robot is measured near where the certified stop is by now: the driver goes on with that stop.
    /// - It is near another point of that stop: the stop goes on from there, as slowly as the robot moves along it
    ///   ([`State::rejoined`]). The robot stays on the certified path.
    /// - It is elsewhere: neither the plan nor a command contains its position. So the motion begins at the
    ///   measured posture and
    ///   stops within the limits. No certificate covers that stop.
    /// - No measurement can be believed: the driver goes on with the certified stop, which is where the limits
    ///   allow the robot to be.
    ///
    /// The second and the third case give a new identity. The driver latches the fault if it missed more ticks than
    /// the silence that latches, or if it believes no measurement.
    pub(crate) fn begin_again(
        &mut self,
        config: &Config,
        now: Stamp,
        input: &Input<'_>,
        ticks: u64,
        each: &mut impl FnMut(&Step),
    ) {
        let fresh = |measured: &&Measured| measured.apart_ns(now) <= crate::follower::MEASURED_AGE_MAX_NS;
        let finite = |measured: &&Measured| measured.dq.iter().all(|v| v.is_finite());
        let measured = input.measured.filter(fresh).filter(finite);
        let on_plan = measured.is_some_and(|measured| self.is_on_plan(config, now, ticks, measured));
        let motion = measured.filter(|_| !on_plan).and_then(|measured| {
            let rejoined = self.rejoined(config, now, ticks, measured);
            rejoined.or_else(|| self.place(config, now, ticks, measured))
        });
        self.latched |= ticks > config.silence_ticks || !(on_plan || motion.is_some());
        let Some(motion) = motion else {
            self.play(ticks, each);
            return;
        };
        // The due index is not missed: it is executed now.
        (self.executed_k, self.plan_ticks_played, self.chain) = (input.due_k, 0, None);
        self.motion = motion;
        each(&Step { kind: StepKind::Measured, setpoint: self.setpoint() });
    }

    /// Returns the certified stop from its point nearest to the measurement, among the points of the last `ticks`.
    /// Returns `None` if a joint is not near it in position or speed, or if the remaining stop took longer than
    /// [`STOP_MAX_S`].
    ///
    /// Let Q(s) be the certified stop, V its speeds at that point, and v the measured speeds. The remaining stop is
    /// Q(s + c t),
    ///
    /// ```text
    /// c = sum_j (v_j V_j / v_max_j^2) / sum_j (V_j^2 / v_max_j^2), at most 1
    /// ```
    ///
    /// Speeds, accelerations and jerks are c, c^2 and c^3 times the certified ones. Torques lie between the
    /// certified ones and those that hold the posture.
    fn rejoined(&self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> Option<JointMotion> {
        let delay_ticks = age_ticks(now, measured) + config.interface_delay_ticks;
        let apart = |s: u64| {
            let seen_s = s.saturating_sub(delay_ticks) as f64 * TICK_S;
            let apart = |j: usize| (measured.q[j] - self.motion.ahead(j, seen_s)[0]).abs() / near(&config.limits[j]);
            (0..JOINTS_MAX).map(apart).fold(0.0, f64::max)
        };
        let nearest = |best: (u64, f64), s: u64| {
            let apart = apart(s);
            if apart <= best.1 { (s, apart) } else { best }
        };
        let last = ticks.min((duration_s(&self.motion.plan) / TICK_S) as u64 + 1);
        let (s, apart) = (0..=last).fold((0, f64::INFINITY), nearest);
        let mut motion = self.motion;
        motion.play(s);
        let (mut along, mut planned) = (0.0, 0.0);
        for (j, limits) in config.limits.iter().enumerate() {
            along += measured.dq[j] * motion.v[j] / (limits.v_max * limits.v_max);
            planned += motion.v[j] * motion.v[j] / (limits.v_max * limits.v_max);
        }
        let share = if along < planned { along / planned } else { 1.0 };
        let is_as_fast = |j: usize| (measured.dq[j] - share * motion.v[j]).abs() <= as_fast(&config.limits[j]);
        let near = apart <= 1.0 && moves(measured);
        let fits = near && (0..JOINTS_MAX).all(is_as_fast) && duration_s(&motion.plan) <= share * STOP_MAX_S;
        fits.then(|| slowed(&motion, share))
    }

    /// Returns the stop from the measured posture after `ticks`, with the measured positions and velocities and the
    /// accelerations of the plan. Returns `None` if the measurement is impossible.
    fn place(&mut self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> Option<JointMotion> {
        let mut planned = self.motion;
        planned.play(ticks);
        let (elapsed_s, age_s) = (ticks as f64 * TICK_S, now.since(measured.stamp) as f64 * 1e-9);
        // The measurement may be older than the last setpoint, by this much.
        let sooner_s = (age_s + (FOLLOWING_DELAY_TICKS + SETPOINT_TICKS) as f64 * TICK_S - elapsed_s).max(0.0);
        // Each joint carried on or braked, so its speed lies between the last one and rest. But for noise, it differs
        // from the last one by no more than the acceleration limit allows. A robot that braked harder is believed.
        let speed = |j: usize| {
            let (v, ahead, a_max) = (self.motion.v[j], planned.v[j], config.limits[j].a_max);
            let between = measured.dq[j].clamp(v.min(ahead).min(0.0), v.max(ahead).max(0.0));
            let allowed = between.clamp(v - a_max * elapsed_s, v + a_max * elapsed_s);
            if (allowed - between).abs() <= SPEED_NOISE + a_max * sooner_s { allowed } else { between }
        };
        let v = core::array::from_fn(speed);
        let believed = self.believe(config, self.index() + ticks, measured)?;
        let q = core::array::from_fn(|j| arrival(config, j, believed[j] + age_s * v[j], v[j]));
        Some(stopping(&config.limits, q, &v, &planned.a))
    }

    /// Returns true if the robot is as near its setpoints as a robot that follows them. Each joint lags by the
    /// longest delay at most.
    pub(crate) fn is_near(&self, config: &Config, measured: &Measured) -> bool {
        let delay_s = following_delay_ticks(config) as f64 * TICK_S;
        let near = |j: usize| ENCODER_NOISE + delay_s * config.limits[j].v_max;
        (0..JOINTS_MAX).all(|j| (measured.q[j] - self.motion.q[j]).abs() <= near(j))
    }

    /// Returns true if the robot followed the plan during the last `ticks`. It compares the measurement with two
    /// points of the plan: the one at the measurement's time, and the one [`following_delay_ticks`] before. Every
    /// joint must be between them, or near, in position and speed. A standing robot must stand where the plan
    /// ended, because nothing moves it there.
    fn is_on_plan(&self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> bool {
        let (moves, age_ticks) = (moves(measured), age_ticks(now, measured));
        let delay_ticks = age_ticks + following_delay_ticks(config);
        let (mut ahead, mut behind) = (self.motion, self.motion);
        ahead.play(ticks.saturating_sub(age_ticks));
        behind.play(ticks.saturating_sub(delay_ticks));
        // Before the last setpoint the robot came with its speed.
        let sooner_s = delay_ticks.saturating_sub(ticks) as f64 * TICK_S;
        (0..JOINTS_MAX).all(|j| {
            let limits = &config.limits[j];
            let (q, v) = (behind.q[j] - sooner_s * behind.v[j], behind.v[j]);
            let noise = if moves { as_fast(limits) } else { SPEED_NOISE } + sooner_s * limits.a_max;
            let near = if moves { near(limits) } else { ENCODER_NOISE };
            let apart = near + sooner_s * sooner_s * limits.a_max / 2.0;
            measured.q[j] >= q.min(ahead.q[j]) - apart
                && measured.q[j] <= q.max(ahead.q[j]) + apart
                && measured.dq[j] >= v.min(ahead.v[j]) - noise
                && measured.dq[j] <= v.max(ahead.v[j]) + noise
        })
    }
}

/// Returns the longest delay of a robot that follows its setpoints through its interface, ticks. The delay of an
/// interface is its mean, twice as much, or zero.
fn following_delay_ticks(config: &Config) -> u64 {
    FOLLOWING_DELAY_TICKS + 2 * config.interface_delay_ticks
}

/// Returns true if a measured speed is more than noise.
fn moves(measured: &Measured) -> bool {
    measured.dq.iter().any(|v| v.abs() > SPEED_NOISE)
}

/// Returns the age of a measurement, ticks.
fn age_ticks(now: Stamp, measured: &Measured) -> u64 {
    now.since(measured.stamp) * TICK_HZ / 1_000_000_000
}

/// Returns the largest distance at which a joint counts as near the certified stop, rad or m.
fn near(limits: &JointLimits) -> f64 {
    ENCODER_NOISE + NEAR_S * limits.v_max
}

/// Returns the largest difference of speed, rad/s or m/s, at which a joint still moves as the certified stop does.
fn as_fast(limits: &JointLimits) -> f64 {
    SPEED_NOISE + AS_FAST_S * limits.a_max
}

/// Returns where joint `j`, now at `q` with speed `v`, will be when a setpoint that is sent now reaches it, rad or m.
fn arrival(config: &Config, j: usize, q: f64, v: f64) -> f64 {
    let way = config.interface_delay_ticks as f64 * TICK_S * v;
    config.limits[j].within(q + way, NOISE + way.abs())
}
