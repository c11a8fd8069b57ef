//! Compares the robot with the person. Each clip is played through all stages in virtual time, as `replay
//! --offline` does, and the commands while Engaged are judged.
//!
//! - The *person* at an instant are the four limb rotations of the skeletons that `ingest` passed on,
//!   interpolated to that instant. The *robot* is the forward kinematics of the command for it.
//! - The *error* is the mean rotation angle of the four limbs.
//! - The error of the *hands* is against the target of the same tick, so it is against the person of the following delay
//!   before. Its optimum is the least for any motion of the wrist from the commanded forearm, within its positions, speeds
//!   and accelerations.
//! - The *expectation* is the way of a target beyond the newest skeleton. Its error is against the person's
//!   later motion.
//! - *At D ms* compares a command with the person D ms before.

mod expectation;
mod hands;
mod judge;
mod person;
mod play;
mod report;

pub use expectation::{AHEAD_MS, Expectation};
pub use hands::HandError;
pub use judge::{ClipFigures, errors_deg, judge, limbs_deg};
pub use person::{Hands, Person, Place};
pub use play::{Played, Sample, Stage};
pub use report::Report;

use crate::cli::Cli;
use crate::clips::{chosen, stem};
use crate::run::{load, write_json};
use ::report::{check_bounds, print};
use rayon::prelude::*;
use retarget::ArmModel;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Delays that are always judged, ms.
const DELAYS_MS: [f64; 2] = [60.0, 200.0];
/// Longest judged delay, ms.
const DELAY_MAX_MS: f64 = 2000.0;

pub fn run(cli: &Cli, folder: &Path) -> Result<(), Failure> {
    check_bounds("--delay-ms", cli.delay_ms, [0.0, DELAY_MAX_MS])?;
    // The daemon does the same, so the commands are equal to the bit.
    let _ = rt::flush_denormals();
    let loaded = load(cli)?;
    let stage = Stage::new(&loaded)?;
    let arms = ArmModel::both(&loaded.model);
    let mut delays_ms = DELAYS_MS.to_vec();
    delays_ms.push(cli.delay_ms);
    delays_ms.sort_by(f64::total_cmp);
    delays_ms.dedup();
    let clip = |file: &PathBuf| -> Result<ClipFigures, String> {
        let _ = rt::flush_denormals();
        let motion = motion::load_with(file, &cli.load).map_err(|error| error.to_string())?;
        let played = stage.play(&motion, cli.calibration)?;
        let stopped = played.stopped.iter().map(|why| format!(": {why}")).collect::<String>();
        let never = || format!("not Engaged for long enough{stopped}");
        judge(arms.each_ref(), &played, &delays_ms).ok_or_else(never)
    };
    let files = chosen(folder, cli.clips.as_deref())?;
    let judged: Vec<_> = files.par_iter().map(|file| (stem(file), clip(file))).collect();
    let (mut clips, mut skipped) = (Vec::new(), Vec::new());
    for (name, figures) in judged {
        match figures {
            Ok(figures) => clips.push(figures),
            Err(why) => skipped.push((name, why)),
        }
    }
    let folder = folder.display().to_string();
    let config = cli.config.display().to_string();
    let report = Report { folder, config, delay_ms: cli.delay_ms, delays_ms, clips, skipped };
    print(&report);
    write_json(cli, &report.json())?;
    match report.clips.iter().map(ClipFigures::violations_total).sum() {
        0_u64 => Ok(()),
        violations => Err(Failure::new(Exit::Failed, format!("{violations} violations"))),
    }
}
