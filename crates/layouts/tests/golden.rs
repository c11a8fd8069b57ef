//! One person in every built-in layout: the limbs equal those of the same person sent as SMPL-22.

use crate::client::{self, Client, Person, Turn, about, as_smpl, bent, judge, limbs_differ, t_pose, take};
use Direction::{Back, Down, Forward, Left, Right, Up};
use layouts::{Direction, Layouts};
use messages::{SMPL_JOINTS, SkeletonLayout, raw_flag, skeleton_flag};

/// Error bound: positions of 2 m in single precision over bones of 0.26 m, with a few roundings each.
pub(crate) const FLOAT_ERROR: f32 = 2e-5;

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

fn client(
    layout: SkeletonLayout,
    joints: &str,
    names: &[(&'static str, &'static str)],
    directions: [Direction; 3],
) -> Client {
    Client {
        number: layout as u32,
        joints: words(joints),
        names: names.to_vec(),
        axes: client::axes(directions),
        units_per_m: 1.0,
        w_first: false,
        rotations: true,
        confidence: 1.0,
    }
}

const MEDIA_PIPE: &str = "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear mouth_left \
    mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky right_pinky left_index \
    right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle right_ankle left_heel right_heel \
    left_foot_index right_foot_index";
const MEDIA_PIPE_NAMES: [(&str, &str); 14] = [
    ("left_shoulder", "left_shoulder"),
    ("right_shoulder", "right_shoulder"),
    ("left_elbow", "left_elbow"),
    ("right_elbow", "right_elbow"),
    ("left_wrist", "left_wrist"),
    ("right_wrist", "right_wrist"),
    ("left_hip", "left_hip"),
    ("right_hip", "right_hip"),
    ("left_knee", "left_knee"),
    ("right_knee", "right_knee"),
    ("left_ankle", "left_ankle"),
    ("right_ankle", "right_ankle"),
    ("left_foot", "left_foot_index"),
    ("right_foot", "right_foot_index"),
];

const KINECT: &str = "PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT HAND_LEFT HANDTIP_LEFT \
    THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT HIP_LEFT KNEE_LEFT \
    ANKLE_LEFT FOOT_LEFT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT";
const KINECT_NAMES: [(&str, &str); 21] = [
    ("pelvis", "PELVIS"),
    ("spine1", "SPINE_NAVEL"),
    ("spine3", "SPINE_CHEST"),
    ("neck", "NECK"),
    ("head", "HEAD"),
    ("left_collar", "CLAVICLE_LEFT"),
    ("right_collar", "CLAVICLE_RIGHT"),
    ("left_shoulder", "SHOULDER_LEFT"),
    ("right_shoulder", "SHOULDER_RIGHT"),
    ("left_elbow", "ELBOW_LEFT"),
    ("right_elbow", "ELBOW_RIGHT"),
    ("left_wrist", "WRIST_LEFT"),
    ("right_wrist", "WRIST_RIGHT"),
    ("left_hip", "HIP_LEFT"),
    ("right_hip", "HIP_RIGHT"),
    ("left_knee", "KNEE_LEFT"),
    ("right_knee", "KNEE_RIGHT"),
    ("left_ankle", "ANKLE_LEFT"),
    ("right_ankle", "ANKLE_RIGHT"),
    ("left_foot", "FOOT_LEFT"),
    ("right_foot", "FOOT_RIGHT"),
];

const XSENS: &str = "Pelvis L5 L3 T12 T8 Neck Head RightShoulder RightUpperArm RightForeArm RightHand LeftShoulder LeftUpperArm \
    LeftForeArm LeftHand RightUpperLeg RightLowerLeg RightFoot RightToe LeftUpperLeg LeftLowerLeg LeftFoot LeftToe";
const XSENS_NAMES: [(&str, &str); 22] = [
    ("pelvis", "Pelvis"),
    ("spine1", "L3"),
    ("spine2", "T12"),
    ("spine3", "T8"),
    ("neck", "Neck"),
    ("head", "Head"),
    ("left_collar", "LeftShoulder"),
    ("right_collar", "RightShoulder"),
    ("left_shoulder", "LeftUpperArm"),
    ("right_shoulder", "RightUpperArm"),
    ("left_elbow", "LeftForeArm"),
    ("right_elbow", "RightForeArm"),
    ("left_wrist", "LeftHand"),
    ("right_wrist", "RightHand"),
    ("left_hip", "LeftUpperLeg"),
    ("right_hip", "RightUpperLeg"),
    ("left_knee", "LeftLowerLeg"),
    ("right_knee", "RightLowerLeg"),
    ("left_ankle", "LeftFoot"),
    ("right_ankle", "RightFoot"),
    ("left_foot", "LeftToe"),
    ("right_foot", "RightToe"),
];

/// Clients of all layouts that send positions, and rotations if the layout has any.
pub(crate) fn clients() -> Vec<Client> {
    let same = client::SMPL.map(|name| (name, name));
    let smpl24 = format!("{} left_hand right_hand", client::SMPL.join(" "));
    let ours = [Forward, Left, Up];
    let facing = [Left, Down, Back];
    let media_pipe = client(SkeletonLayout::MediaPipe33, MEDIA_PIPE, &MEDIA_PIPE_NAMES, facing);
    let kinect = client(SkeletonLayout::AzureKinect32, KINECT, &KINECT_NAMES, facing);
    let xsens = client(SkeletonLayout::XsensMvn23, XSENS, &XSENS_NAMES, ours);
    vec![
        client(SkeletonLayout::Smpl22, &client::SMPL.join(" "), &same, ours),
        client(SkeletonLayout::Smpl24, &smpl24, &same, ours),
        client(SkeletonLayout::XrBd24, &smpl24, &same, [Right, Up, Back]),
        Client { rotations: false, ..media_pipe },
        Client { units_per_m: 1000.0, w_first: true, confidence: 3.0, ..kinect },
        Client { w_first: true, ..xsens },
    ]
}

fn check(client: &Client, person: &Person, rest: Turn) {
    let sent = client.send(person, rest);
    let layouts = Layouts::default();
    let name = layouts.find(client.number).expect("built in").name().to_owned();
    let skeleton = take(&layouts, &sent).unwrap_or_else(|reason| panic!("{name}: {reason:?}"));
    let truth = judge(&as_smpl(person, client.rotations)).expect("a person");
    assert_eq!(skeleton.flags & skeleton_flag::ALL, skeleton_flag::ALL, "{name}");
    assert_eq!(skeleton.flags & skeleton_flag::CALIBRATED != 0, client.rotations, "{name}");
    let off = limbs_differ(&skeleton, &truth);
    assert!(off < FLOAT_ERROR, "{name}: {off}, {:?} for {:?}", skeleton.limbs, truth.limbs);
    for smpl in (0..SMPL_JOINTS).filter(|&smpl| client.index(smpl).is_some()) {
        let place = person.places[smpl];
        for axis in 0..3 {
            let off = (f64::from(skeleton.positions[smpl][axis]) - place[axis]).abs();
            assert!(off < 1e-6, "{name}: {} is {off} m off", client::SMPL[smpl]);
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

/// Raw numbers, written by hand. Xsens has its right side first and w before x. Kinect has millimetres with y
/// down.
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
    let taken = take(&layouts, &seen).expect("another person");
    assert!(limbs_differ(&taken, &truth) > 0.1);
    seen.flags = raw_flag::MIRRORED;
    let taken = take(&layouts, &seen).expect("the person");
    assert!(limbs_differ(&taken, &truth) < FLOAT_ERROR);
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
