//! A driver that was suspended while the robot moved begins again where the robot is measured.

use crate::acceptance::GAP_MAX_TICKS;
use crate::follower::{Config, ENCODER_NOISE, Input, NOISE, State, Step, StepKind};
use crate::limits::JointLimits;
use crate::plan::Motion;
use crate::port::Measured;
use messages::{JOINTS, Stamp, TICK_HZ, TICK_S};

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

/// A robot that moves is near its certified stop if no joint is farther from it than the way of so many seconds at its largest speed:
/// 10 mrad at 2 rad/s, half of what a simulated robot stays behind. Assumption.
const NEAR_S: f64 = 0.005;

/// It moves as the certified stop does if no joint's speed differs by more than what it brakes by in so many seconds: 0.2 rad/s at
/// 10 rad/s^2, what drives of 15 Hz overshoot by when their reference begins to brake. Assumption.
const AS_FAST_S: f64 = 0.02;

/// The longest stop that is left when a driver goes on more slowly, s: twice the longest stop of the robots.
const STOP_MAX_S: f64 = 1.0;

/// A driver starts no sooner after another one ended, ticks: 20 ms. By then the robot stops by itself. It compares the first setpoint
/// with no older one. A process waits longer: for [`Standstill`].
pub const START_AFTER_TICKS: u64 = TICK_HZ / 50;

/// A driver that starts on a robot that moves waits for it to stand, ticks: 1 s, twice the longest stop of the robots. It stops by
/// itself meanwhile, if anything stops it, and whoever leads it from where it is measured leads it off that way.
pub const STANDS_WITHIN_TICKS: u64 = TICK_HZ;

/// A robot stands once no joint has left a band of [`ENCODER_NOISE`] for so long, ns: 100 ms. A joint that creeps through the band
/// in that time moves at 4 mrad/s or mm/s. `safety` judges rest over the same time.
pub const STOOD_FOR_NS: u64 = 100_000_000;

/// Decides when a robot stands. It counts the times of the robot's own measurements, so a silent robot never stands.
#[derive(Clone, Copy, Debug)]
pub struct Standstill {
    /// No joint has left the band around this measurement.
    since: Measured,
}

impl Standstill {
    /// Begins at the robot's first measurement.
    #[must_use]
    pub fn new(measured: &Measured) -> Self {
        Self { since: *measured }
    }

    /// Takes the next measurement. Returns whether the robot has stood for [`STOOD_FOR_NS`].
    pub fn stands(&mut self, measured: &Measured) -> bool {
        let stays = |j: usize| (measured.q[j] - self.since.q[j]).abs() <= ENCODER_NOISE;
        if !(0..JOINTS).all(stays) {
            self.since = *measured;
        }
        measured.stamp.since(self.since.stamp) >= STOOD_FOR_NS
    }
}

