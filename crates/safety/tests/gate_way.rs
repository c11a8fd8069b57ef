//! Tests a stop whose beginning and end are clear, but not its way.

use crate::support::model;
use crate::support::motion::{T, joint, resting, set_stopping};
use judge::joint::{Joint, stop_of};
use messages::{JOINTS_MAX, Stamp};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Frames, Model, Obstacle, Solid};
use safety::clearance::clearance;
use safety::gate::{Config, Denial, Interface, Proposed, State, Verdict, tick};

/// A random posture from which all joints continue at 0.9 of their speeds. Returns the state before it and
/// the proposal for the tick.
fn fast(model: &Model, rng: &mut Pcg64) -> (Proposed, Proposed) {
    let share = |rng: &mut Pcg64| rng.random_range(0.3..0.7);
    let mut q = [0.0; JOINTS_MAX];
    for (q, l) in q.iter_mut().zip(&model.limits).take(model.count) {
        *q = l.q_min + share(rng) * (l.q_max - l.q_min);
    }
    let (mut before, mut next) = (resting(0, q), resting(1, q));
    for (j, l) in model.limits.iter().enumerate().take(model.count) {
        let v = 0.9 * l.v_max * if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let x = Joint { q: q[j], v, a: 0.0 };
        for (proposed, x) in [(&mut before, x), (&mut next, x.after(0.0, T))] {
            set_stopping(proposed, j, x, l);
        }
    }
    (before, next)
}

/// The posture at time `t` after a proposal.
fn later(proposed: &Proposed, t: f64) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| joint(&proposed.motion, j).play(&stop_of(&proposed.motion.plan, j), t).q)
}

fn verdict(config: &Config, before: &Proposed, next: &Proposed) -> Verdict {
    let mut state = State::at_rest(before.motion.q);
    state.reseed(&before.motion);
    tick(config, &mut state, Stamp(0), *next).verdict
}

/// The proposal is not certified. Between two clear ends a hand passes through an obstacle.
#[test]
fn stop_through_obstacle_is_denied_with_clear_ends() {
    let mut model = model();
    // The limits are faster than the robot's, so that a stop is long enough to leave the obstacle again.
    model.limits[3..].iter_mut().for_each(|limits| limits.v_max *= 2.0);
    let mut rng = Pcg64::seed_from_u64(41);
    let mut frames = Frames::default();
    let (mut denied, mut tried) = (0, 0);
    while denied < 30 {
        tried += 1;
        assert!(tried < 100_000, "{denied} of {tried}");
        model.obstacles.clear();
        let (before, next) = fast(&model, &mut rng);
        let free = Config::new(&model).expect("the gate");
        if verdict(&free, &before, &next) != Verdict::Accept {
            continue;
        }
        // A small obstacle is put where an arm's outermost capsule is during the stop.
        let outermost = [9, 16].map(|j| model.capsules.iter().position(|capsule| capsule.body == j + 1));
        let capsule = &model.capsules[outermost[tried % 2].expect("a hand has capsules")];
        model.forward(&later(&next, rng.random_range(0.1..0.4)), &mut frames);
        let pose = &frames.base_from_body[capsule.body];
        let center = pose.transform_point(&((capsule.a + capsule.b) / 2.0));
        let solid = Solid::Box { center, r: nalgebra::Matrix3::identity(), half_m: nalgebra::Vector3::repeat(1e-3) };
        model.obstacles = vec![Obstacle { name: "grain".into(), solid }];
        let mut clear = |q: &[f64; JOINTS_MAX]| clearance(&model, &mut frames, q).distance_m > model.d_min_m + 1e-6;
        if !clear(&next.motion.q) || !clear(&later(&next, 1e3)) {
            continue;
        }
        let among = Config::new(&model).expect("the gate");
        match verdict(&among, &before, &next) {
            Verdict::Deny(Denial::ClearanceOnTheWay { pair }) => {
                assert_eq!(pair[1] as usize, model.capsules.len(), "the grain");
                denied += 1;
            }
            other => panic!("{other:?}"),
        }
    }
}

/// If a pair has exactly the distance that an interface may take, the gate accepts the motion only for `direct`.
#[test]
fn interface_with_deviation_denies_more_than_direct() {
    let model = model();
    let mut rng = Pcg64::seed_from_u64(42);
    let controller = std::array::from_fn(|j| if j < 3 { [0, 1, 1][j] } else { 2 + (j - 3) / 7 });
    let late = Interface { off: [1e-5; JOINTS_MAX], skew_s: 0.01, controller };
    let [direct, late] =
        [Interface::default(), late].map(|interface| Config::with_interface(&model, &interface).expect("the gate"));
    let (mut both, mut only_direct) = (0, 0);
    for _ in 0..20_000 {
        let (before, next) = fast(&model, &mut rng);
        match [&direct, &late].map(|config| verdict(config, &before, &next) == Verdict::Accept) {
            [true, true] => both += 1,
            [true, false] => only_direct += 1,
            [false, false] => {}
            [false, true] => panic!("an interface only asks for more"),
        }
    }
    println!("{both} admitted by both, {only_direct} by direct alone");
    assert!(both > 100 && only_direct > 10, "{both} {only_direct}");
}
