//! The end of every program: exit codes from sysexits(3), and an error with its text. A supervisor can tell a
//! configuration error from a crash.

use crate::{Shutdown, err};
use std::path::Path;
use std::process::ExitCode;

/// SIGINT of signal(7).
const SIGINT: i32 = 2;

/// The reason a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// All was well.
    Ok = 0,
    /// The run ended, and a check failed.
    Failed = 1,
    /// Nothing failed, but the robot held for most of the time in which it should have followed.
    Held = 2,
    /// `doctor`: fine for the simulator, not ready for a robot.
    SimulatorOnly = 3,
    /// EX_USAGE: an argument is invalid.
    Usage = 64,
    /// EX_DATAERR: the content of a file is invalid.
    DataErr = 65,
    /// EX_NOINPUT: a file to read is missing or malformed.
    NoInput = 66,
    /// EX_UNAVAILABLE: a service, socket or peer is missing.
    Unavailable = 69,
    /// EX_SOFTWARE: an operating system call failed that must not fail.
    Software = 70,
    /// EX_OSERR: a process cannot be started, or a signal handler not installed.
    OsErr = 71,
    /// EX_CANTCREAT: an output file cannot be created.
    CantCreate = 73,
    /// EX_TEMPFAIL: another instance uses this folder.
    TempFail = 75,
    /// EX_CONFIG: the configuration, robot file or weights are invalid.
    Config = 78,
    /// Interrupted by SIGINT, after a stop at rest (128 + 2).
    Interrupted = 130,
}

impl Exit {
    /// Exit code of a run that received a request to end and ended in order.
    pub fn after(shutdown: &Shutdown) -> Self {
        if shutdown.signal() == Some(SIGINT) { Self::Interrupted } else { Self::Ok }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

impl From<()> for Exit {
    fn from((): ()) -> Self {
        Self::Ok
    }
}

impl From<bool> for Exit {
    fn from(passed: bool) -> Self {
        if passed { Self::Ok } else { Self::Failed }
    }
}

/// Longest text of a failure, characters: 20 lines of a terminal of 80 by 24.
const SHOWN_MAX: usize = 1600;

/// Returns a text that fits into a terminal and does not control it. A longer one loses its middle, but not its advice.
fn shown(text: &str) -> String {
    let clean = |c: char| if c.is_control() && !matches!(c, '\n' | '\t') { '?' } else { c };
    let all: Vec<char> = text.chars().map(clean).collect();
    let [begin, end] = [&all[..all.len().min(SHOWN_MAX * 3 / 4)], &all[all.len().saturating_sub(SHOWN_MAX / 4)..]];
    if all.len() > SHOWN_MAX { [begin, &[' ', '.', '.', '.', ' '], end].concat() } else { all }.into_iter().collect()
}

/// A message for the user, with the exit code.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
pub struct Failure {
    /// Exit code.
    pub exit: Exit,
    /// One sentence. Names file, key, value and bound where they exist.
    pub text: String,
}

impl Failure {
    /// A failure with this code.
    pub fn new(exit: Exit, text: impl std::fmt::Display) -> Self {
        Self { exit, text: shown(&text.to_string()) }
    }

    /// An output file cannot be created or written.
    pub fn unwritable(path: &Path, error: &std::io::Error) -> Self {
        Self::new(Exit::CantCreate, crate::unwritable(path, error))
    }

    /// Checks before a run that its end can write this file. Its content stays.
    pub fn check_writable(path: &Path) -> Result<(), Self> {
        let opened = match std::fs::metadata(path) {
            // Opening a pipe would wait for a reader. A device has no contents to lose.
            Ok(found) if !found.is_file() && !found.is_dir() => Ok(()),
            Ok(_) => std::fs::OpenOptions::new().write(true).open(path).map(drop),
            Err(_) => std::fs::File::create(path).and_then(|_| std::fs::remove_file(path)),
        };
        opened.map_err(|error| Self::unwritable(path, &error))
    }

    /// Returns a function that gives every error this code.
    pub fn with<E: std::fmt::Display>(exit: Exit) -> impl Fn(E) -> Self + Copy {
        move |error| Self::new(exit, error)
    }
}

/// Ends the program of this name. Prints its failure, and returns its exit code.
pub fn finish(program: &str, outcome: Result<impl Into<Exit>, impl Into<Failure>>) -> ExitCode {
    match outcome {
        Ok(exit) => exit.into().into(),
        Err(failure) => {
            let Failure { exit, text } = failure.into();
            err!("{program}: {text}");
            exit.into()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failure_of_any_file_fits_into_a_terminal_and_does_not_control_it() {
        let long =
            Failure::new(Exit::DataErr, format!("a.csv: \x1b[2J{} is no number; write one", "é".repeat(900_000)));
        assert!(long.text.starts_with("a.csv: ?[2J") && long.text.ends_with(" is no number; write one"), "{long}");
        assert!(long.text.chars().count() < 20 * 80 + 10 && long.text.contains("é ... é"), "{long}");
        assert_eq!(Failure::new(Exit::Usage, "two\n\tlines").text, "two\n\tlines");
    }
}