impl State {
    /// Begins at index `k` where the robot is measured, [`START_AFTER_TICKS`] after any other driver ended: a robot whose last driver died may still move, and drives that
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
        (ticks > GAP_MAX_TICKS && !self.motion.at_rest()).then_some(ticks)
    }

    /// The driver was suspended for `ticks` while the robot moved.
    ///
    /// - The robot is measured near where the certified stop has come to meanwhile: the driver goes on with that stop.
    /// - It is near another point of that stop: the stop goes on from there, as slowly as the robot moves along it
    ///   ([`State::rejoined`]). Its way is the certified one.
    /// - It is elsewhere: neither the plan nor a command says where, so the motion begins where it is measured and stops within
    ///   the limits. No certificate covers that stop.
    /// - No measurement can be believed: the driver goes on with the certified stop, which is where the limits allow the robot to be.
    ///
    /// The second and the third have a new identity. The driver latches if it missed more ticks than the silence that latches, or
    /// if it believes no measurement.
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
        // The index that is due is not missed: it is executed now.
        (self.executed_k, self.plan_ticks_played, self.chain) = (input.due_k, 0, None);
        self.motion = motion;
        each(&Step { kind: StepKind::Measured, setpoint: self.setpoint() });
    }

    /// The certified stop from the point of it that is nearest to what is measured, of those in the last `ticks`. None if a joint
    /// is not near it, in position or in speed, or if that stop took longer than [`STOP_MAX_S`].
    ///
    /// With the certified stop Q(s), its speeds V at that point, and the measured speeds v, the stop that is left is Q(s + c t),
    ///
    /// ```text
    /// c = sum_j (v_j V_j / v_max_j^2) / sum_j (V_j^2 / v_max_j^2), at most 1
    /// ```
    ///
    /// Speeds, accelerations and jerks are c, c^2 and c^3 times the certified ones. Torques lie between the certified ones and those
    /// that hold the posture.
    fn rejoined(&self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> Option<Motion> {
        let delay_ticks = age_ticks(now, measured) + config.interface_delay_ticks;
        let apart = |s: u64| {
            let seen_s = s.saturating_sub(delay_ticks) as f64 * TICK_S;
            let apart = |j: usize| (measured.q[j] - self.motion.ahead(j, seen_s)[0]).abs() / near(&config.limits[j]);
            (0..JOINTS).map(apart).fold(0.0, f64::max)
        };
        let nearest = |best: (u64, f64), s: u64| {
            let apart = apart(s);
            if apart <= best.1 { (s, apart) } else { best }
        };
        let last = ticks.min((self.motion.duration_s() / TICK_S) as u64 + 1);
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
        let fits = near && (0..JOINTS).all(is_as_fast) && motion.duration_s() <= share * STOP_MAX_S;
        fits.then(|| motion.slowed(share))
    }

    /// The stop from where the robot is measured after `ticks`: from positions and velocities as measured, and the accelerations of
    /// the plan. None if what is measured cannot be.
    fn place(&mut self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> Option<Motion> {
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
        Some(Motion::stopping(&config.limits, q, &v, &planned.a))
    }

    /// Whether the robot is as near its setpoints as one that follows them: each joint lags by the longest delay at most.
    pub(crate) fn is_near(&self, config: &Config, measured: &Measured) -> bool {
        let delay_s = following_delay_ticks(config) as f64 * TICK_S;
        let near = |j: usize| ENCODER_NOISE + delay_s * config.limits[j].v_max;
        (0..JOINTS).all(|j| (measured.q[j] - self.motion.q[j]).abs() <= near(j))
    }

    /// Whether the robot followed the plan during the last `ticks`. The measurement is compared with two points of
    /// the plan: that of its own time, and the one [`following_delay_ticks`] before. Every joint must lie between them, in position
    /// and in speed, or near. A robot that stands must stand where the plan ended: nothing moves it there.
    fn is_on_plan(&self, config: &Config, now: Stamp, ticks: u64, measured: &Measured) -> bool {
        let (moves, age_ticks) = (moves(measured), age_ticks(now, measured));
        let delay_ticks = age_ticks + following_delay_ticks(config);
        let (mut ahead, mut behind) = (self.motion, self.motion);
        ahead.play(ticks.saturating_sub(age_ticks));
        behind.play(ticks.saturating_sub(delay_ticks));
        // Before the last setpoint the robot came with its speed.
        let sooner_s = delay_ticks.saturating_sub(ticks) as f64 * TICK_S;
        (0..JOINTS).all(|j| {
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

/// The longest delay of a robot that follows its setpoints through its interface, ticks. An interface delays by its mean, or by
/// twice as much, or not at all.
fn following_delay_ticks(config: &Config) -> u64 {
    FOLLOWING_DELAY_TICKS + 2 * config.interface_delay_ticks
}

/// Whether a measured speed is more than noise.
fn moves(measured: &Measured) -> bool {
    measured.dq.iter().any(|v| v.abs() > SPEED_NOISE)
}

/// Age of a measurement, ticks.
fn age_ticks(now: Stamp, measured: &Measured) -> u64 {
    now.since(measured.stamp) * TICK_HZ / 1_000_000_000
}

/// A joint is measured near the certified stop if it is no farther from it than this, rad or m.
fn near(limits: &JointLimits) -> f64 {
    ENCODER_NOISE + NEAR_S * limits.v_max
}

/// A joint is measured as fast as the certified stop if its speed differs by no more than this, rad/s or m/s.
fn as_fast(limits: &JointLimits) -> f64 {
    SPEED_NOISE + AS_FAST_S * limits.a_max
}

/// Where joint `j`, now at `q` with speed `v`, will be when a setpoint that is sent now reaches it, rad or m.
fn arrival(config: &Config, j: usize, q: f64, v: f64) -> f64 {
    let way = config.interface_delay_ticks as f64 * TICK_S * v;
    config.limits[j].within(q + way, NOISE + way.abs())
}
