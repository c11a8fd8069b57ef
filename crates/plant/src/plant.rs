//! The joints under their drives, integrated in the plant's own steps.

use crate::config::{Config, Reaction};
use crate::description::JointKind;
use crate::dynamics::Drive;
use crate::injection::{Injected, Injection};
use crate::judge::{JUDGE_STEPS, Judge};
use crate::kinematics::Frames;
use crate::motor::FRICTION_COMPENSATED;
use crate::noise::Noise;
use driver::Drives;
use messages::{JOINTS_MAX, Layout, Stamp, StopPlan};

/// Length of a step, ns: 2 kHz. Assumption: the rate of a joint's position loop.
pub const STEP_NS: u64 = 500_000;
const STEP_S: f64 = STEP_NS as f64 * 1e-9;
/// The longest time that one call integrates, ns. The rest follows in the next call, so no time is lost.
pub const CATCH_UP_NS: u64 = 1_000_000_000;
/// The longest transport delay, ns. With it and 1500 setpoints per second 30 are under way.
pub(crate) const DELAY_MAX_NS: u64 = 20_000_000;
/// Setpoints that can be under way. A further one replaces the oldest.
const UNDER_WAY_MAX: usize = 32;

/// After a reaction a setpoint must begin this near to the joint's position, rad. Assumption: 0.02, a little more than
/// the tracking error and the noise.
pub const NEAR_RAD: f64 = 0.02;
/// The same distance for a joint that slides, m. Assumption: 5 mm.
pub const NEAR_M: f64 = 0.005;
/// Noise of a joint that slides, m, over that of one that turns, rad: as its bounds of tracking errors. Assumption: a spindle
/// moves it by less.
const SLIDING_SHARE: f64 = 0.2;
/// After a reaction a setpoint's speed must be this near to the joint's, rad/s. Assumption: 0.1, the amount by
/// which a joint brakes within the age of a measurement, plus the noise of its speed.
pub const NEAR_RAD_PER_S: f64 = 0.1;
/// The same speed difference for a joint that slides, m/s. Assumption: four standard deviations of the noise.
pub const NEAR_M_PER_S: f64 = 0.02;

/// A target for the drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Index. While the drives follow setpoints, they ignore a setpoint that is not newer than the last.
    pub k: u64,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Joint accelerations, rad/s^2 or m/s^2.
    pub a: [f64; JOINTS_MAX],
    /// The stop from (q, v, a). Only [`Reaction::Play`] uses it.
    pub plan: StopPlan,
}

/// A measurement of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Time of the step at which the sample was taken.
    pub stamp: Stamp,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub dq: [f64; JOINTS_MAX],
    /// Motor torques, N m or N.
    pub tau: [f64; JOINTS_MAX],
    /// State that the drives report.
    pub drives: Drives,
    /// True if the watchdog fired and no setpoint was taken since.
    pub reacting: bool,
}

/// The true motion of the joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Time of the step.
    pub stamp: Stamp,
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Joint velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Motor torques or forces in the step before, N m or N. Zero where a brake holds.
    pub tau: [f64; JOINTS_MAX],
}

/// The present action of the drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// The reference brakes, then holds its place.
    Holding {
        /// True if the watchdog fired.
        reacting: bool,
    },
    /// The drives follow setpoints.
    Following,
    /// The watchdog fired, and the motors damp.
    Damping,
    /// The watchdog fired, and the drives play the plan of the last setpoint.
    Playing,
}

/// Position, velocity and acceleration of the reference of one joint.
type Reference = [f64; 3];

/// State of the joints and drives.
#[derive(Clone, Debug)]
pub struct Plant {
    truth: Truth,
    steps: u64,
    mode: Mode,
    /// The setpoint in force, and the time since when it is.
    last: Setpoint,
    last_at: Stamp,
    /// The reference of [`Mode::Holding`]: positions and velocities.
    held: ([f64; JOINTS_MAX], [f64; JOINTS_MAX]),
    /// Setpoints under way with the time of their arrival, oldest first from `first`.
    under_way: [(Stamp, Setpoint); UNDER_WAY_MAX],
    first: usize,
    waiting: usize,
    injected: Injected,
    noise: Noise,
    measured: Measured,
    /// The step of `measured`: reading twice in one step draws no new noise.
    measured_step: Option<u64>,
}

