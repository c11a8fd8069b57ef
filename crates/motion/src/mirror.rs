//! Mirror images: how they are told from persons, and how they are turned back.

use crate::Frame;
use skeleton::chirality;
use thiserror::Error;

/// Why left and right of a body cannot be trusted.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum MirrorError {
    /// Feet and knees point backwards if left is left.
    #[error(
        "the body is a mirror image: its feet and knees point the wrong way for its left and right (front {front:.2}, \
         sides {sides:.2}); if the data are mirrored, read them with the option `mirror`"
    )]
    Mirrored {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
        /// Mean evidence of feet and knees, negative for a mirror image.
        front: f64,
    },
    /// Shoulders and hips disagree, so that one pair has its names swapped.
    #[error("shoulders and hips disagree on where left is (sides {sides:.2}): one pair's names are swapped")]
    Swapped {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
    },
    /// The option `mirror` was given for a body that is none.
    #[error("the option `mirror` is given, but the body is no mirror image (front {front:.2}): leave it out")]
    NotMirrored {
        /// Mean evidence of feet and knees in the file, positive for a person.
        front: f64,
    },
}

/// Checks left and right over all frames, by the lines of shoulders and hips and by which way feet and knees point; with
/// `mirror`, reflects the frames at the plane between left and right first, so that the joint that is named left is on
/// the left again.
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

/// y -> -y: a reflection M, so that a rotation R becomes M R M, x y z w -> -x y -z w.
fn reflect(frame: &mut Frame) {
    for [_, y, _] in &mut frame.positions {
        *y = -*y;
    }
    for [x, _, z, _] in &mut frame.rotations {
        (*x, *z) = (-*x, -*z);
    }
}
