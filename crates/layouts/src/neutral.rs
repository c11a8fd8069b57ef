//! Neutral skeleton for local rotations: a T-pose whose lengths are nominal.

use messages::SMPL_JOINTS;

/// Distance of the shoulders behind the hips in a T-pose, m. The trunk of 0.504 m leans back by 0.1 rad, which the
/// chest frame of `skeleton` counts as upright (`skeleton::TORSO_LEAN_RAD`).
const BEHIND_M: f64 = 0.050_568_674_731;

/// Vector from the parent to each joint in the T-pose: x, y and z of all joints, m. Trunk 0.288, upper arm 0.186, forearm 0.146, thigh
/// 0.245, shank 0.246 and height of the ankle 0.039 of a stature of 1.75 m (Winter, Biomechanics, 4th ed., fig.
/// 4.1). Assumptions: the division of the spine, the breadths of 0.18 m (hips) and 0.36 m (shoulders), and the
/// feet.
pub(crate) const OFFSET_M: [[f64; SMPL_JOINTS]; 3] = [
    [
        0.0, 0.0, 0.0, -0.010, 0.0, 0.0, -0.012, 0.0, 0.0, -0.012, 0.14, 0.14, NECK_M, NECK_M, NECK_M, 0.02, 0.0, 0.0,
        0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.0, 0.09, -0.09, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05, -0.05, 0.0, 0.13, -0.13, 0.3255,
        -0.3255, 0.2555, -0.2555,
    ],
    [
        0.0, -0.04, -0.04, 0.10, -0.429, -0.429, 0.12, -0.4305, -0.4305, 0.12, -0.05, -0.05, 0.16, 0.124, 0.124, 0.12,
        0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    ],
];
/// x of the neck and the collars in it.
const NECK_M: f64 = 0.034 - BEHIND_M;

/// Positions of joints that a layout does not send, as a share of the way from the middle of the hips to that of
/// the shoulders: pelvis, three of the spine, neck. They are those of the neutral skeleton. No motion of a robot
/// depends on them.
pub(crate) const UP_THE_TRUNK: [(usize, f64); 5] = [(0, 0.08), (3, 0.28), (6, 0.52), (9, 0.75), (12, 1.07)];

/// Position of a collar, as a share of the way from the middle of the shoulders to the shoulder. It is that of the
/// neutral skeleton.
pub(crate) const COLLAR: f64 = 0.28;

/// Breadth of the hips over that of the shoulders, for a layout without hips: 0.191 over 0.259 of the stature
/// (Winter, fig. 4.1). The hips then lie beside the pelvis, along the line of the shoulders.
pub(crate) const HIPS_PER_SHOULDERS: f64 = 0.74;
