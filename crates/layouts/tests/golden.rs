//! One person in every built-in layout: the limbs equal those of the same person sent as SMPL-22.

use crate::client::{Client, Person, Turn, about, accept, as_smpl, bent, judge, limbs_differ, t_pose};
use Direction::{Back, Down, Forward, Left, Right, Up};
use layouts::{Direction, Layouts};
use messages::{SMPL_JOINTS, SMPL_NAMES, SkeletonLayout, raw_flag, skeleton_flag};

/// Error bound: positions of 2 m in single precision over bones of 0.26 m, with a few roundings each.
pub(crate) const FLOAT_ERROR: f32 = 2e-5;

const MEDIA_PIPE: &str = "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear mouth_left \
    mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky right_pinky left_index \
    right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle right_ankle left_heel right_heel \
    left_foot_index right_foot_index";
const MEDIA_PIPE_NAMES: &str = "- left_hip right_hip - left_knee right_knee - left_ankle right_ankle - left_foot_index right_foot_index - - \
    - - left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist";

const KINECT: &str = "PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT \
    THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT HIP_LEFT KNEE_LEFT \
    ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT";
const KINECT_NAMES: &str = "PELVIS HIP_LEFT HIP_RIGHT SPINE_NAVEL KNEE_LEFT KNEE_RIGHT - ANKLE_LEFT ANKLE_RIGHT SPINE_CHEST FOOT_LEFT \
    FOOT_RIGHT NECK CLAVICLE_LEFT CLAVICLE_RIGHT HEAD SHOULDER_LEFT SHOULDER_RIGHT ELBOW_LEFT ELBOW_RIGHT \
    WRIST_LEFT WRIST_RIGHT";

const XSENS: &str = "Pelvis L5 L3 T12 T8 Neck Head RightShoulder RightUpperArm RightForeArm RightHand LeftShoulder LeftUpperArm \
    LeftForeArm LeftHand RightUpperLeg RightLowerLeg RightFoot RightToe LeftUpperLeg LeftLowerLeg LeftFoot LeftToe";
const XSENS_NAMES: &str = "Pelvis LeftUpperLeg RightUpperLeg L3 LeftLowerLeg RightLowerLeg T12 LeftFoot RightFoot T8 LeftToe RightToe \
    Neck LeftShoulder RightShoulder Head LeftUpperArm RightUpperArm LeftForeArm RightForeArm LeftHand RightHand";

/// Clients of all layouts that send positions, and rotations if the layout has any.
pub(crate) fn clients() -> Vec<Client> {
    let smpl = SMPL_NAMES.join(" ");
    let smpl24 = format!("{smpl} left_hand right_hand");
    let ours = [Forward, Left, Up];
    let facing = [Left, Down, Back];
    let media_pipe = Client::new(SkeletonLayout::MediaPipe33, MEDIA_PIPE, MEDIA_PIPE_NAMES, facing);
    let kinect = Client::new(SkeletonLayout::AzureKinect32, KINECT, KINECT_NAMES, facing);
    let xsens = Client::new(SkeletonLayout::XsensMvn23, XSENS, XSENS_NAMES, ours);
    vec![
        Client::new(SkeletonLayout::Smpl22, &smpl, &smpl, ours),
        Client::new(SkeletonLayout::Smpl24, &smpl24, &smpl, ours),
        Client::new(SkeletonLayout::XrBd24, &smpl24, &smpl, [Right, Up, Back]),
        Client { rotations: false, ..media_pipe },
        Client { units_per_m: 1000.0, w_first: true, confidence: 3.0, ..kinect },
        Client { w_first: true, ..xsens },
    ]
}

fn check(client: &Client, person: &Person, rest: Turn) {
    let sent = client.send(person, rest);
    let layouts = Layouts::default();
    let name = layouts.find(client.number).expect("built in").name().to_owned();
    let skeleton = accept(&layouts, &sent).unwrap_or_else(|reason| panic!("{name}: {reason:?}"));
    let truth = judge(&as_smpl(person, client.rotations)).expect("a person");
    assert_eq!(skeleton.flags & skeleton_flag::ALL, skeleton_flag::ALL, "{name}");
    assert_eq!(skeleton.flags & skeleton_flag::CALIBRATED != 0, client.rotations, "{name}");
    let off = limbs_differ(&skeleton, &truth);
    assert!(off < FLOAT_ERROR, "{name}: {off}, {:?} for {:?}", skeleton.limbs, truth.limbs);
    for smpl in (0..SMPL_JOINTS).filter(|&smpl| client.index(smpl).is_some()) {
        let place = person.places[smpl];
        for axis in 0..3 {
            let off = (f64::from(skeleton.positions[smpl][axis]) - place[axis]).abs();
            assert!(off < 1e-6, "{name}: {} is {off} m off", SMPL_NAMES[smpl]);
        }
    }
}

