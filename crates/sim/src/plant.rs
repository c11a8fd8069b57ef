//! The joints: second-order servos behind a transport delay, with saturation, and their encoders.

use crate::config::{Config, DELAY_MAX_TICKS};
use crate::cubic::cubic;
use crate::injection::{Injected, Injection};
use driver::{Driver, Drives, Measured, Setpoint};
use messages::{JOINTS, Stamp, TICK_S};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Length of the ring of delayed setpoints.
const RING: usize = DELAY_MAX_TICKS as usize + 1;

/// Ticks of a gap between two setpoints that are simulated one by one; after a second every joint has settled.
const GAP_MAX_TICKS: u64 = 1500;

/// State of the joints.
#[derive(Clone, Debug)]
pub struct Plant {
    q: [f64; JOINTS],
    v: [f64; JOINTS],
    last: Setpoint,
    ring: [Setpoint; RING],
    rng: Pcg64,
    measured: Measured,
    /// Index of `measured`: reading twice in one index draws no new noise.
    measured_k: Option<u64>,
    injected: Injected,
}

impl Plant {
    /// At rest in the initial posture at index `k`.
    pub fn new(config: &Config, k: u64, seed: u64) -> Self {
        Self::standing(k, &config.initial, seed)
    }

    /// At rest at `q` at index `k`.
    pub(crate) fn standing(k: u64, q: &[f64; JOINTS], seed: u64) -> Self {
        let rest = Setpoint { k, q: *q, v: [0.0; JOINTS], a: [0.0; JOINTS] };
        Self {
            q: rest.q,
            v: rest.v,
            last: rest,
            ring: [rest; RING],
            rng: Pcg64::seed_from_u64(seed),
            measured: Measured { stamp: Stamp::NONE, q: rest.q, dq: rest.v, drives: Drives::SOUND },
            measured_k: None,
            injected: Injected::default(),
        }
    }

    /// Where the joints are in truth, rad or m.
    pub fn q(&self) -> &[f64; JOINTS] {
        &self.q
    }

    /// The last setpoint.
    pub(crate) fn told(&self) -> &Setpoint {
        &self.last
    }

    /// Switches a fault on.
    pub fn inject(&mut self, fault: Injection) {
        self.injected.inject(fault, &self.q);
    }

    /// Repairs everything.
    pub fn repair(&mut self) {
        self.injected = Injected::default();
    }

    /// Moves on to the index of `to`. Where setpoints are missing in between, the joints see the cubic through both ends.
    fn advance(&mut self, config: &Config, to: &Setpoint) {
        let from = self.last;
        let gap = to.k.saturating_sub(from.k);
        for tick in (gap - gap.min(GAP_MAX_TICKS))..gap {
            let setpoint = if tick + 1 == gap { *to } else { between(&from, to, tick + 1, gap) };
            self.step(config, &setpoint);
        }
        if gap > 0 {
            self.last = *to;
        }
    }

    fn step(&mut self, config: &Config, setpoint: &Setpoint) {
        self.ring[setpoint.k as usize % RING] = *setpoint;
        // Older entries of the ring are older setpoints: every index since the start was written.
        let delayed = self.ring[(setpoint.k as usize + RING - config.delay_ticks) % RING];
        for j in 0..JOINTS {
            if let Some(sag) = self.injected.without_power {
                self.sink(config, j, sag);
                continue;
            }
            let (mut q_ref, mut v_ref, mut a_ref) = (delayed.q[j], delayed.v[j], delayed.a[j]);
            if let Some(about) = self.injected.mirrored_about[j] {
                (q_ref, v_ref, a_ref) = (2.0 * about - q_ref, -v_ref, -a_ref);
            }
            if self.injected.brakes(j) {
                (q_ref, v_ref, a_ref) = (self.q[j], 0.0, 0.0);
            }
            // The setpoint is for the end of the tick: compared with where the joint would be then, it is not run ahead of.
            let (q_end, v_end) = (self.q[j] + self.v[j] * TICK_S, self.v[j] + a_ref * TICK_S);
            let a = a_ref
                + 2.0 * config.damping_ratio * config.omega * (v_ref - v_end)
                + config.omega * config.omega * (q_ref - q_end);
            let a = a.clamp(-config.a_servo[j], config.a_servo[j]);
            let v = (self.v[j] + a * TICK_S).clamp(-config.v_servo[j], config.v_servo[j]);
            let q = self.q[j] + (self.v[j] + v) / 2.0 * TICK_S;
            self.place(config, j, q, v);
        }
    }

