//! Each joint alone: it moves, the right way, as far as commanded, and the others stand. Does no IO and reads no clock.

use super::description;
use super::path::Path;
use super::ports::{Facts, Sample, Stop};
use super::session::Session;
use messages::{JOINTS_MAX, Mode};

/// Time in which a joint settles after its ramp, s: the swing of a servo of 1 Hz has died. Assumption.
const SETTLES_S: f64 = 0.5;
/// A measured motion below this is noise, rad or m: twice the largest noise of an encoder of 17 bits (`driver`).
const NOISE: f64 = 8e-4;

pub fn run(run: &mut Session<'_>) -> Result<Vec<String>, Stop> {
    let mut found = Vec::new();
    for joint in 0..run.facts.model.count {
        found.push(one(run, joint)?);
    }
    Ok(found)
}

fn one(run: &mut Session<'_>, joint: usize) -> Result<String, Stop> {
    let facts = run.facts;
    let name = &facts.model.joint_names[joint];
    let q = last(&run.robot.watch(SETTLES_S)?).q;
    let by = facts.travel(&q, joint)?;
    run.person.confirm(&format!(
        "{name} ({} of {}) will move by {} and back: watch {}. Enter moves it.",
        joint + 1,
        facts.model.count,
        facts.with_unit(joint, by),
        description::link(&facts.model, joint)
    ))?;
    run.robot.engage()?;
    let there = play(run, &Path::ramp(q, joint, by, facts.speed(joint)))?;
    let mut to = q;
    to[joint] += by;
    let back = play(run, &Path::ramp(to, joint, -by, facts.speed(joint)))?;
    run.robot.release()?;
    let sight = description::visible_motion(&facts.model, &q, joint, by);
    run.person.saw(
        &format!("You should have seen this, and then the way back: {sight}. Did you?"),
        &format!("the person did not see {name} move as the model says: {sight}"),
    )?;
    Ok(format!("{name}: {} commanded, {} measured there, {} back", facts.with_unit(joint, by), there, back))
}

/// Plays a ramp, and judges it. Returns the measured travel in words.
fn play(run: &mut Session<'_>, path: &Path) -> Result<String, Stop> {
    let before = run.robot.watch(SETTLES_S / 2.0)?;
    run.robot.play(path)?;
    let samples = run.robot.watch(path.length_s() + run.facts.delay_s + run.facts.age_s + SETTLES_S)?;
    let stopped = (run.robot.mode() != Some(Mode::Engaged)).then(|| run.robot.why());
    judge(run.facts, path, &last(&before).q_measured, &samples).map_err(|why| {
        Stop::Failed(match &stopped {
            Some(stopped) => format!("{why}. Control stopped the robot: {stopped}"),
            None => why,
        })
    })?;
    if let Some(stopped) = stopped {
        return Err(Stop::Failed(format!("control stopped the robot: {stopped}")));
    }
    let joint = path.joint;
    Ok(run.facts.with_unit(joint, last(&samples).q_measured[joint] - last(&before).q_measured[joint]))
}

fn last(samples: &[Sample]) -> Sample {
    samples[samples.len() - 1]
}

/// Judges the samples of a ramp that began at the measured posture `before`.
fn judge(facts: &Facts, path: &Path, before: &[f64; JOINTS_MAX], samples: &[Sample]) -> Result<(), String> {
    let (joint, name) = (path.joint, &facts.model.joint_names[path.joint]);
    let end = last(samples);
    let moved = end.q_measured[joint] - before[joint];
    let length = |length: f64| facts.with_unit(joint, length);
    if moved * path.by < 0.0 && moved.abs() > NOISE {
        return Err(format!(
            "{name} was commanded {} and is measured to move the other way, by {}: its sign differs from the robot's",
            length(path.by),
            length(moved)
        ));
    }
    let still = moved.abs() < path.by.abs() / 2.0;
    let others = (0..facts.model.count).filter(|other| *other != joint);
    let most = others.map(|j| (j, end.q_measured[j] - before[j])).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    if let Some((other, off)) = most.filter(|(_, off)| still && off.abs() > NOISE && off.abs() > moved.abs()) {
        let (other, off) = (&facts.model.joint_names[other], facts.with_unit(other, off));
        return Err(format!(
            "{name} was commanded, and {other} is measured to move, by {off}: their names are swapped"
        ));
    }
    if let Some((other, off)) = facts.strayed(before, samples, Some(joint)) {
        let (band, off) = (facts.with_unit(other, facts.stands(other)), facts.with_unit(other, off));
        let other = &facts.model.joint_names[other];
        return Err(format!("{name} was commanded, and {other} moved by {off} too: the bound is {band}"));
    }
    let bound = facts.differs(joint);
    // Written so that NaN differs.
    let fits = (moved - path.by).abs() <= bound;
    if !fits {
        return Err(format!(
            "{name} was commanded {} and is measured to move by {}: they may differ by {} (safety.tracking_error_rad, or tracking_error_m)",
            length(path.by),
            length(moved),
            length(bound)
        ));
    }
    Ok(())
}