impl Plant {
    /// Creates a plant at rest at `q` at the time `now`. `seed` is the seed of the noise.
    pub fn new(config: &Config, now: Stamp, q: &[f64; JOINTS_MAX], seed: u64) -> Self {
        let zero = [0.0; JOINTS_MAX];
        let rest = Setpoint { k: 0, q: *q, v: zero, a: zero, plan: StopPlan::ZERO };
        let drives = Drives::SOUND;
        let mut plant = Self {
            truth: Truth { stamp: now, q: *q, v: zero, tau: zero },
            steps: 0,
            mode: Mode::Holding { reacting: false },
            last: rest,
            last_at: now,
            held: (*q, zero),
            under_way: [(now, rest); UNDER_WAY_MAX],
            first: 0,
            waiting: 0,
            injected: Injected::default(),
            noise: Noise::new(seed),
            measured: Measured { stamp: now, q: *q, dq: zero, tau: zero, drives, reacting: false },
            measured_step: None,
        };
        plant.stay_inside(config);
        plant
    }

    /// Returns the true motion of the joints.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// Returns the setpoint in force, and its time of arrival at the drives.
    pub fn followed(&self) -> (&Setpoint, Stamp) {
        (&self.last, self.last_at)
    }

    /// Returns true if the watchdog fired and no setpoint was taken since.
    pub fn reacting(&self) -> bool {
        match self.mode {
            Mode::Holding { reacting } => reacting,
            Mode::Following => false,
            Mode::Damping | Mode::Playing => true,
        }
    }

    /// Returns the time by which the plant is behind `now`, ns. It is less than a step, unless a call was longer
    /// than [`CATCH_UP_NS`].
    pub fn behind_ns(&self, now: Stamp) -> u64 {
        now.since(self.truth.stamp)
    }

    /// Switches a fault on.
    pub fn inject(&mut self, fault: Injection) {
        self.injected.switch_on(fault, &self.truth.q, self.steps);
    }

    /// Switches every fault off. A joint that was braked while others followed then catches up as fast as it can.
    pub fn repair(&mut self) {
        self.injected = Injected::default();
    }

    /// Integrates whole steps until `now`, at most [`CATCH_UP_NS`] in one call.
    pub fn advance(&mut self, config: &Config, now: Stamp) {
        self.advance_each(config, now, |_, _| {});
    }

    /// Does the same as `advance`. `judge` looks every [`JUDGE_STEPS`] steps.
    pub fn advance_judged(&mut self, config: &Config, now: Stamp, judge: &mut Judge) {
        self.advance_each(config, now, |steps, truth| {
            if steps % JUDGE_STEPS == 0 {
                judge.look(config, truth);
            }
        });
    }

    fn advance_each(&mut self, config: &Config, now: Stamp, mut each: impl FnMut(u64, &Truth)) {
        let due = self.behind_ns(now).min(CATCH_UP_NS) / STEP_NS;
        for _ in 0..due {
            self.step(config);
            each(self.steps, &self.truth);
        }
    }

    /// Takes a setpoint that arrives at the robot. Returns `false` if it was not taken:
    ///
    /// - a fault refuses it, the emergency stop is pressed, or the motors have no power;
    /// - a number is not finite, or a duration is negative;
    /// - since `now` the robot went on by itself for longer than its watchdog waits, so it has left the place that
    ///   the setpoint assumes;
    /// - the drives follow no setpoints (at the start or after a reaction), and the setpoint is not near the
    ///   robot's position ([`NEAR_RAD`], [`NEAR_M`]) and speed ([`NEAR_RAD_PER_S`], [`NEAR_M_PER_S`]).
    ///
    /// It integrates until `now` first, so a judge must have been advanced before.
    pub fn receive(&mut self, config: &Config, now: Stamp, setpoint: &Setpoint) -> bool {
        self.advance(config, now);
        let is_old = self.truth.stamp.since(now) > config.options.watchdog_ns;
        if is_old
            || self.injected.refuses()
            || !is_sound(setpoint)
            || (self.begins() && !self.is_near(config, setpoint))
        {
            return false;
        }
        if self.mode == Mode::Following && setpoint.k <= self.newest_k() {
            return true;
        }
        if self.waiting == UNDER_WAY_MAX {
            self.first = (self.first + 1) % UNDER_WAY_MAX;
            self.waiting -= 1;
        }
        self.under_way[(self.first + self.waiting) % UNDER_WAY_MAX] = (now.plus_ns(config.options.delay_ns), *setpoint);
        self.waiting += 1;
        true
    }

    /// Does the same as `receive`. It advances the judge and shows it every setpoint that was taken.
    pub fn receive_judged(&mut self, config: &Config, now: Stamp, setpoint: &Setpoint, judge: &mut Judge) -> bool {
        self.advance_judged(config, now, judge);
        let begins = self.begins();
        let taken = self.receive(config, now, setpoint);
        if taken {
            judge.received(config, now, setpoint, begins);
        }
        taken
    }

