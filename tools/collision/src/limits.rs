//! Computes the torques that the limits in force may require, by inverse dynamics over random states.
//!
//! tau = M(q) a + h(q, v) is affine in the accelerations a. So over the box |a_k| <= A_k the largest torque of
//! joint j in a state is exactly |h_j| + sum_k |M_jk| A_k, and no signs need to be tried. In the sampled
//! states, q is uniform in the limits in force. In half of the states v is a random corner of the box of the
//! speeds, otherwise it is uniform in the box. Then the results of sampling are climbed. From the worst states
//! of each joint, the search goes coordinate by coordinate to a local maximum over q and v.

use messages::JOINTS_MAX;
use plant::{Body, Dynamics, Frames};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use robot::Model;

/// One value for each joint: rad or m, or N m or N, in the fixed joint order.
pub type PerJoint = [f64; JOINTS_MAX];

/// Number of states of one random stream. Results do not depend on the number of threads.
const CHUNK: u64 = 1_000;
/// Number of worst states that are kept for each joint.
const KEPT: usize = 100;
/// Number of states of a joint from which the search climbs.
const CLIMBED: usize = 12;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Highest speeds, rad/s or m/s.
    pub v: PerJoint,
    /// Highest accelerations, rad/s^2 or m/s^2.
    pub a: PerJoint,
}

impl Motion {
    pub fn in_force(model: &Model) -> Self {
        Self { v: model.limits.map(|limits| limits.v_max), a: model.limits.map(|limits| limits.a_max) }
    }

    /// No motion: gravity alone.
    pub const AT_REST: Self = Self { v: [0.0; JOINTS_MAX], a: [0.0; JOINTS_MAX] };
}

#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    pub states: u64,
    pub seed: u64,
    /// Torque above this share of the effort limit counts as too large.
    pub share: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct State {
    /// Positions, rad or m.
    pub q: PerJoint,
    /// Speeds, rad/s or m/s.
    pub v: PerJoint,
    /// |h| of the joint in this state, N m or N.
    pub bias: f64,
    /// |M_jk| of the joint.
    pub row: PerJoint,
}

impl State {
    /// Returns the largest torque over the box of accelerations, N m or N.
    pub fn torque(&self, a: &PerJoint) -> f64 {
        self.bias + self.row.iter().zip(a).map(|(m, a)| m * a).sum::<f64>()
    }
}

#[derive(Clone, Debug, Default)]
pub struct Found {
    /// The worst states, in descending order.
    pub worst: Vec<State>,
    /// Number of states in which the torque exceeds the share.
    pub exceeding: u64,
    /// Number of states in which it exceeds the share without any acceleration.
    pub exceeding_coasting: u64,
}

pub struct Survey<'a> {
    pub model: &'a Model,
    pub sampling: Sampling,
    body: Body,
    dynamics: Dynamics,
}

impl<'a> Survey<'a> {
    /// Creates the survey of a model whose links and loads are those of `body`.
    pub fn new(model: &'a Model, body: Body, sampling: Sampling) -> Self {
        // No rotors: their inertia is for the simulated robot alone.
        let dynamics = Dynamics::new(&body, [0.0; JOINTS_MAX]);
        Self { model, sampling, body, dynamics }
    }

    /// Returns the effort limit of a joint, N m or N.
    pub fn effort(&self, j: usize) -> f64 {
        self.model.limits[j].effort_max
    }

    /// Returns the load of a state on each joint.
    fn states(&self, q: &PerJoint, v: &PerJoint) -> [State; JOINTS_MAX] {
        let mut frames = Frames::default();
        self.body.forward(q, &mut frames);
        let posture = self.dynamics.at(&frames);
        let bias = self.dynamics.torques(&posture, v, &[0.0; JOINTS_MAX]);
        let matrix = self.dynamics.mass_matrix(&posture);
        std::array::from_fn(|j| State { q: *q, v: *v, bias: bias[j].abs(), row: matrix[j].map(f64::abs) })
    }

