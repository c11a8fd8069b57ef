//! Torques are right: compared with another implementation, and with the mass matrix by two algorithms.

use collision::dynamics::{Dynamics, GRAVITY_M_PER_S2, PerJoint};
use messages::JOINTS_MAX;
use rand::{RngExt, SeedableRng};
use robot::{Inertia, Model};

/// Joints of TIAGo++.
const JOINTS: usize = 17;

const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");
const VECTORS: &str = include_str!("data/rnea_vectors.txt");

fn shipped() -> Model {
    Model::from_text("tiago_dual.toml", TOML, "tiago_dual.urdf", URDF).unwrap()
}

fn hands(model: &Model, mass_kg: f64) -> [(usize, Inertia); 2] {
    ["hand_left_grasping_frame", "hand_right_grasping_frame"].map(|link| {
        let (body, pose) = model.link_body(link).expect("a hand");
        (body, Inertia::point(mass_kg, pose.t))
    })
}

fn random_state(model: &Model, rng: &mut rand_pcg::Pcg64) -> [PerJoint; 3] {
    let q = std::array::from_fn(|j| rng.random_range(model.limits[j].q_min..model.limits[j].q_max));
    let mut within = |most: f64| std::array::from_fn(|_| rng.random_range(-most..most));
    [q, within(2.0), within(8.0)]
}

#[test]
fn torques_agree_with_pinocchio() {
    let model = shipped();
    let dynamics = Dynamics::new(&model, hands(&model, 0.7));
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
    let model = shipped();
    let dynamics = Dynamics::new(&model, []);
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
        assert!(twice_kinetic > 0.0);
    }
}
