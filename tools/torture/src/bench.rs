//! Duration of the control tick (whole-body control and the gate) under two kinds of targets.

use crate::figures::Durations;
use crate::stages::{Stages, Subject};
use messages::{ALL_JOINTS, JOINTS_MAX, TICK_HZ, TICK_S, deadline};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use robot::Model;
use safety::engage::Permit;

/// Amplitude of the smooth motion, rad. The lift moves a hundredth of it, m.
const WAVE_RAD: f64 = 0.2;
/// Ticks between two random postures.
const JUMP_EVERY: u64 = TICK_HZ;
/// Ticks that are not counted, because caches and branch predictors warm up.
const WARM: u64 = 2000;

#[derive(Clone, Debug)]
pub struct Bench {
    /// Sines about the home posture, far from collisions. Most of a session is like this.
    pub smooth: Durations,
    /// A random posture every second, most of them in collision.
    pub jumps: Durations,
}

pub fn run(subject: &Subject, ticks: u64, seed: u64) -> Bench {
    let (model, mut rng) = (&subject.model, Pcg64::seed_from_u64(seed));
    let smooth = measure(subject, ticks, |k| wave(model, k as f64 * TICK_S));
    let mut goal = model.home;
    let jumps = measure(subject, ticks, |k| {
        if k.is_multiple_of(JUMP_EVERY) {
            goal = subject.robot.posture(&mut rng);
        }
        (goal, [0.0; JOINTS_MAX])
    });
    Bench { smooth, jumps }
}

/// q = home + s sin(w t) and its derivative, with w = 1 + j / 10 rad/s. This is slow enough for the lift.
fn wave(model: &Model, t: f64) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
    let w = |j: usize| 1.0 + 0.1 * j as f64;
    let size = |j: usize| match j {
        _ if j >= model.count => 0.0,
        _ if model.prismatic[j] => 0.01 * WAVE_RAD,
        _ => WAVE_RAD,
    };
    let q = std::array::from_fn(|j| model.home[j] + size(j) * (w(j) * t).sin());
    (q, std::array::from_fn(|j| size(j) * w(j) * (w(j) * t).cos()))
}

fn measure(
    subject: &Subject,
    ticks: u64,
    mut target: impl FnMut(u64) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]),
) -> Durations {
    let mut stages = Stages::at_rest(subject, subject.model.home);
    let mut durations = Durations::default();
    for k in 1..=ticks + WARM {
        let (q, dq) = target(k);
        let target = wbc::Target { q: &q, dq: &dq, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
        let (_, ns) = stages.tick(k, deadline(k), Some(target), Permit::Follow { speed_scale: 1.0 });
        if k > WARM {
            durations.0.record_ns(ns);
        }
    }
    durations
}
