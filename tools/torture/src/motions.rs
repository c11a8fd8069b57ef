//! Plays recorded motions through every stage, from the first frame to rest, in virtual time.

use crate::error::TortureError;
use crate::parallel::in_parallel;
use client::PlayOptions;
use config::Loaded;
use messages::{Mode, TICK_HZ};
use motion::CalibrationMode;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use world::{Offline, OfflineEnd};

/// Result of a file.
#[derive(Clone, Debug, Default)]
pub struct Played {
    /// The file.
    pub file: PathBuf,
    /// Virtual time from the enable to rest, s.
    pub duration_s: f64,
    /// Violations by kind, as the simulated robot counted them.
    pub violations: BTreeMap<String, u64>,
    /// Least clearance of all executed commands, mm.
    pub min_clearance_mm: f64,
    /// Largest torque of all executed commands over its effort limit.
    pub torque_share_max: f64,
    /// Motions that were not certified, per tick.
    pub fallbacks_per_tick: f64,
    /// Mean limb error of the robot while engaged, deg.
    pub limb_error_robot_deg: f64,
    /// Mean limb error of the target while engaged, deg.
    pub limb_error_deg: f64,
    /// Times the robot stopped following before the end.
    pub holds: u64,
    /// The reason if the run did not end at rest after the last frame.
    pub failed: Option<String>,
}

impl Played {
    /// Returns the number of violations of all kinds.
    pub fn violations_total(&self) -> u64 {
        self.violations.values().sum()
    }
}

/// Plays the motion files of `folder` and returns the result of each. Calls `progress` after every file.
///
/// # Errors
/// Returns an error if the folder cannot be listed or holds no motion.
pub fn run(
    loaded: &Loaded,
    folder: &Path,
    threads: usize,
    progress: impl Fn(&Played) + Sync,
) -> Result<Vec<Played>, TortureError> {
    let files = motion::motion_files(folder)?;
    if files.is_empty() {
        return Err(TortureError::NoMotions(folder.to_path_buf()));
    }
    Ok(in_parallel(threads, files.len(), |i| {
        let played = play(loaded, &files[i]);
        progress(&played);
        played
    }))
}

/// Plays one file to rest.
pub fn play(loaded: &Loaded, file: &Path) -> Played {
    let played = Played { file: file.to_path_buf(), ..Played::default() };
    let motion = match motion::load(file) {
        Ok(motion) => motion,
        Err(error) => return Played { failed: Some(error.to_string()), ..played },
    };
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let mut offline = match Offline::new(loaded, &motion, options) {
        Ok(offline) => offline,
        Err(error) => return Played { failed: Some(error.to_string()), ..played },
    };
    let end = offline.play(|_| ());
    let report = offline.report();
    // Engaged ends once because of the last frame. Every other end is a hold.
    let engaged = report.modes.iter().filter(|(_, mode)| *mode == Mode::Engaged).count() as u64;
    Played {
        duration_s: report.rows as f64 / TICK_HZ as f64,
        violations: report.violations.clone(),
        min_clearance_mm: report.min_clearance_mm,
        torque_share_max: report.torque_share_max,
        fallbacks_per_tick: report.fallbacks as f64 / report.rows.max(1) as f64,
        limb_error_robot_deg: report.limb_error_measured_deg_mean,
        limb_error_deg: report.limb_error_deg_mean,
        holds: engaged.saturating_sub(1),
        failed: match end {
            OfflineEnd::AtRest => None,
            OfflineEnd::Stopped(why) => Some(why),
        },
        ..played
    }
}
