//! `keyposes motions` writes the named motions. `keyposes interpolate` writes a joint trajectory between poses, in
//! the latent space. The poses and their motions are those of `poses`.

pub mod interpolate;
pub mod write;

use clap::{Args, Parser, Subcommand};
use config::RobotChoice;
use interpolate::{Options, Space};
use motion::{CalibrationMode, LoadOptions};
use poses::error::PosesError;
use poses::{motions, pose, trajectory};
use retarget::Network;
use robot::Model;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Named key poses, and interpolation between poses in the latent space.
#[derive(Debug, Parser)]
#[command(name = "keyposes", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Write each named motion as .bvh, and the best joint trajectory as .csv in the same folder.
    Motions {
        /// The folder. It is created if it is missing.
        #[arg(long, value_name = "DIR", default_value = "tools/replay/motions")]
        out: PathBuf,
        /// The robot: a name of config/robots, or a robot file.
        #[arg(long, value_name = "NAME|FILE", default_value = "tiago_dual")]
        robot: RobotChoice,
    },
    /// Write the joint trajectory from pose to pose through the latent space: CSV, and a .bvh with the same
    /// name. `replay` plays both.
    Interpolate(Interpolate),
}

#[derive(Args, Debug)]
struct Interpolate {
    /// Poses: FILE.bvh:FRAME or FILE.bvh@TIME_S (any motion file), or a name: rest, t-pose, hands-up, ... (see `keyposes motions`).
    #[arg(required = true, num_args = 2..)]
    poses: Vec<String>,
    /// Time from each pose to the next, s, 0.05 to 60.
    #[arg(long, default_value_t = 2.0, value_parser = rt::number, allow_negative_numbers = true)]
    seconds: f64,
    /// Rows per second, 1 to 1500.
    #[arg(long, default_value_t = 60.0, value_parser = rt::number, allow_negative_numbers = true)]
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
    /// Source of the elbow hinges of files: their first 10 s, all of them, the momentary elbow plane, the rig.
    #[arg(long, value_name = "first-10s|clip|none|rig", default_value = "first-10s", value_parser = calibration)]
    calibration: CalibrationMode,
    #[command(flatten)]
    load: LoadOptions,
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

/// Runs `replay keyposes`.
pub fn execute(cli: Cli) -> ExitCode {
    let done = match cli.command {
        Command::Motions { out, robot } => write_motions(&out, &robot),
        Command::Interpolate(arguments) => write_interpolation(&arguments),
    };
    rt::finish("keyposes", done)
}

fn refused(error: PosesError) -> Failure {
    let exit = match &error {
        PosesError::Pose { .. } => Exit::Usage,
        PosesError::Trajectory { .. } => Exit::DataErr,
        PosesError::File { .. } | PosesError::Motion(_) => Exit::NoInput,
    };
    Failure::new(exit, error)
}

/// Writes a file. It is either the old one or the new one, never a part.
fn save(path: &Path, text: &str) -> Result<(), Failure> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let write = || std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, path));
    write().inspect_err(|_| drop(std::fs::remove_file(&part))).map_err(|error| Failure::unwritable(path, &error))
}

/// Rejects an output that would overwrite an input.
fn apart(out: &Path, inputs: &[&Path]) -> Result<(), Failure> {
    let Ok(real) = out.canonicalize() else {
        return Ok(());
    };
    match inputs.iter().find(|input| input.canonicalize().is_ok_and(|input| input == real)) {
        Some(_) => {
            Err(Failure::new(Exit::Usage, format!("{}: is one of the inputs; give another --out", out.display())))
        }
        None => Ok(()),
    }
}

/// The chosen robot.
fn load_model(robot: &RobotChoice) -> Result<Model, Failure> {
    let file = robot.shipped_file().map_err(Failure::with(Exit::Config))?;
    std::fs::metadata(&file).map_err(PosesError::file(&file)).map_err(refused)?;
    Ok(config::load_model(&file).map_err(Failure::with(Exit::Config))?.0)
}

/// The network of these weights.
fn load_network(weights: &Path, model: &Model) -> Result<Network, Failure> {
    let stem = weights.to_str().and_then(|text| text.strip_suffix(".safetensors"));
    let tensors = PathBuf::from(format!("{}.safetensors", stem.map_or(weights, Path::new).display()));
    std::fs::metadata(&tensors).map_err(PosesError::file(&tensors)).map_err(refused)?;
    Ok(config::load_weights(weights, model).map_err(Failure::with(Exit::Config))?.network)
}

fn write_motions(out: &Path, robot: &RobotChoice) -> Result<(), Failure> {
    let model = load_model(robot)?;
    std::fs::create_dir_all(out).map_err(|error| Failure::unwritable(out, &error))?;
    for motion in motions::paper_motions() {
        let truth = trajectory::ground_truth(&model, &motion);
        save(&out.join(format!("{}.bvh", motion.name)), &write::compact_bvh(&motion))?;
        save(&out.join(format!("{}.csv", motion.name)), &write::trajectory_csv(&truth))?;
        rt::out!("{:<18} {:>4} frames, {:.1} s", motion.name, motion.frames.len(), motion.duration_s());
    }
    Ok(())
}

fn write_interpolation(arguments: &Interpolate) -> Result<(), Failure> {
    let Interpolate { out, calibration, load, seconds, rate, space, refine_steps, .. } = arguments;
    let beside = out.with_extension("bvh");
    if beside == *out {
        let reason = "the motion beside the trajectory would have the same name; give a name with .csv".to_owned();
        return Err(refused(PosesError::Trajectory { path: out.clone(), line: 1, reason }));
    }
    let files: Vec<&Path> = arguments.poses.iter().filter_map(|text| pose::file_of(text)).collect();
    apart(out, &files)?;
    apart(&beside, &files)?;
    let model = load_model(&arguments.robot)?;
    let weights = arguments.weights.clone().unwrap_or_else(|| arguments.robot.shipped_weights());
    let network = load_network(&weights, &model)?;
    let poses = arguments.poses.iter().map(|text| pose::read_pose(text, *calibration, load));
    let poses = poses.collect::<Result<Vec<_>, _>>().map_err(refused)?;
    let options = Options { seconds: *seconds, rate_hz: *rate, space: *space, refine_steps: *refine_steps };
    let found = interpolate::interpolate(&model, &network, &poses, &options)?;
    save(out, &write::trajectory_csv(&found))?;
    let name = out.file_stem().map_or_else(|| "interpolation".to_owned(), |stem| stem.to_string_lossy().into_owned());
    save(&beside, &write::compact_bvh(&trajectory::to_motion(&found, &model, &name)))?;
    rt::out!("{} rows in {}; the motion in {} (calibration `rig`)", found.q.len(), out.display(), beside.display());
    Ok(())
}
