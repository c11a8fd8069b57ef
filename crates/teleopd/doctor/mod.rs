//! Examines the machine and gives advice. Only reads: it neither changes nor creates anything on the machine.

mod facts;
mod following;
mod judge;
mod judge_place;
mod places;
mod robot;

pub use places::holder;

use crate::cli::Doctor;
use crate::programs::COLLISION;
use rt::{Exit, Failure, out};
use serde::Serialize;
use serde_json::json;
use std::io::Write;
use std::path::Path;
use std::process::Command;

messages::named! {
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Level {
        /// All is well.
        Ok => "ok",
        /// It works, but could work better.
        Note => "note",
        /// A simulated robot can do without it. A real robot cannot.
        Robot => "robot",
        /// The daemon does not run as configured.
        Problem => "problem",
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    pub check: &'static str,
    pub level: Level,
    pub found: String,
    /// Advice with a command. Empty if all is well.
    pub advice: String,
}

impl Finding {
    fn ok(check: &'static str, found: impl Into<String>) -> Self {
        Self { check, level: Level::Ok, found: found.into(), advice: String::new() }
    }

    fn note(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { check, level: Level::Note, found: found.into(), advice: advice.into() }
    }

    fn problem(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { check, level: Level::Problem, found: found.into(), advice: advice.into() }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Verdict {
    /// Checks that keep the daemon from running with any robot.
    problems: Vec<&'static str>,
    /// Further checks that a real robot requires.
    lacks: Vec<&'static str>,
}

impl Verdict {
    fn from_findings(findings: &[Finding]) -> Self {
        let checks = |level| findings.iter().filter(move |one| one.level == level).map(|one| one.check).collect();
        Self { problems: checks(Level::Problem), lacks: checks(Level::Robot) }
    }

    fn simulator(&self) -> bool {
        self.problems.is_empty()
    }

    fn robot(&self) -> bool {
        self.simulator() && self.lacks.is_empty()
    }

    fn exit(&self) -> Exit {
        match (self.simulator(), self.robot()) {
            (false, _) => Exit::Config,
            (true, false) => Exit::SimulatorOnly,
            (true, true) => Exit::Ok,
        }
    }

    fn text(&self) -> String {
        let simulator = match self.problems.as_slice() {
            [] => String::from("fine for the simulator"),
            problems => format!("not fine for the simulator: {}", problems.join(", ")),
        };
        let missing = [self.problems.as_slice(), &self.lacks].concat();
        let robot = match missing.as_slice() {
            [] => String::from("ready for a robot, as far as this program can check"),
            missing => format!("not ready for a robot: {}", missing.join(", ")),
        };
        format!("{simulator}\n{robot}\n")
    }
}

/// Prints every finding and the verdict, and a page about a robot that the command line chooses. The exit code tells the
/// verdict.
pub fn run(options: &Doctor) -> Result<Exit, Failure> {
    let mut findings = judge::judge(&facts::Facts::read(&options.place));
    // A file that does not load is a finding already.
    let chosen = options.place.robot.as_ref().and_then(|_| options.place.load().ok());
    let chosen = chosen.map(|loaded| (following::Following::measure(&loaded.model, loaded.weights.as_ref()), loaded));
    findings.extend(chosen.iter().flat_map(|(following, _)| following.findings()));
    let verdict = Verdict::from_findings(&findings);
    let text = if options.json {
        format!("{:#}\n", json!({ "simulator": verdict.simulator(), "robot": verdict.robot(), "findings": findings }))
    } else {
        findings_text(&findings) + &verdict.text()
    };
    let text = match (&chosen, options.json) {
        (Some((following, loaded)), false) => text + "\n" + &robot::page(loaded, following)?,
        _ => text,
    };
    // The reader may have closed the pipe. The exit code still tells the verdict.
    let _ = std::io::stdout().write_all(text.as_bytes());
    if options.meshes.is_none() && options.place.robot.is_some() && !options.json {
        out!("capsules and meshes: `doctor --meshes DIR` says how far the maker's meshes stick out of the capsules");
    }
    match &options.meshes {
        Some(meshes) if !capsules_cover(options, meshes)? => Ok(Exit::Failed),
        _ => Ok(verdict.exit()),
    }
}

/// Runs `collision cover`, which prints a page of its own. Returns true if every mesh lies in its capsules.
fn capsules_cover(options: &Doctor, meshes: &Path) -> Result<bool, Failure> {
    let loaded = options.place.load()?;
    let program = COLLISION.path()?;
    let mut command = Command::new(&program);
    command.arg("cover").arg(loaded.robot_file()).arg("--meshes").arg(meshes);
    options.urdf.iter().for_each(|urdf| {
        command.arg("--urdf").arg(urdf);
    });
    out!("");
    let status =
        command.status().map_err(|error| Failure::new(Exit::OsErr, format!("{}: {error}", program.display())))?;
    match status.code() {
        Some(0) => Ok(true),
        Some(1) => Ok(false),
        _ => Err(Failure::new(Exit::DataErr, "`collision cover` did not judge the capsules, for the reason above")),
    }
}

fn findings_text(findings: &[Finding]) -> String {
    let mut text = String::new();
    for finding in findings {
        text += &format!("{:<8} {:<18} {}\n", finding.level.name(), finding.check, finding.found);
        if !finding.advice.is_empty() {
            text += &format!("{:<27} -> {}\n", "", finding.advice);
        }
    }
    let count = |level| findings.iter().filter(|finding| finding.level == level).count();
    let [problem, robot, note, ok] = [Level::Problem, Level::Robot, Level::Note, Level::Ok].map(count);
    text + &format!("\nproblem {problem}, robot {robot}, note {note}, ok {ok}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdict_distinguishes_simulator_from_robot() {
        let note = Finding::note("machine", "virtual", "use another");
        let robot = Finding { level: Level::Robot, ..Finding::note("PREEMPT_RT", "no", "boot it") };
        let problem = Finding::problem("settings", "unknown key", "correct it");
        let verdict = |all: &[&Finding]| Verdict::from_findings(&all.iter().copied().cloned().collect::<Vec<_>>());
        let ready = verdict(&[&note]);
        assert_eq!((ready.exit(), ready.simulator(), ready.robot()), (Exit::Ok, true, true));
        assert!(ready.text().starts_with("fine for the simulator\nready for a robot"), "{}", ready.text());
        let simulator = verdict(&[&note, &robot]);
        assert_eq!((simulator.exit(), simulator.simulator(), simulator.robot()), (Exit::SimulatorOnly, true, false));
        assert_eq!(simulator.text(), "fine for the simulator\nnot ready for a robot: PREEMPT_RT\n");
        let neither = verdict(&[&robot, &problem]);
        assert_eq!((neither.exit(), neither.simulator(), neither.robot()), (Exit::Config, false, false));
        let text = neither.text();
        assert_eq!(text, "not fine for the simulator: settings\nnot ready for a robot: settings, PREEMPT_RT\n");
    }
}
