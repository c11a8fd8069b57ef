//! Plays a command's stop plan to rest and judges it at many instants. It uses closed-form polynomials per
//! phase, parry's segment distance, and the dynamics of the simulated robot. Neither whole-body control nor the
//! gate uses these formulas and distances.

use driver::Motion;
use messages::JOINTS;
use nalgebra::Vector3;
use robot::{Frames, Model, segment_distance_oracle};
use sim::{TOLERANCE_A, TOLERANCE_CLEARANCE_M, TOLERANCE_J, TOLERANCE_Q, TOLERANCE_V, ViolationKind};

/// Time between two judged instants, s. In a millisecond no point of the robot moves more than a few
/// millimetres. The first instant is drawn at random for every plan.
const STEP_S: f64 = 1e-3;

/// Rounding of a torque over its limit. Accelerations have rounding errors of 1e-11 rad/s^2 at 2 kg m^2, and
/// limits are at least 2 N m.
const TOLERANCE_TORQUE: f64 = 1e-9;

/// Result of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rolled {
    /// Number of joints or instants that violate, by kind.
    pub violations: [u64; ViolationKind::ALL.len()],
    /// Least clearance, m: of the checked pairs, and to the obstacles.
    pub min_clearance_m: f64,
    /// Largest torque over its effort limit.
    pub torque_share: f64,
}

/// Judges plans of one robot.
#[derive(Clone, Debug)]
pub struct Judge<'a> {
    model: &'a Model,
    sim: &'a sim::Config,
    frames: Frames,
    axes: Vec<[Vector3<f64>; 2]>,
    half_lengths_m: Vec<f64>,
}

/// One joint on its plan: start time, state and jerk of each phase.
#[derive(Clone, Copy, Debug)]
struct Joint {
    /// Start (s), q, v, a and jerk of the three phases and of the rest after them.
    phases: [[f64; 5]; 4],
}

impl Joint {
    fn new(motion: &Motion, j: usize) -> Self {
        let mut at = [0.0, motion.q[j], motion.v[j], motion.a[j], 0.0];
        let mut phases = [at; 4];
        for i in 0..3 {
            let (t, jerk) = (motion.plan.duration_s[j][i], motion.plan.jerk[j][i]);
            at[4] = jerk;
            phases[i] = at;
            let [q, v, a] = polynomial(&at, t);
            at = [at[0] + t, q, v, a, 0.0];
        }
        phases[3] = at;
        Self { phases }
    }

    /// Position, velocity and acceleration at `t`. After the last phase, they are those of its end.
    fn at(&self, t: f64) -> [f64; 3] {
        let i = (0..4).rev().find(|&i| t >= self.phases[i][0]).unwrap_or(0);
        let phase = &self.phases[i];
        if i == 3 { [phase[1], phase[2], phase[3]] } else { polynomial(phase, t - phase[0]) }
    }

    fn end_s(&self) -> f64 {
        self.phases[3][0]
    }
}

/// Returns q + v t + a t^2 / 2 + j t^3 / 6 and its derivatives.
fn polynomial(&[_, q, v, a, jerk]: &[f64; 5], t: f64) -> [f64; 3] {
    [q + v * t + a * t * t / 2.0 + jerk * t * t * t / 6.0, v + a * t + jerk * t * t / 2.0, a + jerk * t]
}

impl<'a> Judge<'a> {
    /// Creates a judge for `model`. `sim` is its simulated robot.
    pub fn new(model: &'a Model, sim: &'a sim::Config) -> Self {
        Self {
            model,
            sim,
            frames: Frames::default(),
            axes: vec![[Vector3::zeros(); 2]; model.capsules.len()],
            half_lengths_m: model.capsules.iter().map(|capsule| (capsule.b - capsule.a).norm() / 2.0).collect(),
        }
    }

