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
        Self { exit, text: text.to_string() }
    }

    /// An output file cannot be created or written.
    pub fn unwritable(path: &Path, error: &std::io::Error) -> Self {
        Self::new(Exit::CantCreate, crate::unwritable(path, error))
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
