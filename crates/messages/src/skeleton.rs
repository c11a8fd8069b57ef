//! Messages of the human side: the frames that clients publish, and the skeleton that `ingest` makes of them.

use crate::layout::message;
use crate::time::{Header, Stamp};

/// The most joints that a client's frame can carry.
pub const RAW_JOINTS_MAX: usize = 96;
/// Joints of the canonical SMPL-22 layout.
pub const SMPL_JOINTS: usize = 22;
/// The four limbs that are retargeted.
pub const LIMBS: usize = 4;

/// Index of a limb in every array of limbs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Limb {
    /// Left shoulder to left elbow.
    LeftUpper = 0,
    /// Left elbow to left wrist.
    LeftFore = 1,
    /// Right shoulder to right elbow.
    RightUpper = 2,
    /// Right elbow to right wrist.
    RightFore = 3,
}

crate::named! {
    /// Joints of the SMPL-22 layout, by index. Messages and layout files use the names.
    #[allow(missing_docs)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum Smpl {
        Pelvis = 0 => "pelvis",
        LeftHip = 1 => "left_hip",
        RightHip = 2 => "right_hip",
        Spine1 = 3 => "spine1",
        LeftKnee = 4 => "left_knee",
        RightKnee = 5 => "right_knee",
        Spine2 = 6 => "spine2",
        LeftAnkle = 7 => "left_ankle",
        RightAnkle = 8 => "right_ankle",
        Spine3 = 9 => "spine3",
        LeftFoot = 10 => "left_foot",
        RightFoot = 11 => "right_foot",
        Neck = 12 => "neck",
        LeftCollar = 13 => "left_collar",
        RightCollar = 14 => "right_collar",
        Head = 15 => "head",
        LeftShoulder = 16 => "left_shoulder",
        RightShoulder = 17 => "right_shoulder",
        LeftElbow = 18 => "left_elbow",
        RightElbow = 19 => "right_elbow",
        LeftWrist = 20 => "left_wrist",
        RightWrist = 21 => "right_wrist",
    }
}

/// Names of the joints, by index.
pub const SMPL_NAMES: [&str; SMPL_JOINTS] = Smpl::NAMES;

/// Parent of each joint of SMPL-22. The pelvis is its own parent. Parents come before their children.
pub const SMPL_PARENT: [usize; SMPL_JOINTS] = [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19];

/// The joint of the other side, for each joint of SMPL-22. A joint of the middle is its own.
pub const SMPL_OTHER_SIDE: [usize; SMPL_JOINTS] =
    [0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20];

/// The layouts of `RawSkeleton` that `ingest` understands. The numbers are part of the contract with clients: a
/// number never changes its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum SkeletonLayout {
    /// SMPL-22 in metres, x forward, y left, z up. Quaternions are x y z w. Sends positions, global rotations or
    /// local rotations.
    Smpl22 = 1,
    /// SMPL-24: SMPL-22 and both hands, in the same frame.
    Smpl24 = 2,
    /// The 24 joints of OpenXR's XR_BD_body_tracking: metres, x right, y up, z back. Quaternions are x y z w.
    XrBd24 = 3,
    /// The 33 world landmarks of MediaPipe Pose: metres, x to the right of the image, y down, z away from the camera.
    MediaPipe33 = 4,
    /// The 32 joints of Azure Kinect body tracking: millimetres, x right, y down, z away from the camera.
    /// Quaternions are w x y z.
    AzureKinect32 = 5,
    /// The 23 segments of Xsens MVN, the first one at index 0: metres, x forward, y left, z up. Quaternions are w
    /// x y z.
    XsensMvn23 = 6,
    /// The 55 bones of Unity's `HumanBodyBones`, as VMC sends them: left-handed, x right, y up, z forward. Local
    /// rotations are x y z w, identity in the T-pose.
    UnityHumanoid = 7,
    /// The 33 world landmarks of MediaPipe Pose as in `MediaPipe33`, then its 33 image landmarks: x to the right and y down
    /// from the middle of the image, in heights of the image. z is unused.
    MediaPipe66 = 8,
}

/// The numbers that layouts from files may have.
pub const CUSTOM_LAYOUTS: core::ops::RangeInclusive<u32> = 1000..=9999;

/// Bits of `RawSkeleton::flags`.
pub mod raw_flag {
    /// The image was mirrored: left and right are swapped.
    pub const MIRRORED: u32 = 1;
    /// `rotations` are filled.
    pub const ROTATIONS: u32 = 2;
    /// The rotations are relative to the parent joint, and only the root's position is used. Valid only with
    /// `ROTATIONS`.
    pub const LOCAL: u32 = 4;
    /// The person holds the clutch: the robot stands until a frame without it.
    pub const CLUTCH: u32 = 8;
    /// The bytes of [`with_closure`](super::with_closure): bits 16 to 23 and bits 24 to 31.
    pub const CLOSURE: u32 = 0xffff_0000;
}

/// Position of the left and of the right hand's byte in `RawSkeleton::flags`.
const CLOSURE_SHIFT: [u32; 2] = [16, 24];
/// Largest byte minus one: the byte of a closed hand is 255, that of an open one 1.
const CLOSURE_STEPS: f32 = 254.0;

