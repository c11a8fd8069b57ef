//! Checks torques and accelerations against another implementation.

use crate::support::{GRIPPERS, HANDS, JOINTS, Texts, body, uniform};
use messages::JOINTS_MAX;
use plant::{Drive, Dynamics, Frames, Posture};
use rand::{RngExt, SeedableRng};

type PerJoint = [f64; JOINTS_MAX];

/// q, v, a, torque with 0.7 kg in each hand, made by Pinocchio.
const INVERSE: &str = include_str!("data/rnea_vectors.txt");
/// q, v, torque, a with rotors, made by Pinocchio.
const FORWARD: [(Texts, &str); 2] =
    [(HANDS, include_str!("data/aba_tiago_dual.txt")), (GRIPPERS, include_str!("data/aba_tiago_dual_pal_gripper.txt"))];

fn rows(text: &str) -> Vec<PerJoint> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let padded = |line: &str| {
        let mut row = [0.0; JOINTS_MAX];
        for (value, word) in row.iter_mut().zip(line.split(' ')) {
            *value = word.parse().unwrap();
        }
        row
    };
    lines.map(padded).collect()
}

fn posture(body: &plant::Body, dynamics: &Dynamics, q: &PerJoint) -> Posture {
    let mut frames = Frames::default();
    body.forward(q, &mut frames);
    dynamics.at(&frames)
}

fn accelerate(body: &plant::Body, dynamics: &Dynamics, q: &PerJoint, v: &PerJoint, torque: &PerJoint) -> PerJoint {
    dynamics.accelerations(&posture(body, dynamics, q), v, &torque.map(Drive::Torque))
}

fn farthest(a: &PerJoint, b: &PerJoint) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn torques_and_accelerations_match_pinocchio() {
    let mut body = body(HANDS);
    for link in ["hand_left_grasping_frame", "hand_right_grasping_frame"] {
        assert!(body.add_payload(link, 0.7));
    }
    let dynamics = Dynamics::new(&body, [0.0; JOINTS_MAX]);
    let states = rows(INVERSE);
    assert_eq!(states.len(), 80);
    for state in states.chunks(4) {
        let a = accelerate(&body, &dynamics, &state[0], &state[1], &state[3]);
        assert!(farthest(&a, &state[2]) < 1e-9, "{}", farthest(&a, &state[2]));
        let torques = dynamics.torques(&posture(&body, &dynamics, &state[0]), &state[1], &state[2]);
        assert!(farthest(&torques, &state[3]) < 1e-9, "{}", farthest(&torques, &state[3]));
    }
}

#[test]
fn accelerations_with_rotors_match_pinocchio() {
    for (texts, text) in FORWARD {
        let body = body(texts);
        let dynamics = Dynamics::new(&body, std::array::from_fn(|j| 0.01 * (j + 1) as f64));
        let states = rows(text);
        assert_eq!(states.len(), 40);
        for state in states.chunks(4) {
            let a = accelerate(&body, &dynamics, &state[0], &state[1], &state[2]);
            let scale = state[3].iter().fold(1.0_f64, |most, a| most.max(a.abs()));
            assert!(farthest(&a, &state[3]) < 1e-9 * scale, "{}: {}", texts[0], farthest(&a, &state[3]));
        }
    }
}

/// A joint with a prescribed acceleration has it. The others move as if the joint had the torque that this needs.
#[test]
fn prescribed_acceleration_acts_like_its_torque() {
    let body = body(HANDS);
    let dynamics = Dynamics::new(&body, [0.02; JOINTS_MAX]);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    for n in 0..100 {
        let (q, v) = (uniform(&body, &mut rng), std::array::from_fn(|_| rng.random_range(-2.0..2.0)));
        let torque: PerJoint = std::array::from_fn(|_| rng.random_range(-5.0..5.0));
        let a = accelerate(&body, &dynamics, &q, &v, &torque);
        let mut drives = torque.map(Drive::Torque);
        for j in [n % JOINTS, (n * 7 + 3) % JOINTS] {
            drives[j] = Drive::Acceleration(a[j]);
        }
        let again = dynamics.accelerations(&posture(&body, &dynamics, &q), &v, &drives);
        assert!(farthest(&a, &again) < 1e-8, "{n}: {}", farthest(&a, &again));
    }
}

/// The torques that a unit acceleration adds are a column of the mass matrix.
#[test]
fn mass_matrix_is_symmetric_and_matches_torques() {
    let body = body(HANDS);
    let dynamics = Dynamics::new(&body, [0.0; JOINTS_MAX]);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    for _ in 0..50 {
        let posture = posture(&body, &dynamics, &uniform(&body, &mut rng));
        let v = std::array::from_fn(|_| rng.random_range(-2.0..2.0));
        let bias = dynamics.torques(&posture, &v, &[0.0; JOINTS_MAX]);
        let matrix = dynamics.mass_matrix(&posture);
        for (k, row) in matrix.iter().enumerate().take(JOINTS) {
            let moved = dynamics.torques(&posture, &v, &std::array::from_fn(|j| f64::from(u8::from(j == k))));
            for j in 0..JOINTS {
                assert_eq!(matrix[j][k], row[j]);
                let added = moved[j] - bias[j];
                assert!((added - row[j]).abs() < 1e-10, "{j} {k}: {added} {}", row[j]);
            }
        }
    }
}

/// The torques that hold a posture leave it at rest. A small extra torque accelerates its joint by torque over inertia.
#[test]
fn gravity_torques_hold_any_posture() {
    let body = body(HANDS);
    let dynamics = Dynamics::new(&body, [0.02; JOINTS_MAX]);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(6);
    for n in 0..100 {
        let q = uniform(&body, &mut rng);
        let posture = posture(&body, &dynamics, &q);
        let (gravity, diagonal) = dynamics.gravity_and_diagonal(&posture);
        let still = accelerate(&body, &dynamics, &q, &[0.0; JOINTS_MAX], &gravity);
        assert!(farthest(&still, &[0.0; JOINTS_MAX]) < 1e-9, "{still:?}");
        // All other joints are locked, so the joint feels the diagonal of the mass matrix alone.
        let j = n % JOINTS;
        let mut drives = [Drive::Acceleration(0.0); JOINTS_MAX];
        drives[j] = Drive::Torque(gravity[j] + 1.0);
        let a = dynamics.accelerations(&posture, &[0.0; JOINTS_MAX], &drives)[j];
        assert!((a * diagonal[j] - 1.0).abs() < 1e-9, "{j}: {a} {}", diagonal[j]);
    }
}
