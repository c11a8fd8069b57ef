//! Plays a recorded motion: live, as any client would, or offline through the same stages, as fast as the
//! machine can.

mod cli;
mod compare;
mod live;
mod offline;

use clap::Parser;
use cli::Cli;
use config::Overrides;
use motion::{CalibrationMode, LoadOptions, MotionError};
use poses::trajectory;
use rt::{err, out};
use std::path::Path;
use std::process::ExitCode;

/// EX_NOINPUT of sysexits(3): a file to read is missing or malformed.
const EX_NOINPUT: u8 = 66;
/// EX_USAGE: an invalid argument.
const EX_USAGE: u8 = 64;
/// Bounds of the speed: slow enough to watch each joint, and faster than any arm follows.
const SPEED: (f64, f64) = (0.1, 10.0);

/// A text for the user and the exit code of sysexits(3).
struct Failure(u8, String);

impl Failure {
    /// EX_UNAVAILABLE: no instance runs there.
    fn unavailable(text: impl std::fmt::Display) -> Self {
        Self(69, text.to_string())
    }

    /// EX_CANTCREAT: an output file cannot be created.
    fn cannot_create(text: impl std::fmt::Display) -> Self {
        Self(73, text.to_string())
    }

    /// EX_CONFIG: the settings, robot or weights are invalid.
    fn config(text: impl std::fmt::Display) -> Self {
        Self(78, text.to_string())
    }

    /// The run itself failed.
    fn failed(text: impl std::fmt::Display) -> Self {
        Self(1, text.to_string())
    }
}

fn main() -> ExitCode {
    rt::abort_on_panic();
    let mut cli = Cli::parse();
    // The daemon does the same, so that offline and live give the same numbers to the bit.
    let _ = rt::flush_denormals();
    let (low, high) = SPEED;
    if !(low..=high).contains(&cli.speed) {
        err!("replay: --speed {} is outside [{low}, {high}]; 1 is the recorded speed", cli.speed);
        return ExitCode::from(EX_USAGE);
    }
    if let Some(recording) = &cli.compare {
        return ended(compare::run(&cli, recording));
    }
    let motion = match read(&mut cli) {
        Ok(motion) => motion,
        Err(failure) => return ended(Err(failure)),
    };
    describe(&motion, cli.calibration);
    let outcome = match &cli.offline {
        Some(out) => offline::run(&cli, &motion, out),
        None => live::run(&cli, &motion),
    };
    ended(outcome)
}

fn ended(outcome: Result<(), Failure>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(code, text)) => {
            err!("replay: {text}");
            ExitCode::from(code)
        }
    }
}

/// Returns the motion to play. A joint trajectory becomes a person with the limb rotations of the robot's
/// forward kinematics. So it passes through retargeting and every check, as any live person does.
fn read(cli: &mut Cli) -> Result<motion::Motion, Failure> {
    let no_input = |error: &dyn std::fmt::Display| Failure(EX_NOINPUT, error.to_string());
    let file = cli.file.clone().unwrap_or_default();
    if let Some(refused) = refused_up(cli, &file) {
        return Err(refused);
    }
    if let Some(motion) = file.to_str().and_then(motion::builtin_named) {
        if motion.name == motion::CALIBRATION {
            // A person to calibrate has no hinges yet.
            cli.calibration = CalibrationMode::None;
        }
        return Ok(motion);
    }
    let is = |wanted: &str| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted));
    if is("mcap") {
        // The skeletons have the limbs that `ingest` found, with any hinges.
        cli.calibration = CalibrationMode::Rig;
    }
    if !is("csv") {
        return motion::load_with(&file, &LoadOptions { up: cli.up, ..LoadOptions::default() }).map_err(|error| {
            match error {
                MotionError::Io { source, .. } => Failure(EX_NOINPUT, rt::unreadable(&file, &source)),
                error => no_input(&error),
            }
        });
    }
    let loaded = config::load(&cli.config, Overrides::default()).map_err(Failure::config)?;
    let trajectory = trajectory::read_csv(&file, &loaded.model).map_err(|error| no_input(&error))?;
    let name = file.file_stem().map_or_else(|| "trajectory".into(), |stem| stem.to_string_lossy().into_owned());
    cli.calibration = CalibrationMode::Rig;
    Ok(trajectory::to_motion(&trajectory, &loaded.model, &name))
}

/// The refusal of --up for a file whose axes are known or found.
fn refused_up(cli: &Cli, file: &Path) -> Option<Failure> {
    let has_axis =
        file.extension().is_some_and(|extension| ["npy", "npz"].iter().any(|one| extension.eq_ignore_ascii_case(one)));
    let text = || format!("{}: --up is for .npy and .npz files; leave it out", file.display());
    (cli.up.is_some() && !has_axis).then(|| Failure(EX_USAGE, text()))
}

fn describe(motion: &motion::Motion, calibration: CalibrationMode) {
    out!(
        "{}: {} frames at {:.1} Hz, {:.1} s",
        motion.name,
        motion.frames.len(),
        motion.frame_rate_hz,
        motion.duration_s()
    );
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
