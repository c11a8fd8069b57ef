//! Tests a blocked arm: it slides, and gives up what has the least cost in the robot file.

use crate::support::{shipped, towards};
use messages::{JOINTS_MAX, Stamp};
use nalgebra::{Matrix3, Rotation3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Model;
use wbc::{Config, Options, Parts, Program, State, Tasks, certify_rest, tick};

/// TIAGo++: the joints of its left arm.
const LEFT_ARM: std::ops::Range<usize> = 3..10;

fn config(model: &Model, change: impl FnOnce(&mut Tasks)) -> Config {
    let mut parts = Parts::from_model(model).expect("the parts of the robot");
    change(&mut parts.tasks);
    Config::from_parts(parts, Options::default()).expect("whole-body control")
}

/// Follows `q` for `ticks`, and calls `see` with every output.
fn follow(config: &Config, state: &mut State, q: &[f64; JOINTS_MAX], ticks: u64, mut see: impl FnMut(&wbc::Output)) {
    (0..ticks).for_each(|k| see(&tick(config, state, Stamp::NONE, towards(k, q))));
}

/// Returns postures with the left arm in collision and the right arm at home. A person with other hips may
/// request them.
fn blocked(config: &Config, model: &Model, rng: &mut Pcg64) -> [f64; JOINTS_MAX] {
    loop {
        let mut q = model.home;
        for (q, limits) in q.iter_mut().zip(&model.limits).skip(LEFT_ARM.start).take(5) {
            *q = rng.random_range(limits.q_min..limits.q_max);
        }
        let (_, clearance_m, _) = certify_rest(config, &q);
        if (-0.05..0.0).contains(&clearance_m) {
            return q;
        }
    }
}

/// Sum of the angles between the left arm's limbs and the wanted ones, rad.
fn limb_error(model: &Model, q: &[f64; JOINTS_MAX], wanted: &[f64; JOINTS_MAX]) -> f64 {
    let limbs = |q: &[f64; JOINTS_MAX]| model.arms[0].limb_rotations(&model.arms[0].limb_values(q));
    let angle = |a: Matrix3<f64>, b: Matrix3<f64>| Rotation3::from_matrix_unchecked(a.transpose() * b).angle();
    let (own, theirs) = (limbs(q), limbs(wanted));
    angle(own.0, theirs.0) + angle(own.1, theirs.1)
}

/// Result of following blocked targets.
#[derive(Debug, Default)]
struct Outcome {
    /// Mean limb error when the program first changed a wanted jerk, and 5 s after the target was set, rad.
    first_rad: f64,
    last_rad: f64,
    /// Number of ticks in which the program changed wanted jerks, and of those in which it had no solution.
    solved: u64,
    infeasible: u64,
}

fn slide(model: &Model, config: &Config) -> Outcome {
    const COUNT: usize = 12;
    let mut rng = Pcg64::seed_from_u64(5);
    let mut outcome = Outcome::default();
    for _ in 0..COUNT {
        let wanted = blocked(config, model, &mut rng);
        let mut state = State::at_rest(config, model.home);
        let (mut first, mut last) = (None, model.home);
        follow(config, &mut state, &wanted, 7500, |out| {
            assert!(out.clearance_m >= model.d_min_m, "{}", out.clearance_m);
            last = out.motion.q;
            outcome.infeasible += u64::from(out.program == Program::Infeasible);
            if out.program == Program::Solved {
                outcome.solved += 1;
                first.get_or_insert(out.motion.q);
            }
        });
        outcome.first_rad += limb_error(model, &first.expect("the target is blocked"), &wanted) / COUNT as f64;
        outcome.last_rad += limb_error(model, &last, &wanted) / COUNT as f64;
    }
    outcome
}

#[test]
fn blocked_arm_slides_on_with_any_limb_weight() {
    let model = shipped();
    let alike = slide(&model, &config(&model, |tasks| tasks.limb_weight = 0.0));
    // A joint's deviation counts as a share of its speed, 2 rad/s. So a limb's deviation counts half as much
    // as a joint's.
    let limbs = slide(&model, &config(&model, |tasks| tasks.limb_weight = 0.12));
    println!("joints alike {alike:?}\nlimbs weighed {limbs:?}");
    for outcome in [&alike, &limbs] {
        // The rows are always feasible: at worst, no pair comes closer.
        assert_eq!(outcome.infeasible, 0, "{outcome:?}");
        assert!(outcome.solved > 7500, "{outcome:?}");
        assert!(outcome.last_rad < 0.6 * outcome.first_rad, "the arms stopped instead of sliding: {outcome:?}");
    }
    assert!(limbs.last_rad < 1.02 * alike.last_rad, "limbs that count are not further off: {limbs:?} {alike:?}");
    assert_ne!(alike.last_rad, limbs.last_rad, "the weight decides nothing");
}
