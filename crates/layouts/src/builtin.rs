//! The layouts that need no file.

use crate::axes::{Axes, Direction};
use crate::lifter::POINTS;
use crate::map::{Map, NONE, Sends};
use Direction::{Back, Down, Forward, Left, Right, Up};
use messages::{RAW_JOINTS_MAX, SMPL_JOINTS, SkeletonLayout};

const X: u8 = NONE;

/// Order of the joints: pelvis, hips, spine 1; knees, spine 2; ankles, spine 3; feet, neck; collars, head;
/// shoulders; elbows; wrists. Left first.
type From = [u8; SMPL_JOINTS];

const SMPL: From = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21];
/// BlazePose: 11 to 16 are the arms, 23 to 28 the legs, 31 and 32 the tips of the feet. The head is between the
/// ears, 7 and 8.
const MEDIA_PIPE: From = [X, 23, 24, X, 25, 26, X, 27, 28, X, 31, 32, X, X, X, 7, 11, 12, 13, 14, 15, 16];
/// Landmarks of BlazePose that are points of an image, after the 33 of the world: nose, eyes, ears, then all from the
/// shoulders on.
const fn media_pipe_image() -> [u8; POINTS] {
    let mut image = [33, 35, 38, 40, 41, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let mut point = 5;
    while point < POINTS {
        image[point] = 33 + 6 + point as u8;
        point += 1;
    }
    image
}
/// k4abt_joint_id_t: 0 to 3 are the spine, 4 to 10 the left arm, 11 to 17 the right one, 18 to 21 and 22 to 25 the
/// legs, 26 the head.
const KINECT: From = [0, 18, 22, 1, 19, 23, X, 20, 24, 2, 21, 25, 3, 4, 11, 26, 5, 12, 6, 13, 7, 14];
/// MVN, segment id less one. 0 is the pelvis, 2 L3, 3 T12, 4 T8, 5 the neck, 6 the head. 7 to 10 are the right
/// arm, 11 to 14 the left one, 15 to 18 the right leg, 19 to 22 the left one. A segment's origin is the joint
/// nearer to the pelvis.
const XSENS: From = [0, 19, 15, 2, 20, 16, 3, 21, 17, 4, 22, 18, 5, 11, 7, 6, 12, 8, 13, 9, 14, 10];
/// HumanBodyBones: 0 is the hips, 1 to 6 the legs, 7 the spine, 8 the chest, 9 the neck, 10 the head, 11 to 18 the
/// arms, 19 and 20 the toes, 54 the upper chest.
const UNITY: From = [0, 1, 2, 7, 3, 4, 8, 5, 6, 54, 19, 20, 9, 11, 12, 10, 13, 14, 15, 16, 17, 18];

fn map(layout: SkeletonLayout, name: &str, joints: usize, axes: [Direction; 3], from: From) -> Map {
    let mut map = Map {
        number: layout as u32,
        name: name.to_owned(),
        joints,
        axes: Axes::from_directions(axes),
        unit_m: 1.0,
        w_first: false,
        sends: Sends::GlobalRotations,
        camera: false,
        confidence_max: 1.0,
        from: from.map(|joint| [joint, joint]),
        image: [NONE; POINTS],
        parent: [NONE; RAW_JOINTS_MAX],
        order: [0; RAW_JOINTS_MAX],
        ordered: 0,
    };
    map.hang_like_smpl();
    // The tree of SMPL-22 has no cycle.
    let _ = map.arrange();
    map
}

pub(crate) fn all() -> Vec<Map> {
    let ours = [Forward, Left, Up];
    // The person faces the camera: its right is the person's left.
    let facing = [Left, Down, Back];
    let smpl22 = map(SkeletonLayout::Smpl22, "smpl-22", 22, ours, SMPL);
    let smpl24 = map(SkeletonLayout::Smpl24, "smpl-24", 24, ours, SMPL);
    let xr_bd24 = map(SkeletonLayout::XrBd24, "xr-bd-24", 24, [Right, Up, Back], SMPL);
    let mut media_pipe = map(SkeletonLayout::MediaPipe33, "mediapipe-33", 33, facing, MEDIA_PIPE);
    media_pipe.from[15] = [7, 8];
    let media_pipe = Map { sends: Sends::Positions, camera: true, ..media_pipe };
    let number = SkeletonLayout::MediaPipe66 as u32;
    let with_image =
        Map { number, name: "mediapipe-66".into(), joints: 66, image: media_pipe_image(), ..media_pipe.clone() };
    let kinect = map(SkeletonLayout::AzureKinect32, "azure-kinect-32", 32, facing, KINECT);
    let xsens = map(SkeletonLayout::XsensMvn23, "xsens-mvn-23", 23, ours, XSENS);
    let unity = map(SkeletonLayout::UnityHumanoid, "unity-humanoid", 55, [Right, Up, Forward], UNITY);
    vec![
        Map { sends: Sends::Any, ..smpl22 },
        Map { sends: Sends::Any, ..smpl24 },
        xr_bd24,
        media_pipe,
        // K4ABT_JOINT_CONFIDENCE_NONE is 0, _HIGH is 3. Below _MEDIUM joints are guessed, and 1 of 3 is not used.
        Map { unit_m: 1e-3, w_first: true, camera: true, confidence_max: 3.0, ..kinect },
        Map { w_first: true, ..xsens },
        Map { sends: Sends::LocalRotations, ..unity },
        with_image,
    ]
}
