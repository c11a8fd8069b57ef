//! Mirror images: detects them and reflects them back.

use crate::Frame;
use skeleton::chirality;
use thiserror::Error;

/// Reason why left and right of a body are not reliable.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts describe the variants")]
pub enum MirrorError {
    /// The body is a mirror image.
    #[error(
        "the body is mirrored: its feet and knees point the wrong way for its left and right (front {front:.2}, sides \
         {sides:.2}); if the data are mirrored, give the option `mirror`"
    )]
    Mirrored {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
        /// Mean evidence of feet and knees, negative for a mirror image.
        front: f64,
    },
    /// Shoulders and hips disagree.
    #[error("shoulders and hips disagree on where left is (sides {sides:.2}): one pair's names are swapped")]
    Swapped {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
    },
    /// The reflected body is a mirror image.
    #[error("the option `mirror` is given, but the body is not mirrored (front {front:.2}); leave it out")]
    NotMirrored {
        /// Mean evidence of feet and knees in the file, positive for a person.
        front: f64,
    },
}

/// Checks left and right over all frames. Uses the lines of shoulders and hips, and the direction of feet and
/// knees. With `mirror`, it first reflects the frames at the plane between left and right. Then the joint named
/// left is on the left again.
pub(crate) fn settle(frames: &mut [Frame], mirror: bool) -> Result<(), MirrorError> {
    if mirror {
        frames.iter_mut().for_each(reflect);
    }
    let (mut sides, mut front, mut count) = (0.0, 0.0, 0.0);
    for evidence in frames.iter().filter_map(|frame| chirality(&frame.positions)) {
        sides += evidence.sides;
        front += evidence.front;
        count += 1.0;
    }
    let (sides, front) = if count > 0.0 { (sides / count, front / count) } else { (0.0, 0.0) };
    if sides < 0.0 {
        Err(MirrorError::Swapped { sides })
    } else if front < 0.0 && mirror {
        Err(MirrorError::NotMirrored { front: -front })
    } else if front < 0.0 {
        Err(MirrorError::Mirrored { sides, front })
    } else {
        Ok(())
    }
}

/// Reflects y -> -y. With the reflection M, a rotation R becomes M R M, x y z w -> -x y -z w.
fn reflect(frame: &mut Frame) {
    for [_, y, _] in &mut frame.positions {
        *y = -*y;
    }
    for [x, _, z, _] in &mut frame.rotations {
        (*x, *z) = (-*x, -*z);
    }
}
