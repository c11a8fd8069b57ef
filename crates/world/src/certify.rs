//! Plays a motion through all stages in virtual time, and passes on every command that the gate let through.

use crate::offline::{Offline, OfflineEnd, OfflineReport};
use client::PlayOptions;
use config::{ConfigError, Loaded};
use messages::{JOINTS_MAX, Mode};
use motion::{CalibrationMode, Motion};
use robot::Names;

/// A certified command. `replay --offline` writes the same positions and targets, until the robot stands. How long it stands
/// before the end depends on the simulated body, which moves there and not here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CertifiedRow {
    /// Ticks since the enable, 1500 a second.
    pub k: u64,
    /// Commanded positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Commanded velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Target positions, rad or m.
    pub target: [f64; JOINTS_MAX],
    /// Mode of the robot.
    pub mode: Mode,
    /// Smallest clearance of the checked pairs and obstacles, m.
    pub clearance_m: f64,
    /// Largest ratio of torque to its joint's effort limit, by the dynamics of the links.
    pub torque_share: f64,
    /// Newest frame of the motion at this tick. `None` before the motion begins.
    pub frame: Option<usize>,
}

/// Reason for which a motion has no certified trajectory.
#[derive(Debug)]
pub enum Uncertified<E> {
    /// A stage rejects the settings.
    Settings(ConfigError),
    /// The robot was stopped or did not engage, or a limit was broken. The text says why.
    Refused(String),
    /// The caller ended the run.
    Ended(E),
}

/// Plays `motion` from the enable until the robot is at rest again, without a body: its joints are where the commands sent
/// them, and so is what the report says of the measured ones. `each` gets the first of every `every` commands. Its
/// error ends the run.
///
/// # Errors
/// Returns an error if the motion has no certified trajectory.
pub fn certify<E>(
    loaded: &Loaded,
    motion: &Motion,
    calibration: CalibrationMode,
    every: u64,
    mut each: impl FnMut(&CertifiedRow) -> Result<(), E>,
) -> Result<OfflineReport, Uncertified<E>> {
    motion.stands_from().map_err(|why| Uncertified::Refused(why.to_owned()))?;
    let options = PlayOptions { speed: 1.0, looped: false, calibration };
    let mut offline = Offline::new(loaded, motion, options).map_err(Uncertified::Settings)?.without_body();
    // A slow motion is played with frames between its own.
    let frames_per_played = motion.frame_rate_hz / offline.played_rate_hz();
    let end = offline.try_play(|tick| {
        let Some(row) = tick.row.filter(|row| row.k.is_multiple_of(every)) else { return Ok(()) };
        let Some((control, command)) = tick.moment.control.and_then(|control| Some((control, control.command?))) else {
            return Ok(());
        };
        each(&CertifiedRow {
            k: row.k,
            q: row.command,
            v: command.v,
            target: row.target,
            mode: Mode::from_u32(control.status.mode).unwrap_or(Mode::Faulted),
            clearance_m: control.status.clearance_command_m,
            torque_share: tick.torque_share,
            // The product of two rates has rounding errors.
            frame: tick.frame.map(|frame| (frame as f64 * frames_per_played + 1e-6) as usize),
        })
    });
    match end.map_err(Uncertified::Ended)? {
        OfflineEnd::Stopped(what) => {
            let why = explain::why_stopped(offline.status(), &Names::from_model(&loaded.model));
            Err(Uncertified::Refused(why.map_or(what.clone(), |why| format!("{what}: {why}"))))
        }
        OfflineEnd::AtRest => {
            let report = offline.report();
            let broken: Vec<_> = report.violations.iter().filter(|(_, count)| **count > 0).collect();
            if broken.is_empty() {
                Ok(report.clone())
            } else {
                Err(Uncertified::Refused(format!("a limit was broken: {broken:?}")))
            }
        }
    }
}
