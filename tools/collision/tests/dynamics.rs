//! Torques are right: compared with a closed form, with energy, with the mass matrix by two algorithms, and
//! with another implementation.

use collision::dynamics::{Dynamics, GRAVITY_M_PER_S2, Payload, PerJoint};
use messages::JOINTS_MAX;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::Model;

/// Joints of TIAGo++.
const JOINTS: usize = 17;

const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");
const VECTORS: &str = include_str!("data/rnea_vectors.txt");

fn shipped() -> (Model, urdf_rs::Robot) {
    let model = Model::from_text("tiago_dual.toml", TOML, "tiago_dual.urdf", URDF).unwrap();
    (model, urdf_rs::read_from_string(URDF).unwrap())
}

fn hands(mass_kg: f64) -> Vec<Payload> {
    ["hand_left_grasping_frame", "hand_right_grasping_frame"]
        .map(|link| Payload { link: link.into(), center: Vector3::zeros(), mass_kg })
        .into()
}

fn random_state(model: &Model, rng: &mut rand_pcg::Pcg64) -> [PerJoint; 3] {
    let q = std::array::from_fn(|j| rng.random_range(model.limits[j].q_min..model.limits[j].q_max));
    let mut within = |most: f64| std::array::from_fn(|_| rng.random_range(-most..most));
    [q, within(2.0), within(8.0)]
}

#[test]
fn torques_agree_with_pinocchio() {
    let (model, urdf) = shipped();
    let dynamics = Dynamics::new(&model, &urdf, &hands(0.7)).unwrap();
    let rows: Vec<PerJoint> = VECTORS
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            assert_eq!(numbers.len(), model.count);
            std::array::from_fn(|j| numbers.get(j).copied().unwrap_or(0.0))
        })
        .collect();
    assert_eq!(rows.len(), 80);
    for state in rows.chunks(4) {
        let torques = dynamics.at(&state[0]).torques(&state[1], &state[2], GRAVITY_M_PER_S2);
        for (j, (ours, theirs)) in torques.iter().zip(&state[3]).enumerate() {
            assert!((ours - theirs).abs() < 1e-9, "{j}: {ours} {theirs}");
        }
    }
}

/// The torques of a unit acceleration without velocity and gravity are a column of the mass matrix.
#[test]
fn mass_matrix_is_symmetric_positive_and_matches_torques() {
    let (model, urdf) = shipped();
    let dynamics = Dynamics::new(&model, &urdf, &[]).unwrap();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    for _ in 0..50 {
        let [q, v, _] = random_state(&model, &mut rng);
        let posture = dynamics.at(&q);
        let composite = posture.mass_matrix();
        let column = |k: usize| {
            let unit = std::array::from_fn(|j| f64::from(u8::from(j == k)));
            posture.torques(&[0.0; JOINTS_MAX], &unit, 0.0)
        };
        let columns: [PerJoint; JOINTS_MAX] = std::array::from_fn(column);
        let mut twice_kinetic = 0.0;
        for j in 0..JOINTS {
            for k in 0..JOINTS {
                assert!((columns[k][j] - columns[j][k]).abs() < 1e-12);
                assert!((columns[k][j] - composite[j][k]).abs() < 1e-12);
                twice_kinetic += v[j] * composite[j][k] * v[k];
            }
        }
        assert!(twice_kinetic > 0.0 && (0.5 * twice_kinetic - posture.kinetic_j(&v)).abs() < 1e-10);
    }
}

/// The work of the joints equals the energy that the robot gains: d/dt (kinetic + potential) = torque . velocity.
#[test]
fn joint_power_equals_the_rate_of_energy() {
    let (model, urdf) = shipped();
    let dynamics = Dynamics::new(&model, &urdf, &hands(1.0)).unwrap();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
    for _ in 0..50 {
        let [q, v, a] = random_state(&model, &mut rng);
        let energy = |dt: f64| {
            let later: PerJoint = std::array::from_fn(|j| q[j] + v[j] * dt + 0.5 * a[j] * dt * dt);
            let faster: PerJoint = std::array::from_fn(|j| v[j] + a[j] * dt);
            let posture = dynamics.at(&later);
            posture.kinetic_j(&faster) + posture.potential_j(GRAVITY_M_PER_S2)
        };
        let dt = 1e-5;
        let rate = (energy(dt) - energy(-dt)) / (2.0 * dt);
        let torques = dynamics.at(&q).torques(&v, &a, GRAVITY_M_PER_S2);
        let power: f64 = torques.iter().zip(&v).map(|(torque, v)| torque * v).sum();
        assert!((rate - power).abs() < 1e-4 * power.abs().max(10.0), "{rate} {power}");
    }
}

/// All mass except one point is removed. The joint above it is a pendulum, tau = m l^2 qdd + m g l sin(q) from hanging.
#[test]
fn point_mass_on_the_elbow_needs_the_torque_of_a_pendulum() {
    let (model, mut urdf) = shipped();
    for link in &mut urdf.links {
        link.inertial = urdf_rs::Inertial::default();
    }
    let mass_kg = 1.3;
    let dynamics =
        Dynamics::new(&model, &urdf, &[Payload { link: "arm_left_5_link".into(), center: Vector3::zeros(), mass_kg }])
            .unwrap();
    // Joint 4 with the upper arm level sideways. Its axis and the mass determine the torque, for any frames of
    // the URDF.
    let mut frames = robot::Frames::default();
    for turn in [-0.3, 0.4, 1.1, 2.0] {
        let mut q = model.home;
        q[6] = turn;
        model.forward(&q, &mut frames);
        let elbow = &frames.base_from_body[7];
        let axis = elbow.r * model.joint_at_zero(6).1;
        let arm = frames.base_from_body[8].t - elbow.t;
        let lever = arm - axis * axis.dot(&arm);
        let gravity = axis.dot(&lever.cross(&nalgebra::Vector3::new(0.0, 0.0, mass_kg * GRAVITY_M_PER_S2)));
        let mut a = [0.0; JOINTS_MAX];
        a[6] = 5.0;
        let mut v = [0.0; JOINTS_MAX];
        // Turning at any steady speed needs no torque about the axis.
        v[6] = 2.0;
        let torque = dynamics.at(&q).torques(&v, &a, GRAVITY_M_PER_S2)[6];
        let closed = mass_kg * lever.norm_squared() * 5.0 + gravity;
        assert!((torque - closed).abs() < 1e-12, "{turn}: {torque} {closed}");
        assert!(lever.norm() > 0.1);
    }
}
