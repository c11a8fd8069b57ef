//! Plays a motion through all stages in virtual time, and keeps every command.

use super::run::{Rows, Shared};
use messages::TICK_HZ;
use motion::Motion;
use rt::{Exit, Failure};
use std::path::Path;
use world::Uncertified;

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
    let mut rows = Vec::new();
    let certified = world::certify(loaded, motion, shared.cli.calibration, 1, |row| {
        rows.push((row.k as f64 / TICK_HZ as f64, row.q));
        if rows.len() > COMMANDS_MAX || interrupted() { Err(()) } else { Ok(()) }
    });
    let failed = |why: String| Failure::new(Exit::Failed, format!("{}: {why}", input.display()));
    match certified {
        Ok(_) => Ok(Some(rows)),
        Err(Uncertified::Ended(())) if rows.len() > COMMANDS_MAX => {
            let seconds = COMMANDS_MAX / TICK_HZ as usize;
            Err(failed(format!("longer than {seconds} s; play it alone with replay --offline, which has no bound")))
        }
        Err(Uncertified::Ended(())) => Ok(None),
        Err(Uncertified::Settings(error)) => Err(Failure::new(Exit::Config, error)),
        Err(Uncertified::Refused(why)) => Err(failed(why)),
    }
}