    /// Judges the plan of `motion` from now to rest. The first instant after now is `offset` (0 to 1) of a step
    /// later.
    pub fn roll(&mut self, motion: &Motion, offset: f64) -> Rolled {
        let joints: [Joint; JOINTS] = std::array::from_fn(|j| Joint::new(motion, j));
        let violations = [0; ViolationKind::ALL.len()];
        let mut rolled = Rolled { violations, min_clearance_m: f64::INFINITY, torque_share: 0.0 };
        for j in 0..JOINTS {
            self.judge_joint(motion, &joints[j], j, offset, &mut rolled);
        }
        let end_s = joints.iter().map(Joint::end_s).fold(0.0, f64::max);
        let mut t = 0.0;
        let mut next = offset * STEP_S;
        loop {
            let states = joints.map(|joint| joint.at(t));
            let share = self.torque_share(&states);
            rolled.torque_share = rolled.torque_share.max(share);
            let bearable = share <= wbc::torque::SHARE + TOLERANCE_TORQUE;
            rolled.violations[ViolationKind::Torque as usize] += u64::from(!bearable);
            let q = states.map(|state| state[0]);
            let clearance_m = self.clearance(&q);
            rolled.min_clearance_m = rolled.min_clearance_m.min(clearance_m);
            let clear = clearance_m >= self.model.d_min_m - TOLERANCE_CLEARANCE_M;
            rolled.violations[ViolationKind::Clearance as usize] += u64::from(!clear);
            if t >= end_s {
                return rolled;
            }
            (t, next) = (next.min(end_s), next + STEP_S);
        }
    }

    /// Returns the largest torque over its effort limit, with each joint at its position, speed and
    /// acceleration.
    fn torque_share(&self, states: &[[f64; 3]; JOINTS]) -> f64 {
        let torques = self.sim.torques(&states.map(|x| x[0]), &states.map(|x| x[1]), &states.map(|x| x[2]));
        let limits = self.model.limits.iter();
        torques.iter().zip(limits).map(|(torque, limits)| torque.abs() / limits.effort_max).fold(0.0, f64::max)
    }

    fn judge_joint(&self, motion: &Motion, joint: &Joint, j: usize, offset: f64, rolled: &mut Rolled) {
        let limits = &self.model.limits[j];
        let (mut inside, mut slow, mut gentle) = (true, true, true);
        let end_s = joint.end_s();
        let mut t = 0.0;
        let mut next = offset * STEP_S;
        while t <= end_s {
            let [q, v, a] = joint.at(t);
            inside &= q >= limits.q_min - TOLERANCE_Q && q <= limits.q_max + TOLERANCE_Q;
            slow &= v.abs() <= limits.v_max + TOLERANCE_V;
            gentle &= a.abs() <= limits.a_max + TOLERANCE_A;
            (t, next) = (next, next + STEP_S);
        }
        let [q, v, a] = joint.at(end_s);
        inside &= q >= limits.q_min - TOLERANCE_Q && q <= limits.q_max + TOLERANCE_Q;
        // A plan that does not end at rest is a violation, even if its jerks are allowed.
        let rests = v.abs() <= driver::REST_TOLERANCE && a.abs() <= driver::REST_TOLERANCE;
        let (jerks, durations) = (&motion.plan.jerk[j], &motion.plan.duration_s[j]);
        let smooth = (0..3).all(|i| durations[i] >= 0.0 && jerks[i].abs() <= limits.j_max + TOLERANCE_J);
        for (kind, good) in [
            (ViolationKind::Position, inside),
            (ViolationKind::Velocity, slow),
            (ViolationKind::Acceleration, gentle),
            (ViolationKind::Jerk, smooth && rests),
        ] {
            rolled.violations[kind as usize] += u64::from(!good);
        }
    }

