//! What a person's body looks like, whatever the pose: sides, sizes and speeds.

use crate::geometry::{unit, vector};
use crate::limbs::torso_rotation;
use messages::{SMPL_JOINTS, Smpl};

/// What the body says about left and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirality {
    /// Cosine of the angle between the lines of shoulders and hips (right to left); negative if one pair is swapped.
    pub sides: f64,
    /// How far the feet point and the knees bend the right way: positive for a person, negative for a mirror image.
    pub front: f64,
}

/// Evidence for or against a mirror image in one frame of SMPL-22 positions, m, z up. A single frame may mislead (feet
/// turn, knees twist): sum `front` over frames. `None` if the trunk has no shape.
pub fn chirality(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<Chirality> {
    let at = |joint: Smpl| vector(positions[joint as usize]);
    let along = |from: Smpl, to: Smpl| unit(at(to) - at(from)).unwrap_or_default();
    let torso = torso_rotation(positions)?;
    let hips = unit(at(Smpl::LeftHip) - at(Smpl::RightHip))?;
    let sides = hips.dot(&torso.column(1));
    // Front by the hips' line, because the legs hang from it.
    let front = unit(hips.cross(&torso.column(2).into_owned()))?;
    let mut evidence = 0.0;
    for (hip, knee, ankle, foot) in [
        (Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle, Smpl::LeftFoot),
        (Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle, Smpl::RightFoot),
    ] {
        let (thigh, shin) = (along(hip, knee), along(knee, ankle));
        evidence += along(ankle, foot).dot(&front);
        evidence += thigh.cross(&shin).dot(&hips);
    }
    Some(Chirality { sides, front: evidence })
}