    pub fn pass(&self, motion: &Motion) -> Vec<Found> {
        let chunks = self.sampling.states.div_ceil(CHUNK);
        let empty = || vec![Found::default(); self.model.count];
        (0..chunks).into_par_iter().fold(empty, |found, chunk| self.chunk(motion, chunk, found)).reduce(
            empty,
            |mut a, b| {
                for (a, b) in a.iter_mut().zip(b) {
                    a.exceeding += b.exceeding;
                    a.exceeding_coasting += b.exceeding_coasting;
                    a.worst.extend(b.worst);
                    keep(motion, &mut a.worst);
                }
                a
            },
        )
    }

    fn chunk(&self, motion: &Motion, chunk: u64, mut found: Vec<Found>) -> Vec<Found> {
        let stream = self.sampling.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(chunk);
        let mut rng = rand_pcg::Pcg64::seed_from_u64(stream);
        let count = CHUNK.min(self.sampling.states - chunk * CHUNK);
        for _ in 0..count {
            let q = std::array::from_fn(|j| {
                let limits = &self.model.limits[j];
                if j < self.model.count { rng.random_range(limits.q_min..=limits.q_max) } else { 0.0 }
            });
            let corner = rng.random_bool(0.5);
            let v = std::array::from_fn(|j| {
                let x = rng.random_range(-1.0..=1.0);
                motion.v[j] * if corner { f64::signum(x) } else { x }
            });
            for (j, (state, found)) in self.states(&q, &v).into_iter().zip(&mut found).enumerate() {
                let bound = self.sampling.share * self.effort(j);
                let torque = state.torque(&motion.a);
                found.exceeding += u64::from(torque > bound);
                found.exceeding_coasting += u64::from(state.bias > bound);
                let least = found.worst.get(KEPT - 1).map_or(0.0, |state| state.torque(&motion.a));
                if torque > least {
                    found.worst.push(state);
                    if found.worst.len() > 2 * KEPT {
                        keep(motion, &mut found.worst);
                    }
                }
            }
        }
        for found in &mut found {
            keep(motion, &mut found.worst);
        }
        found
    }

    /// Climbs from a state to a local maximum of the torque of joint `j`. It tries steps of positions and of
    /// speeds in both directions, and halves the step if none helps.
    pub fn climb(&self, j: usize, from: &State, motion: &Motion) -> State {
        let mut best = *from;
        let mut step = 0.1;
        while step > 1e-4 {
            let before = best.torque(&motion.a);
            for k in 0..self.model.count {
                let limits = &self.model.limits[k];
                let reach = limits.q_max - limits.q_min;
                for move_q in [true, false] {
                    for sign in [-1.0, 1.0] {
                        let (mut q, mut v) = (best.q, best.v);
                        if move_q {
                            q[k] = (q[k] + sign * step * reach).clamp(limits.q_min, limits.q_max);
                        } else {
                            v[k] = (v[k] + sign * 2.0 * step * motion.v[k]).clamp(-motion.v[k], motion.v[k]);
                        }
                        let next = self.states(&q, &v)[j];
                        if next.torque(&motion.a) > best.torque(&motion.a) {
                            best = next;
                        }
                    }
                }
            }
            if best.torque(&motion.a) <= before * (1.0 + 1e-6) {
                step *= 0.5;
            }
        }
        best
    }

    /// Returns the highest maximum that is reached from the worst states of each joint.
    pub fn climb_all(&self, found: &[Found], motion: &Motion) -> Vec<Option<State>> {
        let climb = |(j, found): (usize, &Found)| {
            let starts = found.worst.iter().take(CLIMBED);
            let tops = starts.map(|state| self.climb(j, state, motion));
            tops.max_by(|a, b| a.torque(&motion.a).total_cmp(&b.torque(&motion.a)))
        };
        found.par_iter().enumerate().map(climb).collect()
    }
}

fn keep(motion: &Motion, worst: &mut Vec<State>) {
    worst.sort_by(|a, b| b.torque(&motion.a).total_cmp(&a.torque(&motion.a)));
    worst.truncate(KEPT);
}
