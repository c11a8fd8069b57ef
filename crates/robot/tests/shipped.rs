//! Tests the shipped robot.

use crate::support;

use nalgebra::{Matrix3, Vector3};
use robot::{AllowedReason, Form, Frames, Inertia};
use std::f64::consts::FRAC_PI_2;
use support::{GRIPPER_TOML, GRIPPER_URDF, LEFT_ARM, RIGHT_ARM, TOML, URDF, load, shipped};

#[test]
fn home_posture_has_5_cm_clearance_and_room_to_limits() {
    let model = shipped();
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let (clearance_m, pair) = model.clearance(&frames);
    let pair = model.pairs[pair];
    let names = (&model.capsules[pair.a].name, &model.capsules[pair.b].name);
    assert!(clearance_m > 0.05, "{clearance_m} m between {names:?}");
    for j in LEFT_ARM.chain(RIGHT_ARM) {
        let limits = &model.limits[j];
        let room = (model.home[j] - limits.q_min).min(limits.q_max - model.home[j]);
        assert!(room > 0.2, "{}: {room} rad", model.joint_names[j]);
    }
}

/// Tests the most common pose of a person. When the arms hang straight down, the hands pass close to the
/// base. This must be admissible. Five degrees away from it there must be room.
#[test]
fn hanging_arms_keep_minimum_clearance() {
    let model = shipped();
    let mut frames = Frames::default();
    for lift in [0.2, 0.25, 0.3] {
        for elbow in [0.1, 0.4, 0.8] {
            for (shoulder, least_m) in [(1.5, model.d_min_m), (1.4, 0.05)] {
                let mut q = model.home;
                q[0] = lift;
                for arm in [LEFT_ARM, RIGHT_ARM] {
                    let posture = [0.0, shoulder, FRAC_PI_2, elbow, 0.0, 0.0, 0.0];
                    arm.zip(posture).for_each(|(j, position)| q[j] = position);
                }
                model.forward(&q, &mut frames);
                let (clearance_m, pair) = model.clearance(&frames);
                let pair = model.pairs[pair];
                let names = (&model.capsules[pair.a].name, &model.capsules[pair.b].name);
                assert!(clearance_m > least_m, "lift {lift} elbow {elbow}: {clearance_m} {names:?}");
            }
        }
    }
}

#[test]
fn arms_are_checked_against_torso() {
    let model = shipped();
    let named = |a: &str, b: &str| {
        let name = |index: usize| model.capsules[index].name.as_str();
        model.pairs.iter().any(|pair| {
            (name(pair.a).starts_with(a) && name(pair.b).starts_with(b))
                || (name(pair.a).starts_with(b) && name(pair.b).starts_with(a))
        })
    };
    for side in ["left", "right"] {
        assert!(named("column_", &format!("arm_{side}_3")));
        for part in ["arm_{side}_4", "arm_{side}_5", "hand_{side}_0", "hand_{side}_1"] {
            assert!(named("torso_", &part.replace("{side}", side)), "{part}");
        }
    }
    // Pairs of the upper arms and the torso are left unchecked only by proof, never by assumption.
    for pair in &model.allowed {
        let names = [&model.capsules[pair.a].name, &model.capsules[pair.b].name];
        let upper = |name: &&String| name.starts_with("arm_") && (name.ends_with("_2") || name.ends_with("_3"));
        if names.iter().any(upper) && names.iter().any(|name| name.starts_with("torso_")) {
            assert_eq!(pair.reason, AllowedReason::ProvedClear, "{names:?}");
        }
    }
    assert!(named("hand_left_0", "hand_right_0") && named("arm_left_3", "arm_right_5"));
}

#[test]
fn capsule_pair_is_checked_or_has_a_reason() {
    let model = shipped();
    let n = model.capsules.len();
    assert_eq!(model.pairs.len() + model.allowed.len(), n * (n - 1) / 2);
    for pair in &model.allowed {
        let (a, b) = (model.capsules[pair.a].body, model.capsules[pair.b].body);
        let adjacent = model.parent_body(a) == Some(b) || model.parent_body(b) == Some(a);
        assert_eq!(pair.reason == AllowedReason::SameBody, a == b);
        assert_eq!(pair.reason == AllowedReason::Adjacent, adjacent);
    }
}

#[test]
fn arms_have_speeds_of_urdf_and_stop_in_300_ms() {
    let model = shipped();
    // The arms have the URDF's speeds. They stop within 0.3 s where their motors can do so: v / A + 2 A / J.
    for (limits, urdf) in model.limits[3..].iter().zip(&model.urdf_limits[3..]) {
        assert_eq!(limits.v_max, urdf.v_max);
        let longest_s = limits.v_max / limits.a_max + 2.0 * limits.a_max / limits.j_max;
        assert!(longest_s <= 0.3, "{longest_s}");
    }
    assert_eq!((model.limits[3].v_max, model.limits[5].v_max, model.limits[9].v_max), (1.95, 2.35, 1.76));
    assert!((model.limits[3].q_max - (FRAC_PI_2 - 0.02)).abs() < 1e-15);
}

