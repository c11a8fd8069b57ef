//! The learned baselines: the paper's recipe and its ablations, ours without a term, and S3LE.

use crate::clips::Human;
use crate::error::EvalError;
use retarget::{ArmIdentity, ArmQ};
use std::path::Path;
use train::baseline::Baseline;

/// Names in the table. The files have the same names, with dashes.
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
pub struct Learned(Baseline);

impl Learned {
    /// Reads `folder`/`name` (dashes for underscores) for the robot `identity`. None if it was never trained.
    ///
    /// # Errors
    /// Returns an error if the files exist but are invalid.
    pub fn read(folder: &Path, name: &str, identity: &ArmIdentity) -> Result<Option<Self>, EvalError> {
        let base = folder.join(name.replace('_', "-"));
        if !base.with_extension("toml").exists() {
            return Ok(None);
        }
        Ok(Some(Self(Baseline::read(&base, identity)?)))
    }

    /// Returns a description of the training data, and the number of steps.
    #[must_use]
    pub fn trained_on(&self) -> String {
        format!("{} steps on {}", self.0.manifest.steps, self.0.manifest.trained_on)
    }

    /// Returns the postures of both arms for a human pose, rad.
    #[must_use]
    pub fn retarget(&self, human: &Human) -> [ArmQ; 2] {
        self.0.retarget(human)
    }
}