    /// Returns the newest sample at `now`. It integrates until `now` first.
    pub fn measure(&mut self, config: &Config, now: Stamp) -> Measured {
        self.advance(config, now);
        if self.measured_step != Some(self.steps) {
            self.measured_step = Some(self.steps);
            self.sample(config);
        }
        self.measured.drives = Drives {
            emergency_stop: self.injected.emergency_stop,
            fault: self.injected.drive_fault(),
            powered: self.injected.sag.is_none(),
        };
        self.measured.reacting = self.reacting();
        self.measured
    }

    fn sample(&mut self, config: &Config) {
        let measured = &mut self.measured;
        measured.stamp = self.truth.stamp;
        for j in 0..config.links.body.joints.len() {
            let (noise_q, noise_v) = self.noise.pair();
            if self.injected.is_frozen(j) {
                continue;
            }
            let slides = config.links.body.joints[j].kind == JointKind::Prismatic;
            let share = if slides { SLIDING_SHARE } else { 1.0 };
            let (noise, step) = (share * config.options.encoder_noise_rad, share * config.options.encoder_step_rad);
            let q = self.truth.q[j] + noise * noise_q;
            measured.q[j] = if step > 0.0 { (q / step).round() * step } else { q };
            // The drive differentiates its encoder through a filter as fast as its own loop.
            measured.dq[j] = self.truth.v[j] + noise * config.omega * noise_v;
            measured.tau[j] = self.truth.tau[j];
        }
        self.injected.distort(&mut measured.q, &mut measured.dq);
    }

    /// Returns true if the next setpoint would be the first after a start or a reaction.
    fn begins(&self) -> bool {
        self.mode != Mode::Following && self.waiting == 0
    }

    fn is_near(&self, config: &Config, setpoint: &Setpoint) -> bool {
        config.body().joints.iter().enumerate().all(|(j, joint)| {
            let (near, near_speed) = match joint.kind {
                JointKind::Revolute => (NEAR_RAD, NEAR_RAD_PER_S),
                JointKind::Prismatic => (NEAR_M, NEAR_M_PER_S),
            };
            (setpoint.q[j] - self.truth.q[j]).abs() <= near && (setpoint.v[j] - self.truth.v[j]).abs() <= near_speed
        })
    }

    fn newest_k(&self) -> u64 {
        match self.waiting {
            0 => self.last.k,
            waiting => self.under_way[(self.first + waiting - 1) % UNDER_WAY_MAX].1.k,
        }
    }

    /// Makes one step with semi-implicit Euler, so that the joints' energy does not grow by itself.
    fn step(&mut self, config: &Config) {
        self.switch(config);
        let (posture, pushes) = self.drives(config);
        let a = config.links.dynamics.accelerations(&posture, &self.truth.v, &pushes);
        for ((q, v), a) in self.truth.q.iter_mut().zip(&mut self.truth.v).zip(a) {
            *v += a * STEP_S;
            *q += *v * STEP_S;
        }
        self.stay_inside(config);
        self.truth.stamp = self.truth.stamp.plus_ns(STEP_NS);
        self.steps += 1;
    }

    /// Takes the setpoints that have arrived, and checks the watchdog.
    fn switch(&mut self, config: &Config) {
        let now = self.truth.stamp;
        if !self.injected.all_driven() {
            // The reference stays where the joints are, so the return of the drives moves nothing.
            self.waiting = 0;
            self.mode = Mode::Holding { reacting: false };
            self.held = (self.truth.q, self.truth.v);
            return;
        }
        while self.waiting > 0 && self.under_way[self.first].0 <= now {
            (self.last_at, self.last) = self.under_way[self.first];
            self.first = (self.first + 1) % UNDER_WAY_MAX;
            self.waiting -= 1;
            self.mode = Mode::Following;
        }
        let silent = self.waiting == 0 && now.since(self.last_at) > config.options.watchdog_ns;
        if self.mode == Mode::Following && silent {
            self.held =
                (std::array::from_fn(|j| self.extrapolated(j)[0]), std::array::from_fn(|j| self.extrapolated(j)[1]));
            self.mode = match config.options.reaction {
                Reaction::Damp => Mode::Damping,
                Reaction::Play if self.came_with_a_stop() => Mode::Playing,
                Reaction::Hold | Reaction::Play => Mode::Holding { reacting: true },
            };
        }
        if let Mode::Holding { .. } = self.mode {
            for j in 0..JOINTS_MAX {
                let (v, change) = (self.held.1[j], config.links.motors[j].stopping * STEP_S);
                let slower = v - v.clamp(-change, change);
                self.held.0[j] += (v + slower) / 2.0 * STEP_S;
                self.held.1[j] = slower;
            }
        }
    }