/// Returns `flags` with the closure of the left and of the right hand, from 0 (open) to 1 (closed). `None` and NaN stand
/// for a hand that is not known: its byte is zero. The resolution is 1 / 254.
///
/// ```
/// use messages::{closure_of, with_closure};
///
/// let flags = with_closure(messages::raw_flag::ROTATIONS, [Some(1.0), None]);
/// assert_eq!(closure_of(flags), [Some(1.0), None]);
/// ```
pub fn with_closure(flags: u32, closure: [Option<f32>; 2]) -> u32 {
    let byte = |closure: f32| 1 + (closure.clamp(0.0, 1.0) * CLOSURE_STEPS + 0.5) as u32;
    let hands = closure.into_iter().zip(CLOSURE_SHIFT);
    let known = hands.filter_map(|(closure, shift)| Some(byte(closure.filter(|closure| !closure.is_nan())?) << shift));
    known.fold(flags & !raw_flag::CLOSURE, |flags, bits| flags | bits)
}

/// Returns what [`with_closure`] wrote.
pub fn closure_of(flags: u32) -> [Option<f32>; 2] {
    CLOSURE_SHIFT.map(|shift| (flags >> shift & 0xff).checked_sub(1).map(|step| step as f32 / CLOSURE_STEPS))
}

/// Bits of `HingeCalibration::flags`.
pub mod calibration_flag {
    /// Bits 0 to 3: the hinge of limb i is valid.
    pub const LIMB: [u32; super::LIMBS] = [1, 2, 4, 8];
    /// All four hinges are valid.
    pub const ALL: u32 = 15;
}

/// Bits of `Skeleton::flags`.
pub mod skeleton_flag {
    /// Bits 0 to 3: limb i is valid.
    pub const LIMB: [u32; super::LIMBS] = [1, 2, 4, 8];
    /// All four limbs are valid.
    pub const ALL: u32 = 15;
    /// The limb frames rest on a calibration, else on the elbow's momentary plane. The bits above are
    /// `PersonChange::FLAGS`.
    pub const CALIBRATED: u32 = 16;
    /// The left and the right hand are valid.
    pub const HAND: [u32; 2] = [256, 512];
    /// The head is valid.
    pub const HEAD: u32 = 1024;
    /// `raw_flag::CLUTCH`.
    pub const CLUTCH: u32 = 2048;
    /// The person is the mirror image of the one who was seen (`ingest.mirror`).
    pub const IMAGE: u32 = 4096;
    /// The closure of the left and the right hand is known.
    pub const CLOSURE: [u32; 2] = [8192, 16384];
    /// One camera sees the person, and the images have no depth.
    pub const ONE_CAMERA: u32 = 32768;
}

message! {
    /// Elbow hinge axes of one operator, unit vectors in the local frames of the joints that carry them.
    pub struct HingeCalibration v 1 size 56 {
        /// Flexion axis of the elbow, for each limb, in the frame of the joint that twists with the limb. For
        /// upper arms it is the shoulder joint's rotation. For forearms it is the wrist joint's, because the hand
        /// carries the forearm's twist.
        pub hinge: [[f32; 3]; LIMBS],
        /// Bits of `calibration_flag`.
        pub flags: u32,
        /// Frames that the estimate rests on.
        pub samples: u32,
    }
}

message! {
    /// A client's frame of a person, in any supported layout.
    pub struct RawSkeleton v 1 size 3576 {
        /// `origin` is the time of capture.
        pub header: Header,
        /// Random number that the client draws at its start. A replayed recording of the bus therefore is no new
        /// session.
        pub session_nonce: u64,
        /// A `SkeletonLayout`.
        pub layout: u32,
        /// Number of the person, as the client counts them.
        pub operator_id: u32,
        /// Bits of `raw_flag`.
        pub flags: u32,
        /// Number of joints that are filled.
        pub joint_count: u32,
        /// Global positions, in the layout's unit and axes (SMPL-22: m).
        pub positions: [[f32; 3]; RAW_JOINTS_MAX],
        /// Global rotations, or local ones with `raw_flag::LOCAL`, in the layout's order of components (SMPL-22: x
        /// y z w).
        pub rotations: [[f32; 4]; RAW_JOINTS_MAX],
        /// Confidence, from 0 to the layout's highest value (SMPL-22: 1).
        pub confidence: [f32; RAW_JOINTS_MAX],
        /// Zero. Reserved for per-joint validity bits.
        pub joint_flags: [u32; RAW_JOINTS_MAX],
        /// Hinge axes, if the client has them: in the frames of its joints and along the axes of its layout.
        pub calibration: HingeCalibration,
    }
}

message! {
    /// A validated person: SMPL-22 positions, the four calibrated limb rotations, hands and head.
    pub struct Skeleton v 3 size 448 {
        /// `origin` of the client, on the clock of this machine.
        pub header: Header,
        /// Time at which `ingest` received the frame.
        pub received: Stamp,
        /// The session as the client sent it.
        pub session_nonce: u64,
        /// Number of the person. It is the client's, changed by `ingest` whenever the person may be another one
        /// than before.
        pub operator_id: u32,
        /// Bits of `skeleton_flag`.
        pub flags: u32,
        /// Limb rotations relative to the chest, as differences from the T-pose, x y z w. Indexed by `Limb`.
        pub limbs: [[f32; 4]; LIMBS],
        /// SMPL-22 positions, m, in the client's world frame (z up).
        pub positions: [[f32; 3]; SMPL_JOINTS],
        /// Rotations of the left and the right hand, as those of the limbs. A hand that continues its forearm has the
        /// forearm's.
        pub hands: [[f32; 4]; 2],
        /// Rotation of the head relative to the chest, as the difference from its mean so far, x y z w.
        pub head: [f32; 4],
        /// Closure of the left and the right hand, from 0 (open) to 1 (closed).
        pub closure: [f32; 2],
    }
}
