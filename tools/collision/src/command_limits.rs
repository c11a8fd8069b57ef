//! `collision limits`.

use crate::robot_texts;
use collision::dynamics::{Dynamics, Payload};
use collision::error::CollisionError;
use collision::limits::{Motion, Sampling, Solution, Survey};
use collision::report;
use messages::JOINTS;
use robot::Model;
use std::path::PathBuf;

/// Options of `collision limits`.
#[derive(clap::Args)]
pub(crate) struct Limits {
    /// Robot file.
    robot: PathBuf,
    /// Point mass in each hand, kg.
    #[arg(long, default_value_t = 0.0)]
    payload_kg: f64,
    /// Links at whose origins the payload sits [default: all whose names end in `_grasping_frame`].
    #[arg(long)]
    payload_at: Vec<String>,
    /// Random states.
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    states: u64,
    /// Seed of the random states.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Share of the URDF's effort limit that may be used.
    #[arg(long, default_value_t = 0.85)]
    share: f64,
    /// Find accelerations for the arms at this share of the URDF's velocities; several are compared.
    #[arg(long)]
    speed_share: Vec<f64>,
    /// No joint of an arm gets a higher acceleration, rad/s^2.
    #[arg(long, default_value_t = 8.0)]
    cap: f64,
    /// Write speeds and accelerations of the last solution into the robot file, if it holds.
    #[arg(long, requires = "speed_share")]
    write: bool,
}

impl Limits {
    fn check(&self) -> Result<(), CollisionError> {
        let bounds =
            [("--share", self.share, 1.0), ("--cap", self.cap, 200.0), ("--payload-kg", self.payload_kg, 50.0)];
        let speeds = self.speed_share.iter().map(|share| ("--speed-share", *share, 1.0));
        for (key, value, most) in bounds.into_iter().chain(speeds) {
            if !(value >= 0.0 && value <= most) || (value == 0.0 && key != "--payload-kg") {
                return Err(CollisionError::content("arguments", format!("{key} {value}, must be above 0 to {most}")));
            }
        }
        Ok(())
    }

    fn payloads(&self, urdf: &urdf_rs::Robot) -> Vec<Payload> {
        let frames = urdf.links.iter().map(|link| link.name.clone()).filter(|name| name.ends_with("_grasping_frame"));
        let links = if self.payload_at.is_empty() { frames.collect() } else { self.payload_at.clone() };
        links.into_iter().map(|link| Payload { link, mass_kg: self.payload_kg }).collect()
    }

    /// How to make the same again.
    fn command(&self, share: f64) -> String {
        format!(
            "collision limits {} --speed-share {share} --payload-kg {} --states {} --seed {} --share {} --cap {} --write",
            self.robot.display(),
            self.payload_kg,
            self.states,
            self.seed,
            self.share,
            self.cap
        )
    }
}

/// Prints the torques at the limits in force, or finds limits. False where a state exceeds the share, sampled or climbed to.
pub(crate) fn limits(options: &Limits) -> Result<bool, CollisionError> {
    options.check()?;
    let (toml, urdf) = robot_texts(&options.robot)?;
    let model = Model::from_text(&toml.0, &toml.1, &urdf.0, &urdf.1)?;
    let parsed =
        urdf_rs::read_from_string(&urdf.1).map_err(|error| CollisionError::content(&urdf.0, error.to_string()))?;
    let dynamics = Dynamics::new(&model, &parsed, &options.payloads(&parsed))?;
    let sampling = Sampling { states: options.states, seed: options.seed, share: options.share };
    let survey = Survey { model: &model, dynamics: &dynamics, sampling };
    if options.speed_share.is_empty() {
        return Ok(in_force(&survey));
    }
    let mut last: Option<(f64, Solution)> = None;
    for share in &options.speed_share {
        let solution = solve(&survey, *share, options.cap);
        println!("{}", report::line(*share, &solution));
        last = Some((*share, solution));
    }
    let Some((share, solution)) = last else { return Ok(false) };
    println!("\n{}", report::table(&survey, &solution.motion, &solution.found, &solution.climbed));
    println!("{}", report::worst_cases(&survey, &solution.motion, &solution.found));
    if options.write && !solution.complete {
        eprintln!("collision: {}: nothing was written: the solution at --speed-share {share} does not hold", toml.0);
    } else if options.write {
        let section = report::section(&survey, &solution, &options.command(share));
        let text = report::with_section(&toml.1, &section).ok_or_else(|| {
            CollisionError::content(&toml.0, "no place for the section: marks are missing or in disorder")
        })?;
        // A file that would be refused is not written.
        Model::from_text(&toml.0, &text, &urdf.0, &urdf.1)?;
        std::fs::write(&options.robot, text).map_err(|cause| CollisionError::File { file: toml.0.clone(), cause })?;
        println!("written: {}", options.robot.display());
    }
    Ok(solution.complete)
}

fn solve(survey: &Survey<'_>, share: f64, cap: f64) -> Solution {
    let v = report::scaled_speeds(survey.model, share);
    survey.solve(&v, cap, 0.5)
}

fn in_force(survey: &Survey<'_>) -> bool {
    let motion = Motion::in_force(survey.model);
    let found = survey.pass(&motion);
    let climbed = survey.climb_all(&found, &motion);
    println!("{}", report::table(survey, &motion, &found, &climbed));
    println!("{}", report::worst_cases(survey, &motion, &found));
    let mut holds = true;
    for j in 0..JOINTS {
        let (name, share, states) =
            (&survey.model.joint_names[j], survey.sampling.share, survey.sampling.states as f64);
        let top = climbed[j].as_ref().map_or(0.0, |state| state.torque(&motion.a) / survey.effort(j));
        if found[j].exceeding > 0 {
            println!(
                "{name}: {:.4} % of the states exceed {share} of the effort limit, {:.4} % even without acceleration",
                found[j].exceeding as f64 / states * 100.0,
                found[j].exceeding_coasting as f64 / states * 100.0
            );
        } else if top > share {
            println!(
                "{name}: no state that was sampled exceeds {share} of the effort limit, one climbed to asks {top:.4}"
            );
        }
        holds &= found[j].exceeding == 0 && top <= share;
    }
    holds
}