    /// Returns the posture, and the drive of each joint in this step.
    fn drives(&mut self, config: &Config) -> (crate::dynamics::Posture, [Drive; JOINTS_MAX]) {
        let mut frames = Frames::default();
        config.links.body.forward(&self.truth.q, &mut frames);
        let posture = config.links.dynamics.at(&frames);
        let (gravity, diagonal) = config.links.drive_model(&frames, &posture);
        let pushes = std::array::from_fn(|j| {
            let (motor, q, v) = (&config.links.motors[j], self.truth.q[j], self.truth.v[j]);
            if let Some(speed) = self.injected.braked_to(j) {
                self.truth.tau[j] = 0.0;
                return Drive::Acceleration(((speed - v) / STEP_S).clamp(-motor.braking, motor.braking));
            }
            let (acceleration, help) = match self.reference(j) {
                None => (-motor.damping_rate * v, 0.0),
                Some(reference) => (
                    motor.follow(config.omega, config.options.damping_ratio, reference, q, v),
                    FRICTION_COMPENSATED * motor.friction(reference[1]),
                ),
            };
            let torque = diagonal[j] * acceleration + gravity[j] + help;
            self.truth.tau[j] = torque.clamp(-motor.effort_max, motor.effort_max);
            Drive::Torque(self.truth.tau[j] - motor.friction(v))
        });
        (posture, pushes)
    }

    /// Returns the reference of a joint, with the faults that change it. Returns `None` while the motors only damp.
    fn reference(&self, j: usize) -> Option<Reference> {
        let [mut q, mut v, mut a] = match self.mode {
            Mode::Holding { .. } => [self.held.0[j], self.held.1[j], 0.0],
            Mode::Following => self.extrapolated(j),
            Mode::Damping => return None,
            Mode::Playing => self.played(j),
        };
        if let Some(about) = self.injected.setpoint_mirror[j] {
            (q, v, a) = (2.0 * about - q, -v, -a);
        }
        if let Some(swing) = self.injected.swing[j] {
            let (sin, cos) = (swing.omega * (self.steps - swing.since_step) as f64 * STEP_S).sin_cos();
            q += swing.amplitude * sin;
            v += swing.amplitude * swing.omega * cos;
            a -= swing.amplitude * swing.omega * swing.omega * sin;
        }
        Some([q, v, a])
    }

    fn since_last_s(&self) -> f64 {
        self.truth.stamp.since(self.last_at) as f64 * 1e-9
    }

    /// Returns q + v t + a t^2 / 2 of the setpoint in force.
    fn extrapolated(&self, j: usize) -> Reference {
        let (t, v, a) = (self.since_last_s(), self.last.v[j], self.last.a[j]);
        [self.last.q[j] + t * (v + t * a / 2.0), v + t * a, a]
    }

    /// Returns true if the setpoint in force came with a stop for every moving joint. Points of a trajectory
    /// controller have none.
    fn came_with_a_stop(&self) -> bool {
        (0..JOINTS_MAX).all(|j| {
            let stands = self.last.v[j] == 0.0 && self.last.a[j] == 0.0;
            stands || self.last.plan.duration_s[j].iter().sum::<f64>() > 0.0
        })
    }

    /// Returns the plan of the setpoint in force at the present time: phases of constant jerk, then rest.
    fn played(&self, j: usize) -> Reference {
        let (mut q, mut v, mut a) = (self.last.q[j], self.last.v[j], self.last.a[j]);
        let mut left = self.since_last_s();
        for (jerk, duration_s) in self.last.plan.jerk[j].iter().zip(&self.last.plan.duration_s[j]) {
            let t = left.min(*duration_s);
            q += t * (v + t * (a / 2.0 + t * jerk / 6.0));
            v += t * (a + t * jerk / 2.0);
            a += t * jerk;
            left -= t;
        }
        // A plan ends at rest. The remainder is rounding.
        if left > 0.0 { [q, 0.0, 0.0] } else { [q, v, a] }
    }

    /// Applies the mechanical stops. A joint that reaches one loses its speed there.
    fn stay_inside(&mut self, config: &Config) {
        for (j, joint) in config.links.body.joints.iter().enumerate() {
            let (q, v) = (&mut self.truth.q[j], &mut self.truth.v[j]);
            if *q < joint.urdf.q_min || *q > joint.urdf.q_max {
                *q = q.clamp(joint.urdf.q_min, joint.urdf.q_max);
                *v = 0.0;
            }
        }
    }
}

/// Returns true if every number is finite and no phase lasts a negative time.
fn is_sound(setpoint: &Setpoint) -> bool {
    let states = setpoint.q.iter().chain(&setpoint.v).chain(&setpoint.a);
    let plan = &setpoint.plan;
    states.chain(plan.jerk.iter().flatten()).all(|x| x.is_finite())
        && plan.duration_s.iter().flatten().all(|d| d.is_finite() && *d >= 0.0)
}
