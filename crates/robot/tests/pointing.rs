//! Wrist and head against a search, and under noise.

use nalgebra::{Rotation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Model, PointingJoints};

const ROBOTS: [&str; 5] = ["tiago_dual", "unitree_g1", "rby1a", "openarm_v10", "franka_fr3_duo"];

fn all() -> Vec<(String, PointingJoints)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/");
    let read = |name: &str| std::fs::read_to_string(format!("{folder}{name}")).expect("shipped with the repository");
    let of = |name: &str| {
        let model = Model::from_text("toml", &read(&format!("{name}.toml")), "urdf", &read(&format!("{name}.urdf")));
        let model = model.expect("the shipped robot");
        model.wrists.into_iter().chain(model.head).map(|joints| (name.to_owned(), joints)).collect::<Vec<_>>()
    };
    ROBOTS.into_iter().flat_map(of).collect()
}

fn rotation(joints: &PointingJoints, q: [f64; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(joints.rotation(q)))
}

fn random_turn(rng: &mut Pcg64) -> UnitQuaternion<f64> {
    let parts: [f64; 4] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    UnitQuaternion::new_normalize(nalgebra::Quaternion::from(parts))
}

fn within(joints: &PointingJoints, q: [f64; 3]) -> bool {
    (0..2).all(|i| (joints.q_min[i]..=joints.q_max[i]).contains(&q[i]))
}

/// Positions of the joints that there are.
fn within_range(joints: &PointingJoints, mut position: impl FnMut(usize) -> f64) -> [f64; 3] {
    std::array::from_fn(|i| joints.joints[i].map_or(0.0, |_| position(i)))
}

#[test]
fn robots_have_wrists_and_two_have_heads() {
    let joints = all();
    assert_eq!(joints.len(), 2 * ROBOTS.len() + 2);
    assert!(joints.iter().all(|(_, joints)| joints.axes[..2].iter().all(|axis| (axis.norm() - 1.0).abs() < 1e-9)));
}

#[test]
fn reachable_rotation_is_reached_exactly() {
    let mut rng = Pcg64::seed_from_u64(5);
    for (name, joints) in all() {
        for _ in 0..500 {
            let q = within_range(&joints, |i| rng.random_range(joints.q_min[i]..joints.q_max[i]));
            let wanted = rotation(&joints, q);
            let found = joints.nearest(&wanted, joints.home);
            assert!(within(&joints, found), "{name}: {found:?}");
            let off = rotation(&joints, found).angle_to(&wanted);
            assert!(off < 1e-6, "{name}: {q:?} became {found:?}, {off} rad off");
        }
    }
}

#[test]
fn nothing_on_a_grid_comes_nearer() {
    let mut rng = Pcg64::seed_from_u64(6);
    for (name, joints) in all() {
        for _ in 0..20 {
            let wanted = random_turn(&mut rng);
            let found = joints.nearest(&wanted, joints.home);
            assert!(within(&joints, found), "{name}: {found:?}");
            let off = rotation(&joints, found).angle_to(&wanted);
            let at = |i: usize, n: u32| joints.q_min[i] + f64::from(n) / 100.0 * (joints.q_max[i] - joints.q_min[i]);
            let grid = (0..=100).flat_map(|a| (0..=100).map(move |b| (a, b)));
            let least = grid.map(|(a, b)| rotation(&joints, [at(0, a), at(1, b), 0.0]).angle_to(&wanted));
            let least = least.fold(f64::INFINITY, f64::min);
            assert!(off <= least + 1e-9, "{name}: {off} rad, {least} on the grid");
        }
    }
}

#[test]
fn straight_hand_keeps_home() {
    for (name, joints) in all() {
        let found = joints.nearest(&UnitQuaternion::identity(), joints.home);
        assert!((0..2).all(|i| (found[i] - joints.home[i]).abs() < 1e-9), "{name}: {found:?}");
    }
}

#[test]
fn noise_of_half_a_degree_turns_no_joint_far() {
    let mut rng = Pcg64::seed_from_u64(7);
    for (name, joints) in all() {
        let (mut square, mut largest, count) = (0.0, 0.0_f64, 2000);
        for _ in 0..count {
            // A hand bends by up to 60 degrees. Beyond the joints' range the nearest point may leap, as for any wrist.
            let q = within_range(&joints, |i| {
                let bend = rng.random_range(-1.0..1.0);
                (joints.home[i] + bend).clamp(joints.q_min[i], joints.q_max[i])
            });
            let wanted = rotation(&joints, q);
            let [x, y, z]: [f64; 3] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            let noise =
                UnitQuaternion::from_scaled_axis(nalgebra::Vector3::new(x, y, z).normalize() * 0.5_f64.to_radians());
            let (still, noisy) = (joints.nearest(&wanted, joints.home), joints.nearest(&(noise * wanted), joints.home));
            for i in 0..2 {
                let moved = (noisy[i] - still[i]).abs().to_degrees();
                (square, largest) = (square + moved * moved, largest.max(moved));
            }
        }
        let rms = f64::sqrt(square / f64::from(2 * count));
        println!("{name}: joints {:?}: {rms:.2} degrees RMS, at most {largest:.2}", joints.joints);
        assert!(rms < 0.75 && largest < 2.0, "{name}: {rms} degrees RMS, at most {largest}");
    }
}
