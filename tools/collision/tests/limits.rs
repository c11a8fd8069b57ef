//! Limits by torque: the bound over accelerations is exact, sampling is repeatable, and the shipped robots keep
//! their limits.

use collision::limits::{Motion, Sampling, Survey};
use messages::JOINTS_MAX;
use plant::{Body, Links};
use rand::{RngExt, SeedableRng};
use robot::Model;

/// Joints of TIAGo++.
const JOINTS: usize = 17;

const ROBOTS: [(&str, &str); 2] = [
    (include_str!("../../../config/robots/tiago_dual.toml"), include_str!("../../../config/robots/tiago_dual.urdf")),
    (
        include_str!("../../../config/robots/tiago_dual_pal_gripper.toml"),
        include_str!("../../../config/robots/tiago_dual_pal_gripper.urdf"),
    ),
];

fn load((toml, urdf): (&str, &str)) -> (Model, Body) {
    let body = Body::from_text("toml", toml, "urdf", urdf).unwrap();
    (Model::from_text("toml", toml, "urdf", urdf).unwrap(), body)
}

const SAMPLING: Sampling = Sampling { states: 20_000, seed: 99, share: 0.85 };

/// Every posture can be held, but not every motion within the limits can be executed.
#[test]
fn shipped_robots_can_hold_every_sampled_posture() {
    for texts in ROBOTS {
        let (model, body) = load(texts);
        let survey = Survey::new(&model, body, SAMPLING);
        let found = survey.pass(&Motion::AT_REST);
        let climbed = survey.climb_all(&found, &Motion::AT_REST);
        for (j, (found, climbed)) in found.iter().zip(&climbed).enumerate() {
            assert_eq!(found.exceeding, 0, "{}", model.joint_names[j]);
            let (worst, top) =
                (found.worst.first().map_or(0.0, |state| state.bias), climbed.map_or(0.0, |top| top.bias));
            assert!(worst <= top && top <= 0.85 * survey.effort(j), "{}: {worst} {top}", model.joint_names[j]);
        }
        let moving = survey.pass(&Motion::in_force(&model));
        assert!(moving[4].exceeding > 0 && moving[4].exceeding_coasting > 0);
        assert!(moving[4].worst.windows(2).all(|w| w[0].bias <= w[0].torque(&[1.0; JOINTS_MAX]) && w[1].bias >= 0.0));
    }
}

/// Some signs of the accelerations reach the bound, and none exceeds it.
#[test]
fn torque_bound_over_accelerations_is_reached_never_exceeded() {
    let (toml, urdf) = ROBOTS[0];
    let (model, body) = load(ROBOTS[0]);
    let links = Links::from_text(("toml", toml), ("urdf", urdf), [Some(0.0); 2]).unwrap();
    let survey = Survey::new(&model, body, Sampling { states: 300, ..SAMPLING });
    let motion = Motion::in_force(&model);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    for (j, found) in survey.pass(&motion).iter().enumerate() {
        let state = found.worst[0];
        let bound = state.torque(&motion.a);
        for _ in 0..50 {
            let a = std::array::from_fn(|k| rng.random_range(-1.0..=1.0) * motion.a[k]);
            assert!(links.torques(&state.q, &state.v, &a)[j].abs() <= bound + 1e-9);
        }
        let still = links.torques(&state.q, &state.v, &[0.0; JOINTS_MAX])[j];
        let pushes = |k: usize| {
            let unit = std::array::from_fn(|other| f64::from(u8::from(other == k)));
            links.torques(&state.q, &state.v, &unit)[j] - still
        };
        let a = std::array::from_fn(|k| motion.a[k] * pushes(k).signum() * still.signum());
        assert!((links.torques(&state.q, &state.v, &a)[j].abs() - bound).abs() < 1e-9);
        // Climbing never descends, and stays in the box.
        let top = survey.climb(j, &state, &motion);
        assert!(top.torque(&motion.a) >= bound);
        assert!((0..JOINTS).all(|k| model.limits[k].contains(top.q[k]) && top.v[k].abs() <= motion.v[k]));
    }
}

/// Weights belong to the arms and to the name of the robot. Both files take the same weights.
#[test]
fn both_shipped_robots_have_the_same_arms() {
    let [(hands, _), (grippers, _)] = ROBOTS.map(load);
    assert_eq!((&hands.name, hands.arms), (&grippers.name, grippers.arms));
    assert_ne!(hands.hash, grippers.hash);
    assert!(hands.link_body("gripper_left_link").is_none() && grippers.link_body("gripper_left_link").is_some());
}
