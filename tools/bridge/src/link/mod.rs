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
mod router;
mod wire;

pub use keys::{Keys, Name};
pub use operator::run as run_operator;
pub use pair::{pair_operator, pair_robot, pair_router, show};
pub use robot::run as run_robot;
pub use router::run as run_router;
pub use wire::{Publisher, Slot, Wire, config, key, send};

use crate::cli::{Link, Pair};
use messages::Service;
use rt::{Failure, out};
use std::net::ToSocketAddrs;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Silence of its status after which `control` counts as gone, ns. It also closes the operator socket of the operator's end.
const STATUS_GONE_NS: u64 = Service::Status.row().stale_after_ms as u64 * 1_000_000;
/// Variable from which zenoh reads the threads of its tasks.
const RUNTIME: &str = "ZENOH_RUNTIME";
const ONE_THREAD: &str = "(rx: (handover: net), tx: (handover: net), app: (handover: net))";

pub fn run(command: &Link) -> Result<(), Failure> {
    if !matches!(command, Link::Pair(_)) {
        share_one_thread()?;
    }
    match command {
        Link::Robot(args) => run_robot(args),
        Link::Operator(args) => run_operator(args),
        Link::Router(args) => run_router(args),
        Link::Pair(Pair::Robot { name, keys }) => pair_robot(name, keys),
        Link::Pair(Pair::Operator { name, keys }) => pair_operator(name, keys),
        Link::Pair(Pair::Router { keys }) => pair_router(keys),
        Link::Pair(Pair::Show { bundle }) => show(bundle),
    }
}

/// Starts this program again with zenoh's tasks on one thread, but for connecting. zenoh reads that from the environment alone.
///
/// By default its tasks are on five threads. Between them a datagram waits for the scheduler, 0.63 ms against 0.45 one way
/// (medians of four runs in turns, 2026-11-28). A connection that is made again on the same thread keeps the
/// others waiting: with half of the datagrams lost, 8 of 120 emergency stops had no answer within 2 s, against 1 of 120. A
/// value of the user's own stays.
fn share_one_thread() -> Result<(), Failure> {
    if std::env::var_os(RUNTIME).is_some() {
        return Ok(());
    }
    let failed = Failure::with(rt::Exit::OsErr);
    let own = std::env::current_exe().map_err(&failed)?;
    Err(failed(Command::new(own).args(std::env::args_os().skip(1)).env(RUNTIME, ONE_THREAD).exec()))
}

/// Tells which hosts have no address now. zenoh goes on asking for them in silence.
fn print_unknown(addresses: &[String]) {
    for address in addresses {
        let host = address.trim_start_matches("quic/");
        if let Err(error) = host.to_socket_addrs() {
            out!("bridge: {address}: {error}. It is tried again and again");
        }
    }
}

fn addresses(all: &[String]) -> Result<Vec<String>, Failure> {
    let secure = |address: &&String| {
        let port =
            address.strip_prefix("quic/").and_then(|host| host.rsplit_once(':')).map(|(_, port)| port.parse::<u16>());
        matches!(port, Some(Ok(_))) && !address.contains(['?', '#'])
    };
    let Some(address) = all.iter().find(|address| !secure(address)) else { return Ok(all.to_vec()) };
    let text = format!("{address}: not an address of a link. Give quic/HOST:PORT: nothing else has certificates");
    Err(Failure::new(rt::Exit::Usage, text))
}
