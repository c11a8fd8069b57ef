//! Starts the four processes without systemd, and stops them with the robot at rest when asked to, or when one ends.

use crate::children::{Children, instance_in, refuse_second};
use crate::cli;
use crate::exit::{Exit, Failure};
use crate::operate::Operator;
use crate::recorder::Recorder;
use messages::Mode;
use pipeline::Instance;
use rt::{Shutdown, out};
use std::time::Duration;

/// How often the children are looked after.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time for a released robot to come to rest: four times the longest stop (0.5 s).
const REST_WITHIN: Duration = Duration::from_secs(2);

/// Runs until a signal, or until one process ends.
pub fn run(options: &cli::Up) -> Result<Exit, Failure> {
    let place = &options.place;
    let shutdown = Shutdown::on_signals().map_err(|error| Failure::new(Exit::Software, error))?;
    let instance = instance_in(&place.run_dir)?;
    refuse_second(&instance)?;
    // Before the others, so that it sees their first messages; it is dropped after them.
    let mut recorder = Recorder::start_if(options.record.as_deref(), &instance, place)?;
    let mut children = Children::start(&instance, place, false)?;
    out!("teleopd: ready in {}", instance.run_dir().display());
    out!("teleopd: publish skeletons with `replay`, then `teleopctl engage`; Ctrl-C stops everything");
    let ended = loop {
        if shutdown.requested() {
            break None;
        }
        if let Some(ended) = children.ended() {
            break Some(ended);
        }
        if let Some(recorder) = &mut recorder {
            recorder.watch();
        }
        std::thread::sleep(LOOK);
    };
    release(&instance);
    let mut trouble = children.stop();
    trouble.extend(recorder.and_then(|mut recorder| recorder.stop()));
    if let Some((name, status)) = ended {
        return Err(Failure::new(Exit::Failed, format!("{name} ended by itself ({status}); everything was stopped")));
    }
    if !trouble.is_empty() {
        return Err(Failure::new(Exit::Failed, trouble.join("; ")));
    }
    out!("teleopd: released, at rest, and every process has ended");
    Ok(Exit::after(&shutdown))
}

/// Withdraws whatever authority there is, and waits for rest; control does the same again when it is told to end.
fn release(instance: &Instance) {
    if let Ok(mut operator) = Operator::connect(&instance.operator_socket()) {
        operator.release();
        operator
            .wait(REST_WITHIN, |status| status.mode == Mode::Disengaged as u32 || status.mode == Mode::Faulted as u32);
    }
}
