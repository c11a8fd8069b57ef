//! A router: a session of zenoh that passes datagrams on between a robot and its operators, and reads none.

use super::keys::Keys;
use super::wire::{Wire, router_config};
use crate::cli::LinkRouter;
use rt::{Exit, Failure, Shutdown, out};
use std::time::Duration;

/// Time between two looks for a signal.
const LOOK: Duration = Duration::from_millis(100);

pub fn run(args: &LinkRouter) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let keys = Keys::read_router(&args.bundle, &args.operators)?;
    if keys.operators.is_empty() {
        let text = format!("{}: no operator. Copy the folder of the robot's keys", args.operators.display());
        return Err(Failure::new(Exit::Config, text));
    }
    let _wire = Wire::open(&router_config(&keys, &super::addresses(&args.listen)?), &shutdown, || ())?;
    let admitted: Vec<_> = keys.operators.iter().map(|(name, _)| name.as_str()).collect();
    out!("bridge: router of robot {} admits {}", keys.robot, admitted.join(", "));
    while !shutdown.requested() {
        std::thread::sleep(LOOK);
    }
    Ok(())
}
