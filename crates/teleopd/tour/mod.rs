//! Five-minute tour: a motion file, the page, a Python client and a recording. Each step shows a command, runs it
//! and checks the result. The tour runs the real programs.

mod stage;
mod steps;

use crate::cli;
use crate::folder::Folder;
use rt::{Exit, Failure, Shutdown, out};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use stage::{Background, Stage, Stop};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Instant;

/// Polling period for signals while the tour waits for Enter, ns.
const LOOK_NS: i64 = 50_000_000;

struct Step {
    title: &'static str,
    shows: &'static str,
    work: fn(&mut Tour) -> Result<String, Stop>,
}

const STEPS: [Step; 4] = [
    Step {
        title: "A motion of your own",
        shows: "Any motion file moves the robot. This one waves with the left hand.",
        work: steps::own_motion,
    },
    Step {
        title: "A running instance in the browser",
        shows: "`up` starts the robot, `replay` is the person, and `view` shows both on a page.",
        work: steps::page,
    },
    Step {
        title: "A client in Python",
        shows: "A script of 27 lines publishes a person, and `teleopctl engage` lets the robot follow.",
        work: steps::python,
    },
    Step {
        title: "A recording",
        shows: "A run in virtual time is recorded, described in words, and played live: a recording is a motion too.\n\
                `demo --record FILE` records a live run.",
        work: steps::recording,
    },
];

const NEXT: &str = "\
Where to go next (README.md and docs say more):
  your own tracker    tools/clients/python/examples/own.py, or a webcam: tools/clients/python
  a suit or VMC       cargo run --release -p bridge -- mvn (or vmc)
  in words            cargo run --release -p replay -- say \"greet with your left hand\" --play
  as an operator      teleopctl watch, and calibrate NAME
  a robot             teleopd doctor, then SAFETY.md";

pub struct Tour {
    config: PathBuf,
    stage: Stage,
    yes: bool,
    /// `teleopd up`, running from the first step that needs it to the end.
    instance: Option<Background>,
}

pub fn run(options: &cli::Tour) -> Result<Exit, Failure> {
    if !options.yes && !std::io::stdin().is_terminal() {
        return Err(Failure::new(
            Exit::Usage,
            "tour asks before each step, but its input is not a terminal; --yes runs all steps without asking",
        ));
    }
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let folder = Folder::new(options.dir.as_deref(), "tour");
    let made = std::fs::create_dir_all(&folder.path).and_then(|()| folder.path.canonicalize());
    let path = made.map_err(|error| Failure::unwritable(&folder.path, &error))?;
    let stage = Stage { folder: path.clone(), shutdown: shutdown.clone() };
    let mut tour = Tour { config: options.config.clone(), stage, yes: options.yes, instance: None };
    out!("A tour in {} steps, five minutes at most. Its files go to {}.", STEPS.len(), path.display());
    let outcomes = tour.walk();
    let trouble = tour.close();
    if shutdown.requested() {
        return Ok(Exit::after(&shutdown));
    }
    judged(&outcomes, trouble)
}

enum Outcome {
    Done(String),
    Skipped(String),
    Failed(String),
}

impl Outcome {
    fn text(&self) -> String {
        match self {
            Self::Done(seen) => format!("done: {seen}"),
            Self::Skipped(why) => format!("skipped: {why}"),
            Self::Failed(why) => format!("FAILED: {why}"),
        }
    }
}

impl Tour {
    /// Runs all steps, or those before the user ends the tour.
    fn walk(&mut self) -> Vec<(&'static str, Outcome)> {
        let mut outcomes = Vec::new();
        let begun = Instant::now();
        match steps::programs(self) {
            Ok(()) => {}
            Err(Stop::Quit) => return outcomes,
            Err(Stop::Skip(why) | Stop::Fail(why)) => out!("a program is missing: {why}"),
        }
        for (n, step) in STEPS.iter().enumerate() {
            out!("\n{} of {}  {}\n{}", n + 1, STEPS.len(), step.title, step.shows);
            if !self.goes_on("Enter begins, q and Enter end the tour: ") {
                return outcomes;
            }
            let outcome = match (step.work)(self) {
                Ok(seen) => Outcome::Done(seen),
                Err(Stop::Skip(why)) => Outcome::Skipped(why),
                Err(Stop::Fail(why)) => Outcome::Failed(why),
                Err(Stop::Quit) => return outcomes,
            };
            out!("{}", outcome.text());
            outcomes.push((step.title, outcome));
        }
        out!("\nThe tour took {:.0} s.", begun.elapsed().as_secs_f64());
        out!("{NEXT}");
        outcomes
    }

    /// Returns true if the tour goes on. Asks for Enter unless `yes` is set.
    fn goes_on(&self, question: &str) -> bool {
        if self.yes {
            return !self.stage.shutdown.requested();
        }
        out!("{question}");
        let stdin = std::io::stdin();
        loop {
            if self.stage.shutdown.requested() {
                return false;
            }
            let mut waiting = [PollFd::new(&stdin, PollFlags::IN)];
            let wait = Timespec { tv_sec: 0, tv_nsec: LOOK_NS };
            if poll(&mut waiting, Some(&wait)).is_ok_and(|ready| ready > 0) {
                let mut line = String::new();
                let read = stdin.read_line(&mut line).is_ok_and(|bytes| bytes > 0);
                return read && !line.trim().eq_ignore_ascii_case("q");
            }
        }
    }

    /// Stops the instance if one runs. Returns the problem if it ended badly.
    fn close(&mut self) -> Option<String> {
        let ended = self.instance.take()?.end();
        let rested = ended.text.contains("released, at rest, and every process has ended");
        (ended.code != Some(0) || !rested).then(|| format!("teleopd up failed: {}", ended.last_line()))
    }
}

fn judged(outcomes: &[(&'static str, Outcome)], trouble: Option<String>) -> Result<Exit, Failure> {
    out!();
    for (n, (title, outcome)) in outcomes.iter().enumerate() {
        out!("{}  {title:<34} {}", n + 1, outcome.text());
    }
    let failed = outcomes.iter().filter(|(_, outcome)| matches!(outcome, Outcome::Failed(_))).count();
    match (failed, trouble) {
        (0, None) => Ok(Exit::Ok),
        (0, Some(trouble)) => Err(Failure::new(Exit::Failed, trouble)),
        (failed, trouble) => {
            let trouble = trouble.map_or(String::new(), |trouble| format!("; {trouble}"));
            Err(Failure::new(Exit::Failed, format!("{failed} of {} steps failed{trouble}", outcomes.len())))
        }
    }
}
