//! Robots that carried on by themselves while their driver was suspended: random motions, delays, and
//! measurements of any age.

use crate::bench::{Bench, K, measured};
use driver::{Config, GAP_MAX_TICKS, Input, JointLimits, Measured, tick};
use messages::{JOINTS_MAX, JointMotion, Layout, RobotId, Stamp, TICK_S, deadline};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const LIMITS: JointLimits = JointLimits { q_min: -3.0, q_max: 3.0, v_max: 2.0, a_max: 10.0, j_max: 400.0 };
/// Joints that move.
const MOVING: usize = 6;
/// Setpoints may be this much closer together in wall time than by index, s. The judge of the simulated robot
/// allows the same.
const JITTER_S: f64 = 0.002;
/// A joint's past before the last setpoint is known in steps of this length, s, for longer than any delay.
const PAST_STEP_S: f64 = TICK_S / 10.0;
const PAST_STEPS: usize = 600;

/// Returns the shortest stop from speed `v` and acceleration `a` as jerks and durations, or `None` if it breaks
/// the limits.
fn stop(v: f64, a: f64) -> Option<([f64; 3], [f64; 3])> {
    let (a_max, jerk) = (LIMITS.a_max, LIMITS.j_max);
    let (sign, v, a) = (v.signum(), v.abs(), a * v.signum());
    let mut strongest = (jerk * v + a * a / 2.0).sqrt();
    let mut even_s = 0.0;
    if strongest > a_max {
        strongest = a_max;
        even_s = (v + a * a / (2.0 * jerk) - a_max * a_max / jerk) / a_max;
    }
    let fits = strongest + a >= 0.0 && even_s >= 0.0 && v + a * a / (2.0 * jerk) <= LIMITS.v_max;
    fits.then(|| ([-jerk * sign, 0.0, jerk * sign], [(a + strongest) / jerk, even_s, strongest / jerk]))
}

/// One joint before and after its last setpoint.
struct Joint {
    /// Positions and velocities, backward in time.
    past: Vec<(f64, f64)>,
    motion: JointMotion,
    index: usize,
}

impl Joint {
    /// Creates a joint with random jerks within the limits.
    fn new(rng: &mut Pcg64, motion: &JointMotion, index: usize) -> Self {
        let (mut q, mut v, mut a) = (motion.q[index], motion.v[index], motion.a[index]);
        let mut jerk = 0.0;
        let mut step = |n: usize| {
            let before = (q, v);
            if n.is_multiple_of(60) {
                jerk = if index < MOVING { rng.random_range(-1.0..1.0) * LIMITS.j_max } else { 0.0 };
            }
            let dt = -PAST_STEP_S;
            a = (a + jerk * dt).clamp(-LIMITS.a_max, LIMITS.a_max);
            if (v + a * dt).abs() > LIMITS.v_max {
                a = 0.0;
            }
            q += v * dt + a * dt * dt / 2.0;
            v += a * dt;
            before
        };
        Self { past: (0..=PAST_STEPS).map(&mut step).collect(), motion: *motion, index }
    }

    /// Returns position and velocity `time_s` after the last setpoint, s. Before it the time is negative.
    fn at(&self, time_s: f64) -> (f64, f64) {
        if time_s <= 0.0 {
            let (step, share) = ((-time_s / PAST_STEP_S) as usize, (-time_s / PAST_STEP_S).fract());
            let (new, old) = (self.past[step], self.past[step + 1]);
            return (new.0 + share * (old.0 - new.0), new.1 + share * (old.1 - new.1));
        }
        let plan = &self.motion.plan;
        let (mut q, mut v, mut a) = (self.motion.q[self.index], self.motion.v[self.index], self.motion.a[self.index]);
        let mut left_s = time_s;
        for (jerk, duration_s) in plan.jerk[self.index].into_iter().zip(plan.duration_s[self.index]) {
            let t = left_s.min(duration_s);
            q += t * (v + t * (a / 2.0 + t * jerk / 6.0));
            v += t * (a + t * jerk / 2.0);
            a += t * jerk;
            left_s -= t;
        }
        (q, v)
    }
}

