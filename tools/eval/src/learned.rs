//! The learned baselines: the paper's recipe and its ablations, ours without a term, and S3LE.

use crate::clips::Human;
use crate::error::EvalError;
use retarget::{ArmIdentity, ArmQ};
use std::path::Path;

/// Their names in the table; the files are named alike, with dashes.
pub const NAMES: [&str; 9] = [
    "paper",
    "paper_no_ltc",
    "paper_no_triplet",
    "ours_pose",
    "ours_no_triplet",
    "ours_no_ltc",
    "ours_no_rec",
    "ours_same_steps",
    "s3le",
];

/// One baseline, ready to run.
#[derive(Debug)]
pub enum Learned {}

impl Learned {
    /// Reads `folder`/`name` (dashes for underscores) for the robot `identity`; none if it was never trained.
    ///
    /// # Errors
    /// If the files are there and are refused.
    pub fn read(_folder: &Path, _name: &str, _identity: &ArmIdentity) -> Result<Option<Self>, EvalError> {
        Ok(None)
    }

    /// Postures of both arms for each human pose, rad.
    #[must_use]
    pub fn retarget(&self, _humans: &[Human]) -> Vec<[ArmQ; 2]> {
        match *self {}
    }
}
