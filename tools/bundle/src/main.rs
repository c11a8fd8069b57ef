//! The daemon and the programs beside it as one executable, which holds what they share once. It acts by the name by which it
//! is started, or by its first argument: `teleopd replay FILE` is `replay FILE`. A wheel has this one.

use rt::{Exit, Failure};
use std::ffi::OsStr;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, ExitCode};

/// Counts the loops' allocations after READY, as in `teleopd`.
#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// The main function of a program.
type Main = fn() -> ExitCode;

/// Names of the other programs, and of the tasks of `replay` that a link may name.
const PROGRAMS: [(&str, Main); 6] = [
    ("teleopctl", teleopctl::main),
    ("record", record::main),
    ("replay", replay::main),
    ("batch", replay::main),
    ("keyposes", replay::main),
    ("say", replay::main),
];

fn main() -> ExitCode {
    rt::abort_on_panic();
    let mut arguments = std::env::args_os();
    if let Some(program) = arguments.next().as_deref().and_then(named) {
        return program();
    }
    let Some(first) = arguments.next().filter(|first| named(first).is_some()) else { return teleopd::main() };
    // Each program reads the arguments of its process, so it starts again by that name.
    let cause = match std::env::current_exe() {
        Ok(own) => Command::new(own).arg0(&first).args(arguments).exec(),
        Err(cause) => cause,
    };
    let failure = Failure::new(Exit::OsErr, format!("{} cannot be started: {cause}", Path::new(&first).display()));
    rt::finish("teleopd", Err::<(), _>(failure))
}

/// Returns the program of this name, with or without the `teleop-` of installed programs and a folder.
fn named(name: &OsStr) -> Option<Main> {
    let name = Path::new(name).file_name()?.to_str()?;
    let name = name.strip_prefix("teleop-").unwrap_or(name);
    PROGRAMS.iter().find(|(known, _)| *known == name).map(|(_, program)| *program)
}
