//! Starts the processes without systemd. Stops them with the robot at rest on a signal, or when one of them ends.

use crate::children::{Children, Output, instance_in, refuse_second};
use crate::cli;
use crate::demo::missing;
use crate::process::may_lack_realtime;
use crate::processes::PROCESSES;
use crate::programs::{REPLAY, TELEOPCTL, run_dir_option};
use crate::recorder::Recorder;
use config::{DriverKind, Loaded};
use instance::Instance;
use messages::Mode;
use operator::OperatorSession;
use rt::{Exit, Failure};
use rt::{Shutdown, out};
use std::time::Duration;

/// Polling period of the children.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time until a released robot is at rest, with a margin. The longest stop takes 0.5 s and a slow servo
/// settles in 0.64 s. Rest is measured over 0.1 s.
const REST_WITHIN: Duration = Duration::from_secs(2);

/// Runs until a signal, or until one process ends.
pub fn run(options: &cli::Up) -> Result<Exit, Failure> {
    let place = &options.place;
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let loaded = place.load()?;
    let instance = instance_in(&place.run_dir)?;
    refuse_second(&instance)?;
    // Starts before the other processes, so that it sees their first messages. Is dropped after them.
    let mut recorder = Recorder::start_if(options.record.as_deref(), &instance, place)?;
    let output = if options.verbose { Output::All } else { Output::Warnings };
    let mut children = Children::start(&instance, place, output)?;
    introduce(&loaded, place);
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
    let rested = release(&instance);
    let mut trouble = children.stop();
    if !rested {
        let within = REST_WITHIN.as_secs();
        trouble.push(format!("the robot was not measured at rest within {within} s; the driver was ended anyway"));
    }
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

fn introduce(loaded: &Loaded, place: &cli::InstanceArgs) {
    let (settings, run_dir) = (&loaded.settings, place.run_dir.display());
    let at = run_dir_option(&place.run_dir);
    let kind = match settings.driver.kind {
        DriverKind::Sim => "simulated",
        DriverKind::Robot => "real",
    };
    out!("running   {} processes in {run_dir} (up -v prints what they log)", PROCESSES.len());
    let by = loaded.driver_program().map_or(String::new(), |program| format!(", driven by {}", program.display()));
    out!("robot     {kind} {}{by}, by {}", loaded.model.name, place.config.display());
    out!("publish   a person in {run_dir}: {} builtin --loop{at}", REPLAY.typed());
    let missing = missing(&settings.realtime);
    if missing.is_empty() || may_lack_realtime(settings) {
        out!("engage    {} engage{at}", TELEOPCTL.typed());
    } else {
        let missing = missing.join(", ");
        out!("engage    is refused without {missing}; a simulated robot needs up --engage-without-realtime");
    }
    out!("stop      Ctrl-C here: the robot stops, then every process ends");
    out!("READY");
}

/// Releases the enable and waits until the command and the measured robot are at rest. Control does the same again when
/// it receives its request to end. Returns true if the robot came to rest, or if control no longer answers.
fn release(instance: &Instance) -> bool {
    let Ok(operator) = OperatorSession::connect(&instance.operator_socket()) else { return true };
    operator.release();
    let without_authority = |mode| mode == Mode::Disengaged as u32 || mode == Mode::Faulted as u32;
    let rested = operator.wait(REST_WITHIN, |status| without_authority(status.mode) && status.moving == 0);
    rested || operator.is_cut_off()
}
