//! Mirror images: detects them and reflects them back.

use crate::Frame;
use skeleton::{Chirality, chirality};
use thiserror::Error;

/// Reason why left and right of a body are not reliable.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the texts describe the variants")]
pub enum MirrorError {
    /// The body is a mirror image.
    #[error(
        "the body is mirrored: its feet and knees point the wrong way for its left and right (front {front:.2}, sides \
         {sides:.2}); if the data are mirrored, give --mirror"
    )]
    Mirrored {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
        /// Mean evidence of feet and knees, negative for a mirror image.
        front: f64,
    },
    /// Shoulders and hips disagree.
    #[error(
        "shoulders and hips disagree on where left is (sides {sides:.2}): one pair is swapped; correct the array, or name a BVH's \
         joints in a file for --map"
    )]
    Swapped {
        /// Mean cosine between the lines of shoulders and hips.
        sides: f64,
    },
    /// The reflected body is a mirror image.
    #[error("--mirror is given, but the body is not mirrored (front {front:.2}); leave it out")]
    NotMirrored {
        /// Mean evidence of feet and knees in the file, positive for a person.
        front: f64,
    },
}

/// Checks left and right over all frames, by the same rule as `ingest`. With `mirror`, it first reflects the frames at the
/// plane between left and right. Then the joint named left is on the left again. Legs that prove nothing are no reason.
pub(crate) fn settle(frames: &mut [Frame], mirror: bool) -> Result<(), MirrorError> {
    if mirror {
        frames.iter_mut().for_each(reflect);
    }
    let mut mean = Chirality::default();
    for (n, evidence) in frames.iter().filter_map(|frame| chirality(&frame.positions)).enumerate() {
        mean = mean.toward(evidence, 1.0 / (n + 1) as f64);
    }
    let Chirality { sides, front, .. } = mean;
    if mean.is_swapped() {
        Err(MirrorError::Swapped { sides })
    } else if mean.is_mirrored() && mirror {
        Err(MirrorError::NotMirrored { front: -front })
    } else if mean.is_mirrored() {
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
