//! `keyposes motions` writes the named motions. `keyposes interpolate` writes a joint trajectory between poses.

use clap::{Args, Parser, Subcommand};
use config::RobotChoice;
use keyposes::error::KeyposesError;
use keyposes::interpolate::{Options, Space};
use keyposes::write;
use motion::CalibrationMode;
use poses::error::PosesError;
use poses::{motions, pose, trajectory};
use retarget::Network;
use robot::Model;
use rt::Failure;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Named key poses, and interpolation between poses in the latent space.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write each named motion as .bvh, and the best joint trajectory as .csv in the same folder.
    Motions {
        /// The folder. It is created if it is missing.
        #[arg(long, value_name = "DIR", default_value = "tools/keyposes/motions")]
        out: PathBuf,
        /// The robot: a name of config/robots, or a robot file.
        #[arg(long, value_name = "NAME|FILE", default_value = "tiago_dual")]
        robot: RobotChoice,
    },
    /// Write the joint trajectory from pose to pose through the latent space: CSV, and a .bvh with the same
    /// name. `replay` plays both.
    Interpolate(Interpolate),
}

#[derive(Args)]
struct Interpolate {
    /// Poses: FILE.bvh:FRAME, FILE.bvh@TIME_S, or a name: rest, t-pose, hands-up, ... (see `keyposes
    /// motions`).
    #[arg(required = true, num_args = 2..)]
    poses: Vec<String>,
    /// Time from each pose to the next, s, 0.05 to 60.
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
    /// Rows per second, 1 to 1500.
    #[arg(long, default_value_t = 60.0)]
    rate: f64,
    /// Output file of the trajectory. The motion gets the same name with .bvh.
    #[arg(long, value_name = "FILE.csv", default_value = "interpolation.csv")]
    out: PathBuf,
    /// Space in which the line between two poses is straight.
    #[arg(long, value_enum, value_name = "latent|joint", hide_possible_values = true, default_value = "latent")]
    space: Space,
    /// Levenberg-Marquardt steps after the network, 0 to 16.
    #[arg(long, default_value_t = 2)]
    refine_steps: u32,
    /// Source of the elbow hinges of files: their first 10 s, all of them, the momentary elbow plane, the
    /// rig.
    #[arg(long, value_name = "first-10s|clip|none|rig", default_value = "first-10s", value_parser = calibration)]
    calibration: CalibrationMode,
    /// The robot: a name of config/robots, or a robot file.
    #[arg(long, value_name = "NAME|FILE", default_value = "tiago_dual")]
    robot: RobotChoice,
    /// Weights, without extension [default: those with the robot's name in weights, or weights/tiago_dual].
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
}

fn calibration(text: &str) -> Result<CalibrationMode, String> {
    CalibrationMode::among(text, &CalibrationMode::ALL)
}

fn main() -> ExitCode {
    rt::abort_on_panic();
    let done = match Arguments::parse().command {
        Command::Motions { out, robot } => write_motions(&out, &robot),
        Command::Interpolate(arguments) => interpolate(&arguments),
    };
    rt::finish("keyposes", done.map_err(|error| Failure::new(error.exit(), error)))
}

/// Writes a file. It is either the old one or the new one, never a part.
fn save(path: &Path, text: &str) -> Result<(), KeyposesError> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let write = || std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, path));
    write()
        .inspect_err(|_| drop(std::fs::remove_file(&part)))
        .map_err(|source| KeyposesError::Write { path: path.to_path_buf(), source })
}

/// Rejects an output that would overwrite an input.
fn apart(out: &Path, inputs: &[&Path]) -> Result<(), KeyposesError> {
    let Ok(real) = out.canonicalize() else {
        return Ok(());
    };
    match inputs.iter().find(|input| input.canonicalize().is_ok_and(|input| input == real)) {
        Some(_) => Err(KeyposesError::OverInput { path: out.to_path_buf() }),
        None => Ok(()),
    }
}

/// The chosen robot.
fn load_model(robot: &RobotChoice) -> Result<Model, KeyposesError> {
    let file = robot.shipped_file()?;
    std::fs::metadata(&file).map_err(PosesError::file(&file))?;
    Ok(config::load_model(&file)?.0)
}

/// The network of these weights.
fn load_network(weights: &Path, model: &Model) -> Result<Network, KeyposesError> {
    let stem = weights.to_str().and_then(|text| text.strip_suffix(".safetensors"));
    let tensors = PathBuf::from(format!("{}.safetensors", stem.map_or(weights, Path::new).display()));
    std::fs::metadata(&tensors).map_err(PosesError::file(&tensors))?;
    Ok(config::load_weights(weights, model)?.network)
}

fn write_motions(out: &Path, robot: &RobotChoice) -> Result<(), KeyposesError> {
    let model = load_model(robot)?;
    std::fs::create_dir_all(out).map_err(|source| KeyposesError::Write { path: out.to_path_buf(), source })?;
    for motion in motions::paper_motions() {
        let truth = trajectory::ground_truth(&model, &motion);
        save(&out.join(format!("{}.bvh", motion.name)), &write::compact_bvh(&motion))?;
        save(&out.join(format!("{}.csv", motion.name)), &write::trajectory_csv(&truth))?;
        rt::out!("{:<18} {:>4} frames, {:.1} s", motion.name, motion.frames.len(), motion.duration_s());
    }
    Ok(())
}

fn interpolate(arguments: &Interpolate) -> Result<(), KeyposesError> {
    let Interpolate { out, calibration, seconds, rate, space, refine_steps, .. } = arguments;
    let beside = out.with_extension("bvh");
    if beside == *out {
        let reason = "the motion beside the trajectory would have the same name; give a name with .csv".to_owned();
        return Err(PosesError::Trajectory { path: out.clone(), line: 1, reason }.into());
    }
    let files: Vec<&Path> = arguments.poses.iter().filter_map(|text| pose::file_of(text)).collect();
    apart(out, &files)?;
    apart(&beside, &files)?;
    let model = load_model(&arguments.robot)?;
    let weights = arguments.weights.clone().unwrap_or_else(|| arguments.robot.shipped_weights());
    let network = load_network(&weights, &model)?;
    let poses =
        arguments.poses.iter().map(|text| pose::read_pose(text, *calibration)).collect::<Result<Vec<_>, _>>()?;
    let options = Options { seconds: *seconds, rate_hz: *rate, space: *space, refine_steps: *refine_steps };
    let found = keyposes::interpolate::interpolate(&model, &network, &poses, &options)?;
    save(out, &write::trajectory_csv(&found))?;
    let name = out.file_stem().map_or_else(|| "interpolation".to_owned(), |stem| stem.to_string_lossy().into_owned());
    save(&beside, &write::compact_bvh(&trajectory::to_motion(&found, &model, &name)))?;
    rt::out!("{} rows in {}; the motion in {} (calibration `rig`)", found.q.len(), out.display(), beside.display());
    Ok(())
}
