//! Plays recorded motions through every stage, from the first frame to rest, in virtual time.

use client::PlayOptions;
use config::Loaded;
use messages::{Mode, TICK_HZ};
use motion::CalibrationMode;
use report::in_parallel;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use world::{Offline, OfflineEnd, OfflineReport};

#[derive(Clone, Debug)]
pub struct Played {
    pub file: PathBuf,
    /// Figures of the run. Empty if it did not begin.
    pub report: OfflineReport,
    /// The reason if the run did not end at rest after the last frame.
    pub failed: Option<String>,
}

impl Played {
    pub fn violations_total(&self) -> u64 {
        self.report.violations.values().sum()
    }

    /// Virtual time from the enable to rest, s.
    pub fn duration_s(&self) -> f64 {
        self.report.rows as f64 / TICK_HZ as f64
    }

    /// Motions that were not certified, per tick.
    pub fn fallbacks_per_tick(&self) -> f64 {
        f64::from(self.report.fallbacks) / self.report.rows.max(1) as f64
    }

    /// Times the robot stopped following before the end. Engaged ends once because of the last frame.
    pub fn holds(&self) -> u64 {
        let engaged = self.report.modes.iter().filter(|(_, mode)| *mode == Mode::Engaged).count() as u64;
        engaged.saturating_sub(1)
    }
}

/// Plays the motion files of `folder` and returns the result of each. Calls `progress` after every file.
pub fn run(
    loaded: &Loaded,
    folder: &Path,
    threads: usize,
    progress: impl Fn(&Played) + Sync,
) -> Result<Vec<Played>, Failure> {
    let files = motion::motion_files(folder).map_err(Failure::with(Exit::NoInput))?;
    if files.is_empty() {
        return Err(Failure::new(
            Exit::NoInput,
            format!("{}: no motion files (.bvh, .npy, .npz) in it", folder.display()),
        ));
    }
    Ok(in_parallel(threads, files.len(), |i| {
        let played = play(loaded, &files[i]);
        progress(&played);
        played
    }))
}

pub fn play(loaded: &Loaded, file: &Path) -> Played {
    let (report, failed) = match to_rest(loaded, file) {
        Ok((report, OfflineEnd::AtRest)) => (report, None),
        Ok((report, OfflineEnd::Stopped(why))) => (report, Some(why)),
        Err(failure) => (OfflineReport::default(), Some(failure.text)),
    };
    Played { file: file.to_path_buf(), report, failed }
}

fn to_rest(loaded: &Loaded, file: &Path) -> Result<(OfflineReport, OfflineEnd), Failure> {
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let mut offline = Offline::new(loaded, &motion::load(file).map_err(Failure::with(Exit::NoInput))?, options)
        .map_err(Failure::with(Exit::Config))?;
    let end = offline.play(|_| ());
    Ok((offline.report().clone(), end))
}
