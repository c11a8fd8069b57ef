//! Tests recovery from random postures outside the limits and in collision. The tests' own kinematics judge them.

use crate::support::{JOINTS, config_of, made_up};
use messages::{JOINTS_MAX, Stamp, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::plan::{JointState, JointStop};
use wbc::{ENGAGE_MARGIN_M, Input, Options, Permit, PlannedMotion, State, tick};

const POSTURES: usize = 60;
/// Number of ticks of a recovery, and of the stop after it.
const TICKS: u64 = 900;
const STOP_TICKS: u64 = 375;

#[test]
fn recovery_moves_no_joint_outward_and_most_robots_recover() {
    let robot = made_up();
    let config = config_of(&robot, Options::default());
    let bounds = *config.bounds();
    let mut rng = Pcg64::seed_from_u64(5);
    let (mut tried, mut moved, mut clear) = (0, 0.0, 0);
    while tried < POSTURES {
        let start: [f64; JOINTS_MAX] = std::array::from_fn(|j| {
            if j >= JOINTS {
                return 0.0;
            }
            let by = if rng.random_bool(0.1) { rng.random_range(0.0..0.02) } else { 0.0 };
            let q = rng.random_range(bounds[j].q_min..bounds[j].q_max);
            if rng.random_bool(0.1) { bounds[j].q_max + by } else { q }
        });
        let goal = robot.d_min_m + ENGAGE_MARGIN_M;
        let mut least = robot.clearance(&start);
        // This overlap is deeper than any at which a real robot could start.
        if least < -0.05 {
            continue;
        }
        tried += 1;
        let mut state = State::at_rest(&config, start);
        let mut last = start;
        for k in 0..TICKS + STOP_TICKS {
            let permit = if k < TICKS { Permit::Recover } else { Permit::Stop };
            let out = tick(&config, &mut state, Stamp::NONE, Input { k, target: None, permit });
            for j in 0..JOINTS {
                let (low, high) = (bounds[j].q_min.min(last[j]), bounds[j].q_max.max(last[j]));
                assert!(
                    out.motion.q[j] >= low && out.motion.q[j] <= high,
                    "tick {k}: joint {j} at {}",
                    out.motion.q[j]
                );
                assert!(out.motion.v[j].abs() <= 0.1, "tick {k}: joint {j} at {}", out.motion.v[j]);
                moved += (out.motion.q[j] - last[j]).abs();
            }
            let now = robot.clearance(&out.motion.q);
            assert!(now >= least.min(goal) - 1e-9, "tick {k}: from {least} to {now}");
            (least, last) = (now, out.motion.q);
        }
        let motion = state.planned();
        assert!(motion.is_at_rest(), "{} s after the stop", STOP_TICKS as f64 * TICK_S);
        clear += u32::from(least >= goal - 1e-6 && (0..JOINTS).all(|j| last[j] <= bounds[j].q_max + 1e-6));
    }
    println!("{clear} of {tried} clear after {:.1} s, {moved:.1} rad", TICKS as f64 * TICK_S);
    assert!(clear as usize * 10 >= tried * 8, "only {clear} of {tried} came back");
}

/// A joint that comes back may end its stop with a little speed and much deceleration. It then turns within the tick, so
/// both ends of the tick say nothing about the way between them.
#[test]
fn joint_outside_goes_no_further_out_within_a_tick() {
    let robot = made_up();
    let config = config_of(&robot, Options::default());
    let bounds = *config.bounds();
    let mut rng = Pcg64::seed_from_u64(12);
    let mut left_plan = 0;
    for n in 0..2000 {
        let j = n % JOINTS;
        let mut start = [0.0; JOINTS_MAX];
        start[j] = bounds[j].q_min - 1e-3;
        let mut state = State::at_rest(&config, start);
        let a_max = bounds[j].a_max.min(0.1);
        let x = JointState { q: start[j], v: rng.random_range(0.0..1e-5), a: -rng.random_range(0.0..a_max) };
        let stop = JointStop::new(x.v, x.a, bounds[j].a_max, bounds[j].j_max);
        let mut planned = *state.planned();
        planned.set_joint(j, x, stop);
        state.reseed(&planned);
        let out = tick(&config, &mut state, Stamp::NONE, Input { k: 0, target: None, permit: Permit::Recover });
        let after = JointState { q: out.motion.q[j], v: out.motion.v[j], a: out.motion.a[j] };
        if after == stop.advance(x, TICK_S).0 {
            continue;
        }
        let jerk = (after.a - x.a) / TICK_S;
        let lowest = (0..=100).map(|i| x.after(jerk, f64::from(i) / 100.0 * TICK_S).q).fold(x.q, f64::min);
        left_plan += 1;
        assert!(lowest >= x.q - 1e-15, "joint {j} at {x:?} goes {:e} out", x.q - lowest);
    }
    assert!(left_plan > 100, "only {left_plan} left their stop");
}
