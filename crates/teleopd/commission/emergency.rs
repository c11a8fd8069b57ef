//! The emergency stop: it shows, it latches, a reset works after its release, and nothing moves. Does no IO and reads no
//! clock.

use super::ports::{Sample, Stop};
use super::session::{Session, require};
use messages::Mode;

/// Time after the person's answer within which the robot shows its button, s. A topic of ROS 2 may come once a second.
/// Assumption.
const SHOWS_WITHIN_S: f64 = 3.0;
/// Time between two looks, s.
const LOOK_S: f64 = 0.2;
/// Time for which a released emergency stop must stay latched, s. Assumption.
const LATCHED_S: f64 = 1.0;

pub fn run(run: &mut Session<'_>) -> Result<Vec<String>, Stop> {
    run.robot.begin()?;
    let mut samples = run.robot.watch(LATCHED_S)?;
    let start = samples[0].q_measured;
    let pressed = samples.iter().any(|sample| sample.emergency_stop);
    require(!pressed, || "the robot shows a pressed emergency stop already. Release it, and begin again".into())?;

    let hint = run.robot.button();
    run.person.confirm(&format!("Press the robot's emergency stop now{hint}. Then press Enter."))?;
    let shown = wait(run, &mut samples, |sample| sample.emergency_stop)?;
    require(shown, || {
        format!(
            "the robot's state does not show the pressed emergency stop within {SHOWS_WITHIN_S} s. Name its topic \
             (ros2.emergency_stop_topic), or let the driver report it"
        )
    })?;
    let stopped = wait(run, &mut samples, |sample| sample.driver_fault)? && run.robot.mode() == Some(Mode::Faulted);
    require(stopped, || format!("the pressed emergency stop does not latch. {}", run.robot.why()))?;
    require(!run.robot.reset()?, || "a reset was taken while the emergency stop was pressed".into())?;

    run.person.confirm("Release the emergency stop now. Then press Enter.")?;
    let released = wait(run, &mut samples, |sample| !sample.emergency_stop)?;
    require(released, || format!("the robot still shows the emergency stop {SHOWS_WITHIN_S} s later"))?;
    samples.extend(run.robot.watch(LATCHED_S)?);
    let latched = samples.last().is_some_and(|sample| sample.driver_fault) && run.robot.mode() == Some(Mode::Faulted);
    require(latched, || "the emergency stop did not stay latched after its release".into())?;
    require(run.robot.reset()?, || format!("the reset did not work. {}", run.robot.why()))?;
    samples.extend(run.robot.watch(LATCHED_S)?);

    let facts = run.facts;
    if let Some((joint, off)) = facts.strayed(&start, &samples, None) {
        let (name, off) = (&facts.model.joint_names[joint], facts.with_unit(joint, off));
        let band = facts.with_unit(joint, facts.stands(joint));
        return Err(Stop::Failed(format!(
            "{name} moved by {off} while the emergency stop was pressed or released, the bound is {band}. Find out what \
             moves it before you go on"
        )));
    }
    Ok(vec!["the emergency stop shows, latches, and can be reset after its release; no joint moved".into()])
}

/// Watches until `done`. Returns false if it does not come.
fn wait(run: &mut Session<'_>, samples: &mut Vec<Sample>, done: fn(&Sample) -> bool) -> Result<bool, Stop> {
    for _ in 0..(SHOWS_WITHIN_S / LOOK_S) as usize {
        samples.extend(run.robot.watch(LOOK_S)?);
        if samples.last().is_some_and(done) {
            return Ok(true);
        }
    }
    Ok(false)
}
