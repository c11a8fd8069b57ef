//! Runs the command: reads, retargets every clip by every method, measures, times, prints, writes.

use crate::cli::Cli;
use crate::clips::{self, Clip};
use crate::methods::{Method, Missing, Posture, Solver, prepare};
use crate::metrics::{Task, measure};
use crate::report::{Measured, Report, Setting};
use crate::timing::{Moment, us_per_pose};
use crate::{following, refusals, video, words};
use ::report::print;
use config::{ConfigError, Loaded, Overrides};
use rayon::prelude::*;
use retarget::{ArmModel, Weights};
use robot::Model;
use rt::{Exit, Failure};
use serde_json::Value;
use std::path::Path;
use train::clips::VALIDATION_EVERY;
use train::files::read_model;

/// Number of timed poses, spread over all clips.
const TIMED_POSES: usize = 256;

pub fn run(cli: &Cli) -> Result<(), Failure> {
    cli.json.as_deref().map_or(Ok(()), Failure::check_writable)?;
    // The command line has exactly one of them.
    if let Some(folder) = &cli.following {
        return following::run(cli, folder);
    }
    if let Some(folder) = &cli.refusals {
        return refusals::run(cli, folder);
    }
    if let Some(captions) = &cli.words {
        return words::run(cli, captions);
    }
    if let Some(folder) = &cli.video {
        return video::run(cli, folder);
    }
    cli.human.as_deref().map_or(Ok(()), |folder| retargeting(cli, folder))
}

fn retargeting(cli: &Cli, human: &Path) -> Result<(), Failure> {
    let model = read_model(&cli.robot().shipped_file().map_err(Failure::with(Exit::Config))?)?;
    let arms = ArmModel::both(&model);
    let weights = read_weights(cli, &model)?;
    let (clips, skipped) = clips::read(human, cli.clips.as_deref(), cli.calibration, &cli.load)?;
    for (file, reason) in &skipped {
        eprintln!("skipped {file}: {reason}");
    }
    // A method should not be trained on the clips of its measurement.
    let files = motion::motion_files(human).map_err(Failure::with(Exit::NoInput))?;
    let trains = cli.clips.is_none() && files.len() >= VALIDATION_EVERY;
    let training = if trains { human } else { Path::new("MOTIONS") };
    let methods = prepare(cli, training, weights.as_ref())?;
    let missing = methods.iter().find_map(|method| Some((&method.name, method.solver.as_ref().err()?)));
    if let Some((name, Missing { reason, command })) = missing.filter(|_| cli.methods.is_some()) {
        let text = format!("--methods names {name}, but {reason}; make it with: {command}");
        return Err(Failure::new(Exit::NoInput, text));
    }
    let tasks = tasks(arms.each_ref(), clips);
    let report = report(cli, human, arms.each_ref(), weights.as_ref(), &methods, &tasks);
    print(&report);
    write_json(cli, &report.json())
}

pub(crate) fn load(cli: &Cli) -> Result<Loaded, Failure> {
    config::load(&cli.config, Overrides::robot(cli.robot.as_ref())).map_err(Failure::with(Exit::Config))
}

pub(crate) fn write_json(cli: &Cli, json: &Value) -> Result<(), Failure> {
    let Some(path) = &cli.json else { return Ok(()) };
    std::fs::write(path, format!("{json:#}\n")).map_err(|cause| Failure::unwritable(path, &cause))?;
    print(&format!("wrote {}\n", path.display()));
    Ok(())
}

/// Reads our weights. None if no method uses them, or if the user named none and the robot has none.
fn read_weights(cli: &Cli, model: &Model) -> Result<Option<Weights>, Failure> {
    let (path, is_named) = cli.weights();
    let are_used = cli.methods.as_ref().is_none_or(|names| names.iter().any(|name| name.starts_with("ours")));
    if !are_used || !is_named && !path.exists() {
        return Ok(None);
    }
    let exit = |error: &ConfigError| if let ConfigError::Read { .. } = error { Exit::NoInput } else { Exit::DataErr };
    // A robot without weights of its own has those of the default robot, if its arms are the same.
    let are_others = !is_named && path.file_stem() != Some(cli.robot().name().as_ref());
    match config::load_weights(&path, model) {
        Err(_) if are_others => Ok(None),
        weights => weights.map(Some).map_err(|error| Failure::new(exit(&error), error.to_string())),
    }
}

pub fn tasks(arms: [&ArmModel; 2], clips: Vec<Clip>) -> Vec<Task> {
    let task = |clip: Clip| Task { oracle: Solver::Oracle.clip(arms, &clip.human), clip };
    clips.into_par_iter().map(task).collect()
}

pub fn report(
    cli: &Cli,
    human: &Path,
    arms: [&ArmModel; 2],
    weights: Option<&Weights>,
    methods: &[Method],
    tasks: &[Task],
) -> Report {
    let moments = moments(tasks);
    let measured = |solver: &Solver| {
        let postures = postures(solver, arms, tasks);
        Measured { figures: measure(arms, tasks, &postures), us_per_pose: us_per_pose(solver, arms, &moments) }
    };
    let rows = methods.iter().map(|Method { name, solver }| {
        let result = solver.as_ref().map(measured).map_err(Missing::clone);
        (name.clone(), result)
    });
    Report { rows: rows.collect(), setting: Setting::new(cli, human, weights, tasks) }
}

/// Retargets every clip by one method. The oracle's postures are not computed again.
pub fn postures(solver: &Solver, arms: [&ArmModel; 2], tasks: &[Task]) -> Vec<Vec<Posture>> {
    match solver {
        Solver::Oracle => tasks.iter().map(|task| task.oracle.clone()).collect(),
        _ => tasks.par_iter().map(|task| solver.clip(arms, &task.clip.human)).collect(),
    }
}

/// Returns poses to time, evenly from all clips, each with the oracle's posture of the previous frame.
pub fn moments(tasks: &[Task]) -> Vec<Moment> {
    let of_task = |task: &Task| task.clip.human.iter().skip(1).copied().zip(task.oracle.iter().copied()).collect();
    let all = tasks.iter().map(of_task).collect::<Vec<Vec<Moment>>>().concat();
    let step = all.len().div_ceil(TIMED_POSES).max(1);
    all.into_iter().step_by(step).collect()
}