    /// A joint whose motor has no power: its brake takes its speed, then it gives way at the speed `sag`.
    fn sink(&mut self, config: &Config, j: usize, sag: f64) {
        let change = config.a_servo[j] * TICK_S;
        let v = self.v[j] + (sag - self.v[j]).clamp(-change, change);
        self.place(config, j, self.q[j] + (self.v[j] + v) / 2.0 * TICK_S, v);
    }

    /// Moves a joint, as far as its mechanical stops let it.
    fn place(&mut self, config: &Config, j: usize, q: f64, v: f64) {
        let urdf = &config.model.urdf_limits[j];
        let stopped = q < urdf.q_min || q > urdf.q_max;
        self.q[j] = q.clamp(urdf.q_min, urdf.q_max);
        self.v[j] = if stopped { 0.0 } else { v };
    }

    fn measure(&mut self, config: &Config, now: Stamp) -> Measured {
        if self.measured_k != Some(self.last.k) {
            self.measured_k = Some(self.last.k);
            for j in 0..JOINTS {
                let (noise_q, noise_v) = self.normal_pair();
                if self.injected.is_frozen(j) {
                    continue;
                }
                let q = self.q[j] + config.noise * noise_q;
                let q = if config.step > 0.0 { (q / config.step).round() * config.step } else { q };
                // The drive differentiates its encoder through a filter as fast as its own loop.
                (self.measured.q[j], self.measured.dq[j]) = (q, self.v[j] + config.noise * config.omega * noise_v);
            }
            self.injected.distort(&mut self.measured);
        }
        self.measured.drives = self.injected.drives();
        self.measured.stamp = now;
        self.measured
    }

    /// Two independent standard normal numbers (Box and Muller).
    fn normal_pair(&mut self) -> (f64, f64) {
        // 53 bits in (0, 1]: the logarithm is finite, and the largest number that can come out is 8.6.
        let mut uniform = || ((self.rng.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64;
        let radius = (-2.0 * uniform().ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * uniform()).sin_cos();
        (radius * cos, radius * sin)
    }
}

/// The cubic through the positions and velocities of two setpoints, `tick` of `gap` ticks after the first (Hermite), with
/// the velocity between them interpolated linearly.
fn between(from: &Setpoint, to: &Setpoint, tick: u64, gap: u64) -> Setpoint {
    let (s, t) = (tick as f64 / gap as f64, gap as f64 * TICK_S);
    let q = |j: usize| cubic([from.q[j], from.v[j]], [to.q[j], to.v[j]], t, s)[0];
    let mix = |a: f64, b: f64| a + s * (b - a);
    Setpoint {
        k: from.k + tick,
        q: std::array::from_fn(q),
        v: std::array::from_fn(|j| mix(from.v[j], to.v[j])),
        a: std::array::from_fn(|j| mix(from.a[j], to.a[j])),
    }
}

/// The plant behind the driver's port.
pub struct Port<'a> {
    /// What it is made of.
    pub config: &'a Config,
    /// Its state.
    pub plant: &'a mut Plant,
}

impl Driver for Port<'_> {
    fn read(&mut self, now: Stamp) -> Measured {
        self.plant.measure(self.config, now)
    }

    fn write(&mut self, _now: Stamp, setpoint: &Setpoint) -> bool {
        let taken = self.plant.injected.takes_setpoints();
        // A robot that takes no setpoints holds the last one, and one without power has none: it stands where it stands.
        let q = if self.plant.injected.drives().are_sound() { self.plant.last.q } else { self.plant.q };
        let held = Setpoint { k: setpoint.k, q, v: [0.0; JOINTS], a: [0.0; JOINTS] };
        self.plant.advance(self.config, if taken { setpoint } else { &held });
        taken
    }
}
