//! Tests forward kinematics, Jacobians and the arms' axes.

use crate::support;

use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use robot::Frames;
use support::{JOINTS, shipped, uniform};

const VECTORS: &str = include_str!("data/fk_vectors.txt");

#[test]
fn forward_kinematics_match_independent_implementation() {
    let model = shipped();
    let links: Vec<_> = model.joint_names.iter().map(|name| name.replace("_joint", "_link")).collect();
    let mut frames = Frames::default();
    let (mut configurations, mut poses) = (0, 0);
    for line in VECTORS.lines().filter(|line| !line.starts_with('#')) {
        let (head, rest) = line.split_once(' ').unwrap();
        let numbers: Vec<f64> = rest.split(' ').map(|text| text.parse().unwrap()).collect();
        if head == "q" {
            let mut q = [0.0; JOINTS_MAX];
            q[..numbers.len()].copy_from_slice(&numbers);
            model.forward(&q, &mut frames);
            configurations += 1;
            continue;
        }
        let joint: usize = head.parse().unwrap();
        let pose = model.link_pose(&frames, &links[joint]).unwrap();
        let [x, y, z, i, j, k, w] = numbers.try_into().unwrap();
        let r = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k)).to_rotation_matrix();
        let off = (pose.t - Vector3::new(x, y, z)).amax().max((pose.r - r.matrix()).amax());
        assert!(off < 1e-12, "{}: {off:e}", links[joint]);
        poses += 1;
    }
    assert_eq!((configurations, poses), (200, 25 * 17 + 175 * 3));
}

#[test]
fn jacobian_columns_match_finite_differences_of_pose() {
    let model = shipped();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    let (mut plus, mut minus, mut frames) = (Frames::default(), Frames::default(), Frames::default());
    for _ in 0..50 {
        let q = uniform(&model, &mut rng);
        model.forward(&q, &mut frames);
        for body in 0..=JOINTS {
            let local = Vector3::from_fn(|_, _| rng.random_range(-0.3..0.3));
            let point = frames.base_from_body[body].transform_point(&local);
            let jacobian = model.jacobian(&frames, body, &point);
            for j in 0..JOINTS {
                let step = 1e-6;
                let (mut up, mut down) = (q, q);
                (up[j], down[j]) = (q[j] + step, q[j] - step);
                model.forward(&up, &mut plus);
                model.forward(&down, &mut minus);
                let (p, m) = (&plus.base_from_body[body], &minus.base_from_body[body]);
                let linear = (p.transform_point(&local) - m.transform_point(&local)) / (2.0 * step);
                // dR R^T is the cross-product matrix of the angular velocity.
                let spin: Matrix3<f64> = (p.r - m.r) / (2.0 * step) * frames.base_from_body[body].r.transpose();
                let angular = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
                let column = Vector3::from_row_slice(&jacobian[j][..3]);
                let turning = Vector3::from_row_slice(&jacobian[j][3..]);
                assert!((column - linear).amax() < 1e-8, "body {body} joint {j}: {column} {linear}");
                assert!((turning - angular).amax() < 1e-8, "body {body} joint {j}: {turning} {angular}");
            }
        }
    }
}

fn about(axis: Vector3<f64>, angle: f64) -> Matrix3<f64> {
    *UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(axis), angle).to_rotation_matrix().matrix()
}

/// The limb rotations of the left arm: U = Rz(-q1) Rx(-q2) Ry(q3 - pi/2) and F = U Rz(-q4) Ry(-q5). The right
/// arm is the mirror image.
fn formula(q: &[f64]) -> (Matrix3<f64>, Matrix3<f64>) {
    let upper = about(Vector3::z(), -q[0])
        * about(Vector3::x(), -q[1])
        * about(Vector3::y(), q[2] - std::f64::consts::FRAC_PI_2);
    (upper, upper * about(Vector3::z(), -q[3]) * about(Vector3::y(), -q[4]))
}

#[test]
fn limb_rotations_match_closed_formula_and_chain() {
    let model = shipped();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    let mut t_pose = [0.0; JOINTS_MAX];
    for arm in &model.arms {
        arm.set_limbs(&arm.reference, &mut t_pose);
    }
    let (mut frames, mut reference) = (Frames::default(), Frames::default());
    model.forward(&t_pose, &mut reference);
    for _ in 0..200 {
        let q = uniform(&model, &mut rng);
        model.forward(&q, &mut frames);
        for (side, arm) in model.arms.iter().enumerate() {
            let angles: [f64; 5] = arm.limb_values(&q);
            let (mut upper, mut fore) = formula(&angles);
            if side == 1 {
                (upper, fore) = (mirror * upper * mirror, mirror * fore * mirror);
            }
            let rotations = arm.limb_rotations(&angles);
            assert!((rotations.0 - upper).amax() < 1e-12 && (rotations.1 - fore).amax() < 1e-12);
            for (joint, limb) in [(2, upper), (4, fore)] {
                let body = arm.range().start + joint + 1;
                let chain = frames.base_from_body[body].r * reference.base_from_body[body].r.transpose();
                assert!((chain - limb).amax() < 1e-12, "side {side} joint {joint}");
            }
        }
    }
}

#[test]
fn known_link_has_a_pose_and_unknown_link_has_none() {
    let model = shipped();
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let base = model.link_pose(&frames, "base_footprint").unwrap();
    assert_eq!(base, robot::Pose::identity());
    // A tool link is rigidly fixed to its wrist, so its distance to the wrist does not depend on the posture.
    let distance = |frames: &Frames| {
        let tool = model.link_pose(frames, "hand_left_tool_link").unwrap();
        (tool.t - model.link_pose(frames, "arm_left_7_link").unwrap().t).norm()
    };
    let at_home = distance(&frames);
    model.forward(&[0.1; JOINTS_MAX], &mut frames);
    assert!((distance(&frames) - at_home).abs() < 1e-12 && at_home > 0.05);
    assert!(model.link_pose(&frames, "no_such_link").is_none());
}

#[test]
fn base_height_raises_every_body_and_is_bounded() {
    let raised = |height_m: &str| {
        let base = "base_link = \"base_footprint\"\n";
        support::load(&support::TOML.replace(base, &format!("{base}base_height_m = {height_m}\n")), support::URDF)
    };
    let (low, high) = (shipped(), raised("0.4").expect("a robot on a pedestal"));
    let (mut below, mut above) = (Frames::default(), Frames::default());
    low.forward(&low.home, &mut below);
    high.forward(&high.home, &mut above);
    let up = Vector3::new(0.0, 0.0, 0.4);
    for body in 1..=low.count {
        let [below, above] = [&below, &above].map(|frames| frames.base_from_body[body]);
        assert!((above.t - below.t - up).norm() < 1e-12 && above.r == below.r, "body {body}");
    }
    // The capsules of the base too: its frame lies on the floor.
    for (below, above) in low.capsules.iter().zip(&high.capsules).filter(|(below, _)| below.body == 0) {
        assert!((above.a - below.a - up).norm() < 1e-12, "{}", below.name);
    }
    assert_eq!(low.arms, high.arms, "the arms turn limbs as before");
    let refused = raised("-0.1").expect_err("below the floor").to_string();
    assert!(refused.contains("base_height_m = -0.1, must lie in [0, 3]"), "{refused}");
}
