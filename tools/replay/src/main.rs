//! Plays a recorded motion: live, as any client would, or offline through the same stages as fast as the machine can.

mod live;
mod offline;

use clap::Parser;
use motion::CalibrationMode;
use std::path::PathBuf;
use std::process::ExitCode;

/// EX_NOINPUT of sysexits(3): a file to read is missing or malformed.
const EX_NOINPUT: u8 = 66;

/// Publishes a recorded motion to a running teleopd, or writes what the robot would do.
#[derive(Debug, Parser)]
#[command(name = "replay", version, about)]
struct Cli {
    /// The motion file (.bvh), or `builtin`.
    file: PathBuf,
    /// 1 is the recorded speed.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
    /// Begin again at the end, with the seam blended.
    #[arg(long = "loop")]
    looped: bool,
    /// Run all stages here, and write the commands at 1500 Hz to this CSV file (and a JSON file beside it).
    #[arg(long, value_name = "OUT.csv")]
    offline: Option<PathBuf>,
    /// Where the elbow hinges come from: the first 10 s of the motion, or all of it (which looks ahead).
    #[arg(long, value_name = "first-10s|clip|none", default_value = "first-10s", value_parser = calibration)]
    calibration: CalibrationMode,
    /// Settings for --offline.
    #[arg(long, value_name = "FILE", default_value = "config/teleop.toml")]
    config: PathBuf,
    /// Folder of the running instance.
    #[arg(long, value_name = "DIR", default_value = pipeline::DEFAULT_RUN_DIR)]
    run_dir: PathBuf,
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    match text {
        "first-10s" => Ok(CalibrationMode::First10s),
        "clip" => Ok(CalibrationMode::Clip),
        "none" => Ok(CalibrationMode::None),
        _ => Err("is one of first-10s, clip, none".into()),
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    if !(cli.speed > 0.0 && cli.speed <= 10.0) {
        eprintln!("replay: --speed {} is outside (0, 10]", cli.speed);
        return ExitCode::from(EX_NOINPUT);
    }
    let motion = if cli.file.as_os_str() == "builtin" {
        motion::builtin()
    } else {
        match motion::load(&cli.file) {
            Ok(motion) => motion,
            Err(error) => {
                eprintln!("replay: {error}");
                return ExitCode::from(EX_NOINPUT);
            }
        }
    };
    describe(&motion, cli.calibration);
    let outcome = match &cli.offline {
        Some(out) => offline::run(&cli, &motion, out),
        None => live::run(&cli, &motion),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("replay: {text}");
            ExitCode::FAILURE
        }
    }
}

fn describe(motion: &motion::Motion, calibration: CalibrationMode) {
    println!(
        "{}: {} frames at {:.1} Hz, {:.1} s",
        motion.name,
        motion.frames.len(),
        motion.frame_rate_hz,
        motion.duration_s()
    );
    let guesses = &motion.guesses;
    println!(
        "unit {} ({} m each), stature {:.2} m, up {}",
        guesses.unit, guesses.scale_m_per_unit, guesses.stature_m, guesses.up
    );
    for warning in &guesses.warnings {
        println!("{warning}");
    }
    let hinges = match calibration {
        CalibrationMode::First10s => "the first 10 s (the whole motion if shorter)",
        CalibrationMode::Clip => "the whole motion",
        CalibrationMode::None => "the momentary elbow plane",
    };
    println!("elbow hinges from {hinges}");
}
