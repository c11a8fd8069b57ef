//! Runs the command: reads, trains with a progress bar, evaluates, writes.

use crate::cli::Cli;
use crate::clips::Clips;
use crate::evaluation::evaluate;
use crate::files::{read_model, write_both};
use crate::gimbal::Gimbal;
use crate::kinematics::Arm;
use crate::lifting;
use crate::objective::Terms;
use crate::prediction;
use crate::sampling::Recorded;
use crate::session::{Options, Session, diverged};
use crate::start::start;
use indicatif::{ProgressBar, ProgressStyle};
use retarget::{ArmIdentity, Manifest, Network, RIGHT_ARM};
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Steps between validations. The figure changes slowly, and 2000 frames cost as much as 5 steps.
const VALIDATION_STEPS: u64 = 1_000;
const VALIDATION_POSES: usize = 2_000;
/// Steps of the lifter's training, and of the prediction's, if none are given.
const LIFTER_STEPS: u64 = 100_000;
const PREDICTION_STEPS: u64 = 3_000;
/// Number of steps over which the displayed loss is averaged.
const SHOWN_STEPS: u64 = 20;
/// Frames between two evaluations of the optimum. At 60 frames/s neighbouring frames hardly differ.
const OPTIMUM_STRIDE: usize = 3;

pub fn run(cli: &Cli) -> Result<(), Failure> {
    if let (true, Some(pairs), Some(validation)) = (cli.lifter, &cli.pairs, &cli.validation) {
        let steps = cli.steps.unwrap_or(LIFTER_STEPS);
        return lifting::learn(&cli.out, &cli.human[0], pairs, validation, steps, cli.seed);
    }
    let clips = Clips::read(&cli.human, cli.calibration, &cli.load)?;
    report(&clips);
    let out = cli.out.as_path();
    if cli.prediction {
        let steps = cli.steps.unwrap_or(PREDICTION_STEPS);
        return prediction::learn(out, &clips, steps, cli.seed, cli.calibration.name());
    }
    let recorded = clips.recorded();
    let arms = cli.robot.iter().flat_map(|robot| [0, 1].map(|side| begin(cli, robot, side, &recorded).transpose()));
    let (runs, mut sessions): (Vec<Run>, Vec<Session>) =
        arms.flatten().collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
    train(&runs, &mut sessions, &recorded, &clips)?;
    for (run, session) in runs.iter().zip(&sessions) {
        let trained_on = description(&session.options, &clips, &recorded, cli.calibration.name());
        write_product(&run.out, session, &run.identity, &clips, trained_on, cli.calibration.name())?;
        println!("wrote {}.safetensors and .toml", run.out.display());
    }
    Ok(())
}

struct Run {
    out: PathBuf,
    identity: ArmIdentity,
}

/// Begins the training of an arm. `None` for a right one that mirrors the left one.
fn begin(cli: &Cli, robot: &Path, side: usize, recorded: &Recorded) -> Result<Option<(Run, Session)>, Failure> {
    let model = read_model(robot)?;
    let identity = ArmIdentity::from_model(&model, side);
    let arm = Arm::from(&identity.arm);
    let mut out = if cli.robot.len() == 1 { cli.out.clone() } else { cli.out.join(&identity.robot) };
    out.as_mut_os_string().push(if side == 0 { "" } else { RIGHT_ARM });
    let mut options = cli.options()?;
    options.mixture.gimbal = recorded.share_to_turn(&Gimbal::new(&arm));
    let session = Session::new(options, arm).starting_at(start(&identity.arm, recorded));
    Ok((model.measured_side(side) == side).then_some((Run { out, identity }, session)))
}

fn write_product(
    out: &Path,
    session: &Session,
    identity: &ArmIdentity,
    clips: &Clips,
    trained_on: String,
    calibration: &str,
) -> Result<(), Failure> {
    // The figures are those of the weights that the file holds.
    let average: Vec<f32> = session.adam.average.iter().copied().map(perceptron::rounded).collect();
    let networks = session.networks.layers(&average);
    let network = Network::new(&networks, &identity.arm);
    let evaluation = evaluate(&identity.arm, &network, &clips.validation, OPTIMUM_STRIDE);
    let mut manifest = Manifest::new(identity, &networks);
    manifest.seed = session.options.seed;
    manifest.steps = session.step;
    manifest.trained_on = trained_on;
    manifest.validation = evaluation.table();
    manifest.validation.insert("calibration".into(), calibration.into());
    let (tensors, manifest) = retarget::write_weights(&networks, &manifest).map_err(Failure::with(Exit::Software))?;
    write_both(out, &tensors, &manifest)?;
    print!("{evaluation}");
    Ok(())
}

fn report(clips: &Clips) {
    for (file, reason) in &clips.skipped {
        eprintln!("skipped {file}: {reason}");
    }
    println!(
        "{} clips to train on, {} for validation, {} skipped",
        clips.training.len(),
        clips.validation.len(),
        clips.skipped.len()
    );
}

fn description(options: &Options, clips: &Clips, recorded: &Recorded, calibration: &str) -> String {
    format!(
        "{} recorded clips ({} arm poses, hinges calibrated by {calibration}) and procedural human arms ({:.0} % of each \
         batch of {}); robot postures uniform within the limits",
        clips.training.len(),
        2 * recorded.frames.len(),
        100.0 * options.mixture.procedural,
        options.batch
    )
}

fn train(runs: &[Run], sessions: &mut [Session], recorded: &Recorded, clips: &Clips) -> Result<(), Failure> {
    let Some(leader) = sessions.first() else { return Ok(()) };
    let poses = clips.validation_sample(VALIDATION_POSES);
    let steps = leader.options.schedule.steps;
    let bar = ProgressBar::new(steps);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed} (eta {eta}) {msg}") {
        bar.set_style(style);
    }
    let start = Instant::now();
    let mut shown = vec![Terms::default(); runs.len()];
    for step in 1..=steps {
        let terms = Session::advance_together(sessions, recorded);
        if terms.iter().zip(&*sessions).any(|(terms, it)| !terms.total(&it.options.weighting).is_finite()) {
            return Err(diverged(step));
        }
        for (shown, terms) in shown.iter_mut().zip(&terms) {
            // A single batch is too noisy to read.
            let running_mean = |mean: f64, new: f64| mean + (new - mean) / SHOWN_STEPS as f64;
            *shown = if step == 1 { *terms } else { shown.zip(terms, running_mean) };
        }
        let last = step == steps;
        if step.is_multiple_of(SHOWN_STEPS) || last {
            let rate = step as f64 / start.elapsed().max(Duration::from_millis(1)).as_secs_f64();
            bar.set_position(step);
            bar.set_message(format!("{rate:.1} steps/s"));
            if step.is_multiple_of(VALIDATION_STEPS) || last {
                for ((run, session), shown) in runs.iter().zip(&*sessions).zip(&shown) {
                    let degrees = session.mean_limb_degrees(&poses);
                    let (robot, line) = (&run.identity.robot, line(shown, degrees, rate));
                    bar.suspend(|| println!("{robot} step {step:>6}  {line}"));
                }
            }
        }
    }
    bar.finish_and_clear();
    println!("{steps} steps in {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

fn line(terms: &Terms, degrees: f64, rate: f64) -> String {
    format!(
        "S_GR {:.5} limits {:.5} noise {:.5} triplet {:.4} rec {:.4} ltc {:.4} | validation {degrees:.3} deg | {rate:.1} steps/s",
        terms.kinematics, terms.limits, terms.steadiness, terms.triplet, terms.reconstruction, terms.cycle
    )
}