/// All links are on some body. The bodies together weigh as much as the URDF's links.
#[test]
fn masses_match_urdf() {
    let inertias = shipped().inertias();
    let urdf = urdf_rs::read_from_string(URDF).unwrap();
    let links: f64 = urdf.links.iter().map(|link| link.inertial.mass.value).sum();
    let bodies: f64 = inertias.iter().map(|body| body.mass_kg).sum();
    assert!(links > 70.0 && (bodies - links).abs() < 1e-9, "{bodies} {links}");
    // The right hand is nearly the mirror image of the left one.
    let [left, right] = [inertias[10], inertias[17]];
    assert_eq!(left.mass_kg, right.mass_kg);
    assert!((left.center.norm() - right.center.norm()).abs() < 3e-3 && left.center.norm() > 0.1, "{left:?} {right:?}");
    // Two points on one body form a dumb-bell.
    let half = |x: f64| Inertia::point(1.5, Vector3::new(x, 0.0, 0.0));
    let both = half(-0.2).combined(&half(0.4));
    assert!(both.mass_kg == 3.0 && (both.center.x - 0.1).abs() < 1e-15);
    assert!((both.about_center[(1, 1)] - 3.0 * 0.09).abs() < 1e-15 && both.about_center[(0, 0)] == 0.0);
    assert!((both.about(&Vector3::zeros())[(2, 2)] - 1.5 * (0.04 + 0.16)).abs() < 1e-15);
}

#[test]
fn hash_changes_with_either_file() {
    let model = shipped();
    assert_eq!(model.hash, load(TOML, URDF).unwrap().hash);
    assert_ne!(model.hash, load(&format!("{TOML}# another\n"), URDF).unwrap().hash);
    assert_ne!(model.hash, load(TOML, &format!("{URDF}\n")).unwrap().hash);
}

/// There are as many shapes as visuals in the URDF, since none of them is a mesh. The base's box of the
/// wheels is where the file puts it.
#[test]
fn shapes_are_drawn_in_their_body() {
    let model = shipped();
    let shapes: Vec<_> = model.visuals().collect();
    assert_eq!(shapes.len(), URDF.matches("<visual>").count());
    let size = |form: Form| if let Form::Box(size) = form { size } else { [0.0; 3] };
    let base = shapes.iter().find(|shape| size(shape.form) == [0.5, 0.4996, 0.275]).expect("the base's box");
    let link = model.links().find(|(name, ..)| *name == "base_link").expect("base_link");
    assert_eq!((base.body, base.body_from_shape.t - link.2.t), (0, nalgebra::Vector3::new(0.0, 0.0, 0.064)));
    assert!(shapes.iter().any(|shape| shape.body == LEFT_ARM.start + 1));
}

#[test]
fn shapes_of_invalid_size_are_left_out() {
    let count = |box_size: &str| {
        let text = URDF.replace("<box size=\"0.5 0.4996 0.275\"/>", box_size);
        load(TOML, &text).expect("a robot").visuals().count()
    };
    let all = count("<box size=\"0.5 0.4996 0.275\"/>");
    for bad in ["<box size=\"0.5 -1 0.275\"/>", "<box size=\"0.5 NaN 0.275\"/>", "<sphere radius=\"99\"/>"] {
        assert!(count(bad) < all, "{bad}");
    }
    assert_eq!(count("<sphere radius=\"0.2\"/>"), all);
    assert_eq!(count("<capsule radius=\"0.2\" length=\"0.4\"/>"), all);
}

/// The largest principal moment of a rigid body is at most the sum of the others. Other readers of URDF refuse more.
#[test]
fn shipped_inertias_are_those_of_rigid_bodies() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut count = 0;
    for file in files.filter(|file| file.extension().is_some_and(|extension| extension == "urdf")) {
        let robot = robot::read_urdf(&file.display().to_string(), &std::fs::read_to_string(&file).unwrap()).unwrap();
        for link in &robot.links {
            let i = &link.inertial.inertia;
            let moments = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
            let moments = moments.symmetric_eigenvalues();
            let (least, others) = (moments.min(), moments.sum() - moments.max());
            assert!(least >= 0.0 && moments.max() <= others, "{}: {}: {moments}", file.display(), link.name);
        }
        count += 1;
    }
    assert!(count >= 6, "{count} robots");
}

/// The centres of the shipped files are where the hands grasp, in the frame of the arm's last body.
#[test]
fn empty_hands_have_payload_centre_at_grasping_frame() {
    for (toml, urdf, link) in
        [(TOML, URDF, "hand_SIDE_grasping_frame"), (GRIPPER_TOML, GRIPPER_URDF, "gripper_SIDE_grasping_frame")]
    {
        let model = load(toml, urdf).unwrap();
        for (side, payload) in ["left", "right"].into_iter().zip(model.payload) {
            let payload = payload.expect("both hands are in the file");
            let (body, pose) = model.link_body(&link.replace("SIDE", side)).expect("a link of the URDF");
            assert_eq!(payload.mass_kg, 0.0);
            assert_eq!(body, if side == "left" { LEFT_ARM.end } else { RIGHT_ARM.end });
            assert!((payload.center - pose.t).amax() < 1e-5, "{link} {side}: {:?}", pose.t);
        }
    }
}
