//! How a process ends: sysexits(3), so that a supervisor can tell a typo from a crash.

use rt::Shutdown;
use std::process::ExitCode;

/// SIGINT of signal(7).
const SIGINT: i32 = 2;

/// Why a command ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// All was well.
    Ok = 0,
    /// The run ended, and something in it was not as it must be.
    Failed = 1,
    /// Nothing was broken, and the robot held for most of the time in which it was meant to follow.
    Held = 2,
    /// `doctor`: fine for the simulator, and not ready for a robot.
    SimulatorOnly = 3,
    /// EX_USAGE: an argument that makes no sense.
    Usage = 64,
    /// EX_NOINPUT: a file to read is missing or malformed.
    NoInput = 66,
    /// EX_UNAVAILABLE: a service, socket or peer is missing.
    Unavailable = 69,
    /// EX_SOFTWARE: an operating system call failed that must not.
    Software = 70,
    /// EX_CANTCREAT: a file to write cannot be made.
    CantCreate = 73,
    /// EX_TEMPFAIL: another instance holds the place.
    TempFail = 75,
    /// EX_CONFIG: the configuration, robot file or weights are refused.
    Config = 78,
    /// Interrupted by SIGINT, after a stop at rest (128 + 2).
    Interrupted = 130,
}

impl Exit {
    /// Of a run that was asked to end, and did so in order.
    pub fn after(shutdown: &Shutdown) -> Self {
        if shutdown.signal() == Some(SIGINT) { Self::Interrupted } else { Self::Ok }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// A message for the user and the code to end with.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub exit: Exit,
    /// One sentence, with file, key, value and bound where there are such.
    pub text: String,
}

impl Failure {
    /// A failure with this code.
    pub fn new(exit: Exit, text: impl std::fmt::Display) -> Self {
        Self { exit, text: text.to_string() }
    }
}