    /// Least clearance at `q`, m. For the checked pairs it is parry's distance of the capsules' axes. For the
    /// obstacles it is the robot model's own distance.
    pub fn clearance(&mut self, q: &[f64; JOINTS]) -> f64 {
        self.model.forward(q, &mut self.frames);
        for (axis, capsule) in self.axes.iter_mut().zip(&self.model.capsules) {
            let pose = &self.frames.base_from_body[capsule.body];
            *axis = [pose.transform_point(&capsule.a), pose.transform_point(&capsule.b)];
        }
        let mut least = f64::INFINITY;
        for pair in &self.model.pairs {
            let ([a0, a1], [b0, b1]) = (&self.axes[pair.a], &self.axes[pair.b]);
            let radii = self.model.capsules[pair.a].radius_m + self.model.capsules[pair.b].radius_m;
            // Balls around both capsules: the distance is at least that of the centres less both radii.
            let around = self.half_lengths_m[pair.a] + self.half_lengths_m[pair.b] + radii;
            let apart = ((a0 + a1) - (b0 + b1)).norm() / 2.0 - around;
            if apart < least {
                least = least.min(segment_distance_oracle(a0, a1, b0, b1) - radii);
            }
        }
        least.min(self.model.obstacle_clearance(&self.frames).0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn model() -> Model {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/tiago_dual.toml");
        config::load_model(&file).unwrap().0
    }

    fn robot(model: &Model) -> sim::Config {
        sim::Config::new(model, &sim::Options::default()).unwrap()
    }

    /// A stop of joint `j` from `v` with `jerk`, then `-jerk`. Each phase lasts sqrt(v / jerk).
    fn stop(model: &Model, j: usize, v: f64, jerk: f64) -> Motion {
        let mut motion = Motion::rest(model.home);
        let t = (v / jerk).sqrt();
        motion.v[j] = v;
        motion.plan.jerk[j] = [-jerk, jerk, 0.0];
        motion.plan.duration_s[j] = [t, t, 0.0];
        motion
    }

    #[test]
    fn rollout_at_rest_has_no_violation_and_the_models_clearance() {
        let model = model();
        let sim = robot(&model);
        let rolled = Judge::new(&model, &sim).roll(&Motion::rest(model.home), 0.5);
        let mut frames = Frames::default();
        model.forward(&model.home, &mut frames);
        assert_eq!(rolled.violations, [0; ViolationKind::ALL.len()]);
        assert!((rolled.min_clearance_m - model.clearance(&frames).0).abs() < 1e-12);
    }

    #[test]
    fn rollout_reports_every_kind_of_bad_plan() {
        let model = model();
        let sim = robot(&model);
        let mut judge = Judge::new(&model, &sim);
        let mut kinds = |motion: &Motion| judge.roll(motion, 0.3).violations.map(|n| n > 0);
        let limits = &model.limits[4];
        // The peak of the acceleration is sqrt(v jerk). It is A if v is A^2 / jerk.
        let (gentle, full) = (0.9 * limits.j_max, limits.a_max * limits.a_max / limits.j_max);
        assert_eq!(kinds(&stop(&model, 4, 0.5 * full, gentle)), [false; ViolationKind::ALL.len()]);
        assert!(kinds(&stop(&model, 4, 0.5 * full, 1.1 * limits.j_max))[ViolationKind::Jerk as usize]);
        assert!(kinds(&stop(&model, 4, 1.5 * full, gentle))[ViolationKind::Acceleration as usize]);
        assert!(kinds(&stop(&model, 4, 1.1 * limits.v_max, gentle))[ViolationKind::Velocity as usize]);
        let mut short = stop(&model, 4, 0.5 * full, gentle);
        short.plan.duration_s[4][1] *= 0.9;
        assert!(kinds(&short)[ViolationKind::Jerk as usize], "a plan that does not end at rest");
        let mut outside = stop(&model, 4, 0.5 * full, gentle);
        outside.q[4] = limits.q_max;
        assert!(kinds(&outside)[ViolationKind::Position as usize]);
        // A stretched arm that falls at half its speed cannot brake at the full rate.
        let mut falling = stop(&model, 4, 0.98, 0.0);
        falling.q[3..10].fill(0.0);
        let rise = limits.a_max / limits.j_max;
        falling.plan.jerk[4] = [-limits.j_max, 0.0, limits.j_max];
        falling.plan.duration_s[4] = [rise, 0.98 / limits.a_max - rise, rise];
        assert!(kinds(&falling)[ViolationKind::Torque as usize]);
        // Slow motion from home with the left arm across the body leads into a collision.
        let mut through = Motion::rest(model.home);
        (through.v[3], through.plan.duration_s[3]) = (1.5, [3.0, 0.0, 0.0]);
        (through.v[10], through.plan.duration_s[10]) = (1.5, [3.0, 0.0, 0.0]);
        assert!(kinds(&through)[ViolationKind::Clearance as usize]);
    }
}
