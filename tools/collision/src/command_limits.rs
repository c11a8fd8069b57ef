//! The command `collision limits`.

use crate::robot_texts;
use collision::error::CollisionError;
use collision::limits::{Found, Motion, Sampling, State, Survey};
use collision::report;
use nalgebra::Vector3;
use plant::Body;
use robot::Model;
use rt::out;
use std::path::PathBuf;

/// Options of `collision limits`.
#[derive(clap::Args)]
pub(crate) struct Limits {
    /// Robot file.
    robot: PathBuf,
    /// Point mass in each hand, kg.
    #[arg(long, default_value_t = 0.0, value_parser = rt::number, allow_negative_numbers = true)]
    payload_kg: f64,
    /// Links whose origins carry the payload [default: the centres under [payload] in the robot file].
    #[arg(long)]
    payload_at: Vec<String>,
    /// Number of random states.
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    states: u64,
    /// Seed of the random states.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Allowed share of the URDF's effort limit.
    #[arg(long, default_value_t = 0.85, value_parser = rt::number, allow_negative_numbers = true)]
    share: f64,
}

impl Limits {
    fn check(&self) -> Result<(), CollisionError> {
        for (key, value, most) in [("--share", self.share, 1.0), ("--payload-kg", self.payload_kg, 50.0)] {
            if !(value >= 0.0 && value <= most) || (value == 0.0 && key != "--payload-kg") {
                let cause = format!("{key} {value:?}, must be above 0 to {most}");
                return Err(CollisionError::content("arguments", cause));
            }
        }
        Ok(())
    }

    /// Reads the links, and adds what the hands carry: where the robot file says, or at the origins of the given links.
    fn links(&self, model: &Model) -> Result<Body, CollisionError> {
        let texts = &model.texts;
        let mut body = Body::from_text(&texts.toml_name, &texts.toml, &texts.urdf_name, &texts.urdf)?;
        for link in &self.payload_at {
            if !body.add_payload(link, self.payload_kg) {
                let cause = format!("--payload-at {link}: the robot has no such link");
                return Err(CollisionError::content(&texts.urdf_name, cause));
            }
        }
        if self.payload_at.is_empty() {
            for (hand, payload) in body.hands.into_iter().zip(&model.payload) {
                let place = payload.map_or_else(Vector3::zeros, |payload| payload.center);
                body.add_mass(hand, place, self.payload_kg);
            }
        }
        Ok(body)
    }
}

/// Prints the torques that motions at the limits in force may require, and those that postures require. Returns
/// false if holding a posture, sampled or climbed to, needs more than the share. For motions, whole-body
/// control proves that they do not.
pub(crate) fn limits(options: &Limits) -> Result<bool, CollisionError> {
    options.check()?;
    let (toml, urdf) = robot_texts(&options.robot)?;
    let model = Model::from_text(&toml.0, &toml.1, &urdf.0, &urdf.1)?;
    let sampling = Sampling { states: options.states, seed: options.seed, share: options.share };
    let survey = Survey::new(&model, options.links(&model)?, sampling);
    out!("All joints at their limits in force at once, without whole-body control:");
    let _ = surveyed(&survey, &Motion::in_force(&model));
    out!("At rest:");
    let (found, climbed) = surveyed(&survey, &Motion::AT_REST);
    // Every joint has its say, also after one that does not hold.
    let weak: Vec<usize> = (0..model.count).filter(|j| !holds(&survey, *j, &found[*j], climbed[*j].as_ref())).collect();
    out!("{}", verdict(&model, options, &weak));
    Ok(weak.is_empty())
}

/// Returns the last line of the output.
fn verdict(model: &Model, options: &Limits, weak: &[usize]) -> String {
    let (share, load_kg) = (options.share, options.payload_kg);
    if weak.is_empty() {
        let states = options.states;
        return format!(
            "holds: with {load_kg} kg in each hand, none of {states} postures needs more than {share} of an effort limit"
        );
    }
    let names: Vec<&str> = weak.iter().map(|j| model.joint_names[*j].as_str()).collect();
    format!(
        "DOES NOT HOLD: with {load_kg} kg in each hand, some postures need more than {share} of the effort limit of {}. teleopd \
         refuses these postures. Narrow the ranges under [tighten], or carry less.",
        names.join(", ")
    )
}

/// Prints and returns the results of sampling and climbing.
fn surveyed(survey: &Survey<'_>, motion: &Motion) -> (Vec<Found>, Vec<Option<State>>) {
    let found = survey.pass(motion);
    let climbed = survey.climb_all(&found, motion);
    out!("{}", report::table(survey, motion, &found, &climbed));
    out!("{}", report::worst_cases(survey, motion, &found));
    (found, climbed)
}

/// Returns true if every posture keeps the share of joint `j`. Prints a message otherwise.
fn holds(survey: &Survey<'_>, j: usize, found: &Found, climbed: Option<&State>) -> bool {
    let (name, share, states) = (&survey.model.joint_names[j], survey.sampling.share, survey.sampling.states as f64);
    let top = climbed.map_or(0.0, |state| state.bias / survey.effort(j));
    if found.exceeding > 0 {
        let percent = found.exceeding as f64 / states * 100.0;
        out!("{name}: {percent:.4} % of the postures need more than {share} of the effort limit to be held");
    } else if top > share {
        out!(
            "{name}: no posture that was sampled needs more than {share} of the effort limit, one climbed to {top:.4}"
        );
    }
    found.exceeding == 0 && top <= share
}