/// Returns a random motion, or `None` if one of its joints cannot be stopped in time.
fn motion(rng: &mut Pcg64) -> Option<JointMotion> {
    let mut motion = JointMotion::rest([0.0; JOINTS_MAX]);
    for j in 0..MOVING {
        (motion.v[j], motion.a[j]) =
            (rng.random_range(-1.0..1.0) * LIMITS.v_max, rng.random_range(-1.0..1.0) * LIMITS.a_max);
        (motion.plan.jerk[j], motion.plan.duration_s[j]) = stop(motion.v[j], motion.a[j])?;
    }
    Some(motion)
}

/// The limits allow the setpoint after the gap in the wall time since the last one, and it is near the robot.
/// This holds for any age of the newest measurement, and for a robot on or off its plan. A joint that should
/// stand is off by `off_m`.
fn judge(delay_ms: std::ops::Range<f64>, off_m: f64, seed: u64) {
    let config = Config::new(RobotId::ZERO, [LIMITS; JOINTS_MAX]);
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut begun = 0;
    for _ in 0..6000 {
        let Some(motion) = motion(&mut rng) else { continue };
        let joints: Vec<_> = (0..JOINTS_MAX).map(|j| Joint::new(&mut rng, &motion, j)).collect();
        let gap = rng.random_range(GAP_MAX_TICKS + 1..40);
        let (delay_s, age_s) = (rng.random_range(delay_ms.clone()) * 1e-3, rng.random_range(0.0..10e-3));
        let late_s = rng.random_range(0.0..TICK_S);
        let mut bench = Bench::following();
        bench.state.motion = motion;
        let k = K + 5 + gap;
        let now = deadline(k).plus_ns((late_s * 1e9) as u64);
        let since_s = gap as f64 * TICK_S + late_s;
        let mut newest = Measured { stamp: Stamp(now.0 - (age_s * 1e9) as u64), ..measured() };
        for (j, joint) in joints.iter().enumerate() {
            let (q, v) = joint.at(since_s - delay_s - age_s);
            newest.q[j] = q + rng.random_range(-1.5e-4..1.5e-4);
            newest.dq[j] = v + rng.random_range(-0.015..0.015);
        }
        newest.q[JOINTS_MAX - 1] += off_m;
        let input = Input { due_k: k, command: None, port_fault: false, measured: Some(&newest) };
        tick(&config, &mut bench.state, now, input);
        let commanded = bench.state.motion;
        let wall_s = since_s + JITTER_S;
        begun += u32::from(bench.state.executed_k == k);
        for (j, joint) in joints.iter().enumerate().take(MOVING) {
            let what = format!(
                "gap {gap}, delay {delay_s:.4} s, age {age_s:.4} s: {} rad, {} rad/s, {} rad/s^2; measured {}, {}; told {}, {}",
                motion.q[j], motion.v[j], motion.a[j], newest.q[j], newest.dq[j], commanded.q[j], commanded.v[j]
            );
            assert!((commanded.v[j] - motion.v[j]).abs() <= LIMITS.a_max * wall_s, "speed: {what}");
            assert!((commanded.q[j] - motion.q[j]).abs() <= LIMITS.v_max * wall_s, "way: {what}");
            let (truth, _) = joint.at(since_s - delay_s);
            let ahead = (commanded.q[j] - truth) * motion.v[j].signum();
            // A robot that follows lags its setpoints by this much, and they may be a tick older.
            let most = (delay_s + TICK_S) * LIMITS.v_max + 0.5e-3;
            assert!((-4e-3..=most).contains(&ahead), "{ahead} rad ahead of the robot: {what}");
        }
    }
    assert!(off_m == 0.0 || begun > 500, "{begun} begun where the robot was measured");
}

#[test]
fn next_setpoint_after_pause_stays_within_limits() {
    judge(0.0..9.0, 0.0, 1);
    judge(9.0..12.0, 0.0, 2);
}

#[test]
fn next_setpoint_for_robot_off_its_plan_stays_within_limits() {
    judge(0.0..9.0, 12e-3, 3);
    judge(9.0..12.0, 12e-3, 4);
}
