//! Local rotations: the limbs equal those of the person with these turns of the arms.

use crate::client::{Client, Person, Turn, about, accept, as_smpl, bent, hinges, judge, limbs_differ, t_pose};
use crate::golden::FLOAT_ERROR;
use Direction::{Forward, Left, Right, Up};
use layouts::{Direction, Layouts, Map};
use messages::{RawSkeleton, SMPL_JOINTS, SMPL_NAMES, SkeletonLayout, raw_flag};
use nalgebra::Vector3;

const UNITY: &str = "Hips LeftUpperLeg RightUpperLeg LeftLowerLeg RightLowerLeg LeftFoot RightFoot Spine Chest Neck Head \
    LeftShoulder RightShoulder LeftUpperArm RightUpperArm LeftLowerArm RightLowerArm LeftHand RightHand LeftToes \
    RightToes LeftEye RightEye Jaw 24 25 26 27 28 29 30 31 32 33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 \
    50 51 52 53 UpperChest";
const UNITY_NAMES: &str = "Hips LeftUpperLeg RightUpperLeg Spine LeftLowerLeg RightLowerLeg Chest LeftFoot RightFoot UpperChest \
    LeftToes RightToes Neck LeftShoulder RightShoulder Head LeftUpperArm RightUpperArm LeftLowerArm \
    RightLowerArm LeftHand RightHand";

fn smpl(number: SkeletonLayout, joints: usize, directions: [Direction; 3]) -> Client {
    let names = [&SMPL_NAMES[..], &["left_hand", "right_hand"]].concat();
    Client::new(number, &names[..joints].join(" "), &SMPL_NAMES.join(" "), directions)
}

fn unity() -> Client {
    Client::new(SkeletonLayout::UnityHumanoid, UNITY, UNITY_NAMES, [Right, Up, Forward])
}

/// Sends the arms' turns, each relative to its parent joint. The rest is as in the T-pose. `root` turns the world.
fn send(client: &Client, person: &Person, root: Turn) -> RawSkeleton {
    let mut raw = client.frame();
    raw.flags = raw_flag::ROTATIONS | raw_flag::LOCAL;
    let theirs = |turn: Turn| client.axes * turn * client.axes.transpose();
    for smpl in 0..SMPL_JOINTS {
        let index = client.index(smpl).expect("a bone");
        let local = match smpl {
            0 => root,
            18.. => person.turns[smpl - 2].transpose() * person.turns[smpl],
            _ => person.turns[smpl],
        };
        client.turn(&mut raw, index, theirs(local));
    }
    let at = client.axes * Vector3::new(1.0, 2.0, 0.9);
    raw.positions[client.index(0).expect("a root")] = [at.x as f32, at.y as f32, at.z as f32];
    raw.calibration = hinges(&(client.axes * client.axes.determinant()));
    raw
}

fn y_up() -> (Layouts, Client) {
    let text = include_str!("../../../config/skeletons/smpl_y_up.toml");
    let mut layouts = Layouts::default();
    layouts.add("smpl_y_up.toml", Map::parse("smpl_y_up.toml", text).expect("shipped")).expect("a number of its own");
    (layouts, Client { number: 1024, ..smpl(SkeletonLayout::Smpl24, 24, [Left, Up, Forward]) })
}

#[test]
fn local_rotations_give_same_arms_as_smpl_22() {
    let (layouts, y_up) = y_up();
    let ours = [Forward, Left, Up];
    let smpl22 = smpl(SkeletonLayout::Smpl22, 22, ours);
    for client in [unity(), smpl22, smpl(SkeletonLayout::Smpl24, 24, ours), y_up] {
        for person in [t_pose(), bent()] {
            let truth = judge(&as_smpl(&person, true)).expect("a person");
            // Independent of the person's direction and lean.
            for root in [Turn::identity(), about([0.1, 0.2, 1.0], 0.7), about([0.0, 1.0, 0.0], 0.3)] {
                let accepted = accept(&layouts, &send(&client, &person, root)).unwrap_or_else(|why| panic!("{why:?}"));
                let off = limbs_differ(&accepted, &truth);
                assert!(off < FLOAT_ERROR, "layout {}: {off}", client.number);
                assert_eq!(accepted.positions[0], [1.0, 2.0, 0.9]);
            }
        }
    }
}

#[test]
fn turned_shoulder_blade_moves_its_arm_alone() {
    let unity = unity();
    let mut raw = send(&unity, &t_pose(), Turn::identity());
    // LeftShoulder turns about the forward axis, so the arm rises. In Unity that is z, with the opposite sense.
    raw.rotations[11] = [0.0, 0.0, -(0.15_f32.sin()), 0.15_f32.cos()];
    let accepted = accept(&Layouts::default(), &raw).expect("a person");
    let [shoulder, elbow, wrist] = [16, 18, 20].map(|joint| accepted.positions[joint]);
    for (from, to, length) in [(shoulder, elbow, 0.3255_f32), (elbow, wrist, 0.2555)] {
        assert!((to[2] - from[2] - length * 0.3_f32.sin()).abs() < 1e-5, "{from:?} {to:?}");
        assert!((to[1] - from[1] - length * 0.3_f32.cos()).abs() < 1e-5, "{from:?} {to:?}");
    }
    assert!(accepted.positions[21][2] < wrist[2], "the right arm stays");
}

#[test]
fn bone_with_low_confidence_lowers_confidence_of_its_children() {
    let unity = unity();
    let mut raw = send(&unity, &bent(), Turn::identity());
    raw.confidence[15] = 0.2; // LeftLowerArm
    let out = Layouts::default().convert(&raw).expect("a frame");
    assert_eq!([18, 20, 16, 19, 21].map(|joint| out.confidence[joint]), [0.2, 0.2, 1.0, 1.0, 1.0]);
}
