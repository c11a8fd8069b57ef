//! Examines the machine and says what to do about it. Reads only: nothing on the machine is changed or created.

mod facts;
mod judge;
mod judge_place;
mod places;

pub use places::holder;

use crate::cli::Doctor;
use crate::exit::{Exit, Failure};
use serde_json::{Value, json};
use std::io::Write;

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// As it should be.
    Ok,
    /// It works, but not as well as it could.
    Note,
    /// The daemon does not run as it is configured.
    Problem,
}

impl Level {
    const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Problem => "problem",
        }
    }
}

/// One thing that was examined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What was examined.
    pub check: &'static str,
    /// How much it matters.
    pub level: Level,
    /// What was found.
    pub found: String,
    /// What to do, with a command; empty where all is well.
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

    fn to_json(&self) -> Value {
        json!({ "check": self.check, "level": self.level.name(), "found": self.found, "advice": self.advice })
    }
}

/// Prints every finding; the exit code says whether one of them is a problem.
pub fn run(options: &Doctor) -> Result<Exit, Failure> {
    let findings = judge::judge(&facts::Facts::read(&options.place));
    let text = if options.json {
        let all: Vec<_> = findings.iter().map(Finding::to_json).collect();
        format!("{:#}\n", Value::Array(all))
    } else {
        words(&findings)
    };
    // Nobody may be listening; the exit code says the rest.
    let _ = std::io::stdout().write_all(text.as_bytes());
    let problems = findings.iter().any(|finding| finding.level == Level::Problem);
    Ok(if problems { Exit::Config } else { Exit::Ok })
}

fn words(findings: &[Finding]) -> String {
    let mut text = String::new();
    for finding in findings {
        text += &format!("{:<8} {:<18} {}\n", finding.level.name(), finding.check, finding.found);
        if !finding.advice.is_empty() {
            text += &format!("{:<27} -> {}\n", "", finding.advice);
        }
    }
    let count = |level| findings.iter().filter(|finding| finding.level == level).count();
    text + &format!("\nproblems {}, notes {}, ok {}\n", count(Level::Problem), count(Level::Note), count(Level::Ok))
}
