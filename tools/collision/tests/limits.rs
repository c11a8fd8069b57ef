//! Limits by torque: the bound over accelerations is exact, sampling is repeatable, and the shipped robots keep theirs.

use collision::dynamics::{Dynamics, GRAVITY_M_PER_S2};
use collision::limits::{Motion, Sampling, Survey};
use collision::report::{scaled_speeds, section, with_section};
use messages::{JOINTS, LEFT_ARM};
use rand::{RngExt, SeedableRng};
use robot::Model;

const ROBOTS: [(&str, &str); 2] = [
    (include_str!("../../../config/robots/tiago_dual.toml"), include_str!("../../../config/robots/tiago_dual.urdf")),
    (
        include_str!("../../../config/robots/tiago_dual_pal_gripper.toml"),
        include_str!("../../../config/robots/tiago_dual_pal_gripper.urdf"),
    ),
];

fn load((toml, urdf): (&str, &str)) -> (Model, urdf_rs::Robot) {
    (Model::from_text("toml", toml, "urdf", urdf).unwrap(), urdf_rs::read_from_string(urdf).unwrap())
}

const SAMPLING: Sampling = Sampling { states: 20_000, seed: 99, share: 0.85 };

#[test]
fn no_state_of_the_shipped_robots_exceeds_the_share() {
    for texts in ROBOTS {
        let (model, urdf) = load(texts);
        let dynamics = Dynamics::new(&model, &urdf, &[]).unwrap();
        let survey = Survey { model: &model, dynamics: &dynamics, sampling: SAMPLING };
        let found = survey.pass(&Motion::in_force(&model));
        for (j, found) in found.iter().enumerate() {
            assert_eq!(found.exceeding, 0, "{}", model.joint_names[j]);
            let worst = found.worst[0].torque(&Motion::in_force(&model).a);
            assert!(worst <= 0.85 * survey.effort(j));
            assert!(found.worst.windows(2).all(|w| w[0].bias <= w[0].torque(&[1.0; JOINTS]) && w[1].bias >= 0.0));
        }
        // The URDF's own velocities ask for too much whatever the accelerations are.
        let fast = Motion { v: model.urdf_limits.map(|limits| limits.v_max), a: [0.0; JOINTS] };
        assert!(survey.pass(&fast).iter().any(|found| found.exceeding_coasting > 0));
    }
}

/// The bound is reached by some signs of the accelerations, and by none exceeded.
#[test]
fn the_bound_over_accelerations_is_exact() {
    let (model, urdf) = load(ROBOTS[0]);
    let dynamics = Dynamics::new(&model, &urdf, &[]).unwrap();
    let survey = Survey { model: &model, dynamics: &dynamics, sampling: Sampling { states: 300, ..SAMPLING } };
    let motion = Motion::in_force(&model);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    for (j, found) in survey.pass(&motion).iter().enumerate() {
        let state = found.worst[0];
        let posture = dynamics.at(&state.q);
        let bound = state.torque(&motion.a);
        for _ in 0..50 {
            let a = std::array::from_fn(|k| rng.random_range(-1.0..=1.0) * motion.a[k]);
            assert!(posture.torques(&state.v, &a, GRAVITY_M_PER_S2)[j].abs() <= bound + 1e-9);
        }
        let still = posture.torques(&state.v, &[0.0; JOINTS], GRAVITY_M_PER_S2)[j];
        let matrix = posture.mass_matrix();
        let a = std::array::from_fn(|k| motion.a[k] * matrix[j][k].signum() * still.signum());
        assert!((posture.torques(&state.v, &a, GRAVITY_M_PER_S2)[j].abs() - bound).abs() < 1e-9);
        // Climbing never descends, and stays in the box.
        let top = survey.climb(j, &state, &motion);
        assert!(top.torque(&motion.a) >= bound);
        assert!((0..JOINTS).all(|k| model.limits[k].contains(top.q[k]) && top.v[k].abs() <= motion.v[k]));
    }
}

#[test]
fn a_solution_holds_stops_in_time_and_is_written_where_it_belongs() {
    let (model, urdf) = load(ROBOTS[0]);
    let dynamics = Dynamics::new(&model, &urdf, &[]).unwrap();
    let survey = Survey { model: &model, dynamics: &dynamics, sampling: Sampling { states: 4_000, ..SAMPLING } };
    let slow = survey.solve(&scaled_speeds(&model, 0.35), 8.0, 0.5);
    assert!(slow.complete && slow.found.iter().all(|found| found.exceeding == 0));
    for j in LEFT_ARM {
        let limits = robot::JointLimits { v_max: slow.motion.v[j], a_max: slow.motion.a[j], ..model.limits[j] };
        assert!(limits.stop_time_s() <= 0.5 && slow.motion.a[j] == slow.motion.a[j + 7]);
        let floor = survey.floor(j, limits.v_max, 0.5).unwrap();
        assert!((limits.v_max / floor + floor / limits.j_max - 0.5).abs() < 1e-12);
    }
    // Larger by one step somewhere, and some state exceeds: that is what largest means.
    let states: Vec<_> = slow.found.iter().zip(&slow.climbed).map(|(f, c)| f.worst.iter().chain(c).copied()).collect();
    let larger = slow.motion.a.map(|a| a * 1.03);
    let exceeds = |(j, mut states): (usize, _)| {
        let bound = 0.85 * survey.effort(j);
        Iterator::any(&mut states, |state: collision::limits::State| state.torque(&larger) > bound)
    };
    assert!(states.into_iter().enumerate().any(exceeds));
    // At the URDF's own velocities there is none.
    assert!(!survey.solve(&scaled_speeds(&model, 1.0), 8.0, 0.5).complete);
    let written = with_section(ROBOTS[0].0, &section(&survey, &slow, "a command")).unwrap();
    let again = Model::from_text("toml", &written, "urdf", ROBOTS[0].1).unwrap();
    assert!(
        LEFT_ARM
            .into_iter()
            .all(|j| again.limits[j].a_max == slow.motion.a[j] && again.limits[j].v_max == slow.motion.v[j])
    );
    assert_eq!(with_section(&written, &section(&survey, &slow, "a command")).unwrap(), written);
}

/// Weights are bound to the arms and the name of the robot: both files take the same.
#[test]
fn both_shipped_robots_have_the_same_arms() {
    let [(hands, _), (grippers, _)] = ROBOTS.map(load);
    assert_eq!((&hands.name, hands.arms), (&grippers.name, grippers.arms));
    assert_ne!(hands.hash, grippers.hash);
    assert!(hands.link_body("gripper_left_link").is_none() && grippers.link_body("gripper_left_link").is_some());
}
