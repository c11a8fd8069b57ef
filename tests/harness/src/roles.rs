//! The program that uses the harness is also every process that it starts: those of teleopd, a client, and an
//! operator. So a fault can hit each of them alone.

use crate::running::publisher;
use crate::{Operator, SOON};
use client::Transport;
use instance::Instance;
use rt::{Exit, Failure};
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};

/// First argument that makes this program the publishing client.
pub const CLIENT: &str = "client";
/// First argument that makes this program the operator that holds the enable.
pub const OPERATOR: &str = "operator";

/// Starts this program again in the role [`CLIENT`] or [`OPERATOR`].
pub fn start(role: &str, instance: &Instance) -> Result<Child, Failure> {
    let program = std::env::current_exe().map_err(Failure::with(Exit::OsErr))?;
    let mut command = Command::new(program);
    command.arg(role).arg(instance.run_dir()).stdin(Stdio::null()).stdout(Stdio::null());
    command.spawn().map_err(|error| Failure::new(Exit::OsErr, format!("{role}: {error}")))
}

/// Runs this program in the role that its first argument names: a process of teleopd or its page, the client, or
/// the operator. Returns the exit code then.
pub fn main() -> Option<ExitCode> {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let role = arguments.first()?.as_str();
    if teleopd::PROCESSES.contains(&role) || role == "view" {
        return Some(teleopd::main());
    }
    let outcome = match arguments.as_slice() {
        [_, folder] if role == CLIENT => publish(Path::new(folder)),
        [_, folder] if role == OPERATOR => enable(Path::new(folder)),
        _ => return None,
    };
    Some(rt::finish(role, outcome))
}

/// Publishes the built-in motion in a loop until the process is killed.
fn publish(run_dir: &Path) -> Result<(), Failure> {
    rt::die_with_parent();
    let domain = Transport::Domain(Instance::unmade(run_dir).input_domain());
    let client = publisher(domain, &motion::builtin(), u64::from(std::process::id()));
    let client = client.map_err(Failure::with(Exit::Unavailable))?;
    client.set_engaged(true);
    loop {
        std::thread::park();
    }
}

/// Holds the enable until the process is killed.
fn enable(run_dir: &Path) -> Result<(), Failure> {
    rt::die_with_parent();
    let operator = Operator::connect(Instance::unmade(run_dir).operator_socket())?;
    // An enable that is held when control first sees it does not count. So wait until it was seen released.
    operator.wait(SOON, |_| true);
    operator.enable();
    loop {
        std::thread::park();
    }
}