#[test]
fn every_layout_gives_same_limbs_as_smpl_22() {
    for client in clients() {
        for person in [t_pose(), bent()] {
            check(&client, &person, Turn::identity());
        }
    }
}

#[test]
fn joint_frames_turned_in_t_pose_give_same_limbs() {
    let rest = about([1.0, -2.0, 0.5], 2.0);
    for client in clients().iter().filter(|client| client.rotations) {
        check(client, &bent(), rest);
    }
}

/// Raw numbers, written by hand. Xsens has its right side first and w before x. Kinect has millimetres with y down.
#[test]
fn hand_written_wrist_converts_to_its_side() {
    let layouts = Layouts::default();
    let clients = clients();
    let mut xsens = clients[5].send(&t_pose(), Turn::identity());
    xsens.positions[14] = [0.25, 0.75, 1.5]; // LeftHand, id 15
    xsens.rotations[14] = [0.6, 0.8, 0.0, 0.0]; // about x, forward
    let out = layouts.convert(&xsens).expect("a frame");
    assert_eq!((out.positions[20], out.rotations[20]), ([0.25, 0.75, 1.5], [0.8, 0.0, 0.0, 0.6]));
    let mut kinect = clients[4].send(&t_pose(), Turn::identity());
    kinect.positions[7] = [500.0, -250.0, 2000.0]; // WRIST_LEFT: to the camera's right, above it, 2 m before it
    kinect.rotations[7] = [0.6, 0.0, 0.8, 0.0]; // about y, down
    let out = layouts.convert(&kinect).expect("a frame");
    assert_eq!((out.positions[20], out.rotations[20]), ([-2.0, 0.5, 0.25], [0.0, 0.0, -0.8, 0.6]));
    assert_eq!(out.confidence[20], 1.0);
    let mut quest = clients[2].send(&t_pose(), Turn::identity());
    quest.positions[21] = [0.5, 1.25, -0.25]; // right, up, forward
    quest.rotations[21] = [0.8, 0.0, 0.0, 0.6]; // about x, right
    let out = layouts.convert(&quest).expect("a frame");
    assert_eq!((out.positions[21], out.rotations[21]), ([0.25, -0.5, 1.25], [0.0, -0.8, 0.0, 0.6]));
}

#[test]
fn f010_mirrored_image_with_flag_is_turned_back() {
    let media_pipe = &clients()[3];
    // A camera's view in a mirror: x changes its sign, and each hand looks like the other.
    let mut person = bent();
    for place in &mut person.places {
        place.y = -place.y;
    }
    for (left, right) in [(1, 2), (4, 5), (7, 8), (10, 11), (13, 14), (16, 17), (18, 19), (20, 21)] {
        person.places.swap(left, right);
    }
    let mut seen = media_pipe.send(&person, Turn::identity());
    let layouts = Layouts::default();
    let truth = judge(&as_smpl(&bent(), false)).expect("a person");
    // Nothing in the image shows it: the client must set the flag.
    let accepted = accept(&layouts, &seen).expect("another person");
    assert!(limbs_differ(&accepted, &truth) > 0.1);
    seen.flags = raw_flag::MIRRORED;
    let accepted = accept(&layouts, &seen).expect("the person");
    assert!(limbs_differ(&accepted, &truth) < FLOAT_ERROR);
}

#[test]
fn joints_missing_in_layout_are_placed_by_documented_shares() {
    let media_pipe = &clients()[3];
    let mut sent = media_pipe.send(&t_pose(), Turn::identity());
    sent.positions[7] = [0.07, -1.62, 0.0]; // left ear: left, down, back
    sent.positions[8] = [-0.07, -1.62, 0.0];
    (sent.confidence[8], sent.confidence[24]) = (0.75, 0.625);
    let out = Layouts::default().convert(&sent).expect("a frame");
    let near = |joint: usize, place: [f64; 3]| {
        let off = (0..3).map(|axis| (f64::from(out.positions[joint][axis]) - place[axis]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "joint {joint} is {off} m off");
    };
    let back = -0.5 * skeleton::TORSO_LEAN_RAD.tan();
    // Hips at a height of 0.92 m, shoulders 0.5 m above them.
    for (joint, share) in [(0, 0.08), (3, 0.28), (6, 0.52), (9, 0.75), (12, 1.07)] {
        near(joint, [back * share, 0.0, 0.92 + 0.5 * share]);
        assert_eq!(out.confidence[joint], 0.625, "as well seen as the right hip");
    }
    near(13, [back, 0.28 * 0.18, 1.42]);
    near(14, [back, -0.28 * 0.18, 1.42]);
    near(15, [0.0, 0.0, 1.62]);
    assert_eq!((out.confidence[13], out.confidence[15]), (1.0, 0.75));
}
