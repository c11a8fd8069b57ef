//! What the command does: read, retarget every clip by every method, measure, time, print, write.

use crate::cli::{Cli, Frame};
use crate::clips::{self, Clip, Selection};
use crate::error::EvalError;
use crate::methods::{self, Method, Posture, Solver, Sources, prepare, second_oracle};
use crate::metrics::{Task, measure};
use crate::parallel;
use crate::report::{Report, Row, Setting};
use crate::timing::{Moment, us_per_pose};
use retarget::{ArmIdentity, ArmModel, Weights};
use std::path::Path;
use train::robot_file::{arm_of, read_model};

/// Starts and seed of the second oracle.
const SECOND_STARTS: u32 = 20;
const SECOND_SEED: u64 = 1_234;
/// Poses that are timed, spread over all clips.
const TIMED_POSES: usize = 256;

/// Measures as asked, prints the table, writes JSON and plots.
///
/// # Errors
/// The first thing that made it impossible, with the file or option at fault.
pub fn run(cli: &Cli) -> Result<(), EvalError> {
    if cli.stride == 0 {
        let expected = "1 or more".to_owned();
        return Err(EvalError::Option { option: "stride", value: "0".to_owned(), expected });
    }
    let (identity, _) = arm_of(&read_model(&cli.robot)?);
    let weights = read_weights(&cli.weights, &identity)?;
    let selection = Selection::parse(cli.clips.as_deref());
    let (clips, skipped) = clips::read(&cli.human, &selection, cli.calibration.mode(), cli.stride)?;
    for (file, reason) in &skipped {
        eprintln!("skipped {file}: {reason}");
    }
    let sources = Sources { human: &cli.human, robot: &cli.robot, weights: &cli.weights, baselines: &cli.baselines };
    let wanted = cli.methods.clone().unwrap_or_else(methods::names);
    let methods = prepare(&wanted, &sources, &identity, weights.as_ref())?;
    if cli.methods.is_some() {
        refuse_missing(&methods)?;
    }
    let tasks = tasks(&identity.arm, clips, cli.frame, cli.stride);
    let report = report(cli, &identity.arm, weights.as_ref(), &methods, &tasks);
    print!("{report}");
    if let Some(path) = &cli.json {
        let text = format!("{:#}\n", report.json());
        std::fs::write(path, text).map_err(|source| EvalError::File { path: path.clone(), action: "write", source })?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

/// Our weights; none if there is no such file.
fn read_weights(path: &Path, identity: &ArmIdentity) -> Result<Option<Weights>, EvalError> {
    if !path.exists() {
        return Ok(None);
    }
    let manifest = path.with_extension("toml");
    let read = |path: &Path| {
        std::fs::read(path).map_err(|source| EvalError::File { path: path.to_path_buf(), action: "read", source })
    };
    let text = String::from_utf8_lossy(&read(&manifest)?).into_owned();
    let weights = Weights::read(&text, &read(path)?, identity);
    weights.map(Some).map_err(|source| EvalError::Weights { path: path.to_path_buf(), source })
}

fn refuse_missing(methods: &[Method]) -> Result<(), EvalError> {
    for method in methods {
        if let Err(missing) = &method.solver {
            let (reason, command) = (missing.reason.clone(), missing.command.clone());
            return Err(EvalError::Missing { name: method.name.clone(), reason, command });
        }
    }
    Ok(())
}

/// Clips with what they are compared with, and the oracle's postures.
#[must_use]
pub fn tasks(arm: &ArmModel, clips: Vec<Clip>, frame: Frame, stride: usize) -> Vec<Task> {
    parallel::map(&clips, |clip| {
        let target = match frame {
            Frame::Chest => clip.human.clone(),
            Frame::Global => clip.global(),
        };
        Task {
            oracle: Solver::Oracle.clip(arm, &target),
            second_oracle: second_oracle(arm, &target, SECOND_STARTS, SECOND_SEED),
            target,
            clip: clip.clone(),
            contiguous: stride == 1,
        }
    })
}

/// Measures all methods on all tasks.
#[must_use]
pub fn report(cli: &Cli, arm: &ArmModel, weights: Option<&Weights>, methods: &[Method], tasks: &[Task]) -> Report {
    let moments = moments(tasks);
    let rows = methods.iter().map(|method| {
        let solver = match &method.solver {
            Ok(solver) => solver,
            Err(missing) => return Row { name: method.name.clone(), result: Err(missing.clone()) },
        };
        let postures = postures(solver, arm, tasks);
        let runs: Vec<_> = tasks.iter().zip(&postures).map(|(task, postures)| task.run(postures)).collect();
        let us_per_pose = us_per_pose(solver, arm, &moments);
        Row { name: method.name.clone(), result: Ok((measure(arm, &runs), us_per_pose)) }
    });
    let rows = rows.collect();
    let second: Vec<_> = tasks.iter().map(|task| task.run(&task.second_oracle)).collect();
    let floor = measure(arm, &second);
    Report { rows, floor, setting: Setting::of(cli, weights, tasks) }
}

/// Every clip by one method; what the oracle gave is not computed again.
#[must_use]
pub fn postures(solver: &Solver, arm: &ArmModel, tasks: &[Task]) -> Vec<Vec<Posture>> {
    match solver {
        Solver::Oracle => tasks.iter().map(|task| task.oracle.clone()).collect(),
        _ => parallel::map(tasks, |task| solver.clip(arm, &task.clip.human)),
    }
}

/// Poses to time, evenly from all clips, each with the oracle's posture of the frame before.
fn moments(tasks: &[Task]) -> Vec<Moment> {
    let all = tasks.iter().flat_map(|task| {
        let before = task.oracle.iter().copied();
        task.clip.human.iter().skip(1).copied().zip(before)
    });
    let all: Vec<Moment> = all.collect();
    let step = all.len().div_ceil(TIMED_POSES).max(1);
    all.into_iter().step_by(step).collect()
}
