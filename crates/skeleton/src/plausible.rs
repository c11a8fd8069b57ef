//! Left and right of a person's body, in any pose.

use crate::geometry::{unit, vector};
use crate::limbs::torso_rotation;
use messages::{SMPL_JOINTS, Smpl};

/// Least flexion of a knee that shows on which side its hinge is, rad: 15 degrees. Straight knees bend either way by a few
/// degrees in estimates.
const FLEXED_RAD: f64 = 0.26;
/// Cosine of the largest lean at the start: 60 degrees.
const LEAN_COSINE: f64 = 0.5;
/// Share of the evidence that must speak against a person, of at least [`WEIGHT_MIN`]. A true mirror image has 0.8 to 1, and
/// no clip of CMU has a half over a second.
const AGAINST: f64 = 0.5;
/// Least evidence that counts as a whole: two feet that point straight.
const WEIGHT_MIN: f64 = 2.0;

/// Smallest mean cosine between shoulders and hips. CMU clips: above 0. Swapped sides: -0.9.
const SIDES_MIN: f64 = -0.3;

/// Evidence of the body about left and right, in one frame or as a mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chirality {
    /// Cosine of the angle between the lines of shoulders and hips (right to left). Negative if one pair is swapped.
    pub sides: f64,
    /// Sum over both legs of how far the foot points ahead of its shin, and the flexed knee bends to the back. Positive for a
    /// person, negative for a mirror image.
    pub front: f64,
    /// The largest |front| that these legs could give, from 0 to 4. Small for straight legs without feet, and for legs that lie
    /// across.
    pub weight: f64,
}

impl Chirality {
    /// Adds `share` of the way to another one.
    #[must_use]
    pub fn toward(self, other: Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        Self {
            sides: mix(self.sides, other.sides),
            front: mix(self.front, other.front),
            weight: mix(self.weight, other.weight),
        }
    }

    /// Returns true if shoulders and hips disagree on where left is: sides < -0.3.
    pub fn is_swapped(&self) -> bool {
        self.sides < SIDES_MIN
    }

    /// Returns true if the legs prove a mirror image: front < -0.5 max(weight, 2).
    pub fn is_mirrored(&self) -> bool {
        self.front < -AGAINST * self.weight.max(WEIGHT_MIN)
    }
}

/// Returns true if the trunk or, where they are seen, the legs of a person lean by less than 60 degrees. Nobody begins with a
/// larger lean of both, and every wrong up-axis gives 90 or 180. `None` if the trunk has no shape.
pub fn stands(positions: &[[f32; 3]; SMPL_JOINTS], sees_legs: bool) -> Option<bool> {
    let at = |joint: Smpl| vector(positions[joint as usize]);
    let trunk = torso_rotation(positions)?[(2, 2)];
    let middle = |a: Smpl, b: Smpl| (at(a) + at(b)) / 2.0;
    let legs = unit(middle(Smpl::LeftHip, Smpl::RightHip) - middle(Smpl::LeftAnkle, Smpl::RightAnkle));
    Some(trunk >= LEAN_COSINE || sees_legs && legs.is_some_and(|legs| legs.z >= LEAN_COSINE))
}

/// Returns the evidence for or against a mirror image in one frame of SMPL-22 positions, m, z up. A single frame
/// may mislead, because feet turn and knees twist. Take the mean over frames. `None` if the trunk has no shape.
///
/// With the line of the hips h, right to left, and the unit vectors of thigh t, shin s and foot f of each leg:
///
/// ```text
/// front = sum f . (s x h) + (t x s) . h,   the second part from 15 degrees of flexion on
/// ```
///
/// Shins that lie on the floor have their front below, so a person who sits on the heels is no mirror image.
pub fn chirality(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<Chirality> {
    let at = |joint: Smpl| vector(positions[joint as usize]);
    // Zeros stand for a joint that is not seen.
    let seen = |joint: Smpl| positions[joint as usize] != [0.0; 3];
    let along = |from: Smpl, to: Smpl| unit(at(to) - at(from)).filter(|_| seen(from) && seen(to)).unwrap_or_default();
    let torso = torso_rotation(positions)?;
    let hips = unit(at(Smpl::LeftHip) - at(Smpl::RightHip))?;
    let mut all = Chirality { sides: hips.dot(&torso.column(1)), ..Chirality::default() };
    for (hip, knee, ankle, foot) in [
        (Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle, Smpl::LeftFoot),
        (Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle, Smpl::RightFoot),
    ] {
        let (thigh, shin, foot) = (along(hip, knee), along(knee, ankle), along(ankle, foot));
        let (ahead, hinge) = (shin.cross(&hips), thigh.cross(&shin));
        (all.front, all.weight) = (all.front + foot.dot(&ahead), all.weight + foot.norm() * ahead.norm());
        if hinge.norm().atan2(thigh.dot(&shin)) > FLEXED_RAD {
            (all.front, all.weight) = (all.front + hinge.dot(&hips), all.weight + hinge.norm());
        }
    }
    Some(all)
}
