//! Targets that try to make the robot break a guarantee.

use super::Subject;
use super::checker::Checker;
use messages::{ALL_JOINTS, JOINTS};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::interval::Bounds;
use wbc::{Permit, Planned};

/// Kind of attack for a while.
#[derive(Clone, Copy, Debug)]
enum Mode {
    /// Postures, most of them in collision.
    Jump,
    /// Corners of the joint box and beyond.
    Limits,
    /// Both arms into each other, in mirrored postures.
    Mirrored,
    /// White noise around a posture, in velocities too.
    Noise,
    /// A new posture every tick.
    Chaos,
    /// Downhill in clearance.
    Gradient,
    /// A sine of changing frequency.
    Wave,
    /// Values that are not finite.
    Nonsense,
}

/// A source of targets and permits.
pub struct Attacker {
    rng: Pcg64,
    limits: [Bounds; JOINTS],
    mode: Mode,
    until: u64,
    base: [f64; JOINTS],
    pub q: [f64; JOINTS],
    pub dq: [f64; JOINTS],
    pub valid_mask: u32,
    pub permit: Permit,
}

impl Attacker {
    pub fn new(subject: &Subject, seed: u64) -> Self {
        Self {
            rng: Pcg64::seed_from_u64(seed),
            limits: subject.limits,
            mode: Mode::Jump,
            until: 0,
            base: subject.home,
            q: subject.home,
            dq: [0.0; JOINTS],
            valid_mask: ALL_JOINTS,
            permit: Permit::Follow { speed_scale: 1.0 },
        }
    }

    fn posture(&mut self) -> [f64; JOINTS] {
        self.limits.map(|l| self.rng.random_range(l.q_min..=l.q_max))
    }

    /// Creates the target of tick `k`. The attacker sees the last command.
    pub fn next(&mut self, k: u64, seen: &Planned, checker: &Checker) {
        if k >= self.until {
            self.change(k);
        }
        match self.mode {
            Mode::Jump | Mode::Limits | Mode::Mirrored => {}
            Mode::Noise => {
                for j in 0..JOINTS {
                    self.q[j] = self.base[j] + self.rng.random_range(-0.1..0.1);
                    self.dq[j] = self.rng.random_range(-3.0..3.0);
                }
            }
            Mode::Chaos => self.q = self.posture(),
            Mode::Gradient => self.downhill(k, seen, checker),
            Mode::Wave => {
                let t = k as f64 / 1500.0;
                for j in 0..JOINTS {
                    let w = 3.0 + j as f64;
                    self.q[j] = self.base[j] + 0.6 * (w * t).sin();
                    self.dq[j] = 0.6 * w * (w * t).cos();
                }
            }
            Mode::Nonsense => {
                let values = [f64::NAN, f64::INFINITY, -f64::MAX, f64::MAX, 1e300, -0.0, f64::MIN_POSITIVE];
                for j in 0..JOINTS {
                    self.q[j] = values[self.rng.random_range(0..values.len())];
                    self.dq[j] = values[self.rng.random_range(0..values.len())];
                }
            }
        }
    }

    fn change(&mut self, k: u64) {
        self.until = k + self.rng.random_range(20..900);
        self.dq = [0.0; JOINTS];
        self.valid_mask = if self.rng.random_bool(0.8) { ALL_JOINTS } else { self.rng.random_range(0..=ALL_JOINTS) };
        self.permit = match self.rng.random_range(0..20) {
            0 => Permit::Stop,
            1..4 => Permit::Follow { speed_scale: self.rng.random_range(0.05..1.0) },
            _ => Permit::Follow { speed_scale: 1.0 },
        };
        self.base = self.posture();
        self.q = self.base;
        self.mode = match self.rng.random_range(0..16) {
            0..4 => Mode::Jump,
            4..6 => Mode::Limits,
            6..9 => Mode::Mirrored,
            9 => Mode::Noise,
            10 => Mode::Chaos,
            11..13 => Mode::Gradient,
            13..15 => Mode::Wave,
            _ => Mode::Nonsense,
        };
        match self.mode {
            Mode::Limits => {
                for (j, l) in self.limits.iter().enumerate() {
                    let beyond = if self.rng.random_bool(0.5) { 5.0 } else { 0.0 };
                    self.q[j] = if self.rng.random_bool(0.5) { l.q_min - beyond } else { l.q_max + beyond };
                    self.dq[j] = self.rng.random_range(-20.0..20.0);
                }
            }
            Mode::Mirrored => {
                for i in 0..7 {
                    self.q[10 + i] = self.q[3 + i];
                }
                // The arms reach forward and inward, where the hands meet.
                for j in [3, 10] {
                    self.q[j] = self.limits[j].q_max - 0.1;
                }
            }
            _ => {}
        }
    }

    /// Takes the one with the smallest clearance from a few random steps of the commanded posture.
    fn downhill(&mut self, k: u64, seen: &Planned, checker: &Checker) {
        if !k.is_multiple_of(30) {
            return;
        }
        let mut least = f64::INFINITY;
        for _ in 0..6 {
            let mut q = seen.q;
            for q in &mut q[3..] {
                *q += self.rng.random_range(-0.3..0.3);
            }
            let clearance = checker.clearance(&q);
            if clearance < least {
                least = clearance;
                self.q = q;
            }
        }
    }
}
