//! A link between an operator's machine and the robot's, over zenoh. Network data of a link is parsed in this process
//! alone, by the crate `link`.
//!
//! The robot's end is an ordinary client of the skeleton socket and of the operator socket. The operator's end serves the
//! same two sockets in a folder of its own, so every client works there unchanged. Persons and requests go up. Status and
//! feedback come down. Targets, commands and states of the robot stay on the robot's machine.

mod heartbeat;
mod keys;
mod operator;
mod pair;
mod person;
mod report;
mod robot;
mod wire;

pub use keys::{Keys, Name};
pub use operator::run as run_operator;
pub use pair::{pair_operator, pair_robot, show};
pub use robot::run as run_robot;
pub use wire::{Publisher, Slot, Wire, config, key, put};

use crate::cli::{Link, Pair};
use rt::Failure;

/// Runs a command of `bridge link`.
///
/// # Errors
/// Returns the message for the user.
pub fn run(command: &Link) -> Result<(), Failure> {
    match command {
        Link::Robot(args) => run_robot(args),
        Link::Operator(args) => run_operator(args),
        Link::Pair(Pair::Robot { name, keys }) => pair_robot(name, keys),
        Link::Pair(Pair::Operator { name, keys }) => pair_operator(name, keys),
        Link::Pair(Pair::Show { bundle }) => show(bundle),
    }
}

/// Checks addresses of the command line.
fn addresses(all: &[String]) -> Result<Vec<String>, Failure> {
    let secure = |address: &&String| address.starts_with("quic/") && !address.contains(['?', '#']);
    match all.iter().find(|address| !secure(address)) {
        None => Ok(all.to_vec()),
        Some(address) => {
            let text =
                format!("{address}: not an address of a link. Give quic/HOST:PORT: nothing else has certificates");
            Err(Failure::new(rt::Exit::Usage, text))
        }
    }
}
