//! Plays a recorded motion: live, as any client would, or offline through the same stages, as fast as the machine can.

mod compare;
mod live;
mod offline;

use crate::cli::Cli;
use config::Overrides;
use motion::CalibrationMode;
use poses::{error::failure, trajectory};
use rt::{Exit, Failure, out};
use std::path::Path;
use std::process::ExitCode;

/// Bounds of the speed: slow enough to watch each joint, and faster than any arm follows.
const SPEED: (f64, f64) = (0.1, 10.0);

pub fn execute(cli: &mut Cli) -> ExitCode {
    // The daemon does the same, so that offline and live give the same numbers to the bit.
    let _ = rt::flush_denormals();
    rt::finish("replay", play(cli))
}

fn play(cli: &mut Cli) -> Result<(), Failure> {
    let (low, high) = SPEED;
    if !(low..=high).contains(&cli.speed) {
        let text = format!("--speed {:?} is outside [{low}, {high}]; 1 is the recorded speed", cli.speed);
        return Err(Failure::new(Exit::Usage, text));
    }
    if let Some(recording) = &cli.compare {
        return compare::run(cli, recording);
    }
    let motion = read(cli)?;
    describe(&motion, cli.calibration);
    let file = cli.file.as_deref().unwrap_or(Path::new("")).display();
    motion.stands_from().map_err(|why| Failure::new(Exit::NoInput, format!("{file}: {why}")))?;
    match &cli.offline {
        Some(out) => offline::run(cli, &motion, out),
        None => live::run(cli, &motion),
    }?;
    let lost = |why| Failure::new(Exit::DataErr, format!("{file} is damaged or truncated: {why}; the rest was played"));
    motion.guesses.lost.as_ref().map(lost).map_or(Ok(()), Err)
}

/// Returns the motion to play. A joint trajectory becomes a person with the limb rotations of the robot's
/// forward kinematics. So it passes through retargeting and every check, as any live person does.
fn read(cli: &mut Cli) -> Result<motion::Motion, Failure> {
    let file = cli.file.clone().unwrap_or_default();
    let is = |wanted: &str| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted));
    if !is("csv") {
        let motion = motion::load_with(&file, &cli.load).map_err(|error| failure(&error))?;
        if motion.name == motion::CALIBRATION {
            // A person to calibrate has no hinges yet.
            cli.calibration = CalibrationMode::None;
        } else if is("mcap") {
            // The skeletons have the limbs that `ingest` found, with any hinges.
            cli.calibration = CalibrationMode::Rig;
        }
        return Ok(motion);
    }
    cli.load.refusal(&file).map_or(Ok(()), |error| Err(failure(&error)))?;
    let loaded =
        config::load(&cli.config, Overrides::robot(cli.robot.as_ref())).map_err(Failure::with(Exit::Config))?;
    let trajectory = trajectory::read_csv(&file, &loaded.model).map_err(Failure::with(Exit::NoInput))?;
    let name = file.file_stem().map_or_else(|| "trajectory".into(), |stem| stem.to_string_lossy().into_owned());
    cli.calibration = CalibrationMode::Rig;
    Ok(trajectory::to_motion(&trajectory, &loaded.model, &name))
}

fn describe(motion: &motion::Motion, calibration: CalibrationMode) {
    // The file's own count.
    let frames = motion.frames.len() + usize::from(motion.first.is_some());
    let rest = if motion.first.is_some() { ", the first of them a rest pose that is left out" } else { "" };
    out!("{}: {frames} frames at {:.1} Hz, {:.1} s{rest}", motion.name, motion.frame_rate_hz, motion.duration_s());
    let guesses = &motion.guesses;
    out!(
        "unit {} ({} m each), stature {:.2} m, up {}",
        guesses.unit,
        guesses.scale_m_per_unit,
        guesses.stature_m,
        guesses.up
    );
    for warning in &guesses.warnings {
        out!("{warning}");
    }
    let hinges = match calibration {
        CalibrationMode::First10s => "the first 10 s (the whole motion if shorter)",
        CalibrationMode::Clip => "the whole motion",
        CalibrationMode::None => "the person's movements, as they are played",
        CalibrationMode::Rig => "the rig: its joints have no rotation in the T-pose",
    };
    out!("elbow hinges from {hinges}");
}
