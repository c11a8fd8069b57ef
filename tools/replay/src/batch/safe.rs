//! Plays a motion through all stages in virtual time, and keeps every command.

use super::run::{Rows, Shared};
use client::PlayOptions;
use messages::TICK_HZ;
use motion::Motion;
use robot::Names;
use rt::{Exit, Failure};
use std::path::Path;
use world::{Offline, OfflineEnd};

/// Largest number of commands of a file: ten minutes, 180 MB. `replay --offline` has no bound.
const COMMANDS_MAX: usize = 600 * TICK_HZ as usize;

/// Returns the commands of a motion, from the robot's start until it is at rest again. `None` if `interrupted` returned true.
///
/// # Errors
/// Returns why the robot was stopped or did not engage, or that the motion is too long.
pub(super) fn commands(
    shared: &Shared<'_>,
    input: &Path,
    motion: &Motion,
    interrupted: impl Fn() -> bool,
) -> Result<Option<Rows>, Failure> {
    let Some(loaded) = &shared.loaded else { return Ok(None) };
    let options = PlayOptions { speed: 1.0, looped: false, calibration: shared.cli.calibration };
    let mut offline = Offline::new(loaded, motion, options).map_err(Failure::with(Exit::Config))?;
    let mut rows = Vec::new();
    let played = offline.try_play(|tick| {
        if let Some(row) = tick.row {
            rows.push((row.k as f64 / TICK_HZ as f64, row.command));
        }
        if rows.len() > COMMANDS_MAX || interrupted() { Err(()) } else { Ok(()) }
    });
    let failed = |why: String| Failure::new(Exit::Failed, format!("{}: {why}", input.display()));
    match played {
        Err(()) if rows.len() > COMMANDS_MAX => {
            let seconds = COMMANDS_MAX / TICK_HZ as usize;
            Err(failed(format!("longer than {seconds} s; play it alone with replay --offline, which has no bound")))
        }
        Err(()) => Ok(None),
        Ok(OfflineEnd::Stopped(what)) => {
            let why = explain::why_stopped(offline.status(), &Names::from_model(&loaded.model));
            Err(failed(why.map_or(what.clone(), |why| format!("{what}: {why}"))))
        }
        Ok(OfflineEnd::AtRest) => {
            let broken: Vec<_> = offline.report().violations.iter().filter(|(_, count)| **count > 0).collect();
            if broken.is_empty() { Ok(Some(rows)) } else { Err(failed(format!("a limit was broken: {broken:?}"))) }
        }
    }
}
