//! Left and right of a person's body, in any pose.

use crate::geometry::{unit, vector};
use crate::limbs::torso_rotation;
use messages::{SMPL_JOINTS, Smpl};

/// Evidence of the body about left and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirality {
    /// Cosine of the angle between the lines of shoulders and hips (right to left). Negative if one pair is
    /// swapped.
    pub sides: f64,
    /// Sum of how far the feet point and the knees bend forward. Positive for a person, negative for a mirror
    /// image.
    pub front: f64,
}

/// Returns the evidence for or against a mirror image in one frame of SMPL-22 positions, m, z up. A single frame
/// may mislead, because feet turn and knees twist. Sum `front` over frames. `None` if the trunk has no shape.
pub fn chirality(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<Chirality> {
    let at = |joint: Smpl| vector(positions[joint as usize]);
    let along = |from: Smpl, to: Smpl| unit(at(to) - at(from)).unwrap_or_default();
    let torso = torso_rotation(positions)?;
    let hips = unit(at(Smpl::LeftHip) - at(Smpl::RightHip))?;
    let sides = hips.dot(&torso.column(1));
    // Front by the line of the hips, because the legs are attached there.
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
