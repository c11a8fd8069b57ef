//! Sends the load of a hand, and waits for the answer of `control`.

use crate::cli::PayloadArgs;
use crate::{EFFECT_WITHIN, HEARTBEAT};
use messages::{PayloadOrder, Status};
use operator::{Client, OperatorError};
use rt::{err, out};
use std::path::Path;
use std::time::Instant;

/// Returns true if `control` accepted it.
pub fn send(client: &mut Client, run_dir: &Path, args: &PayloadArgs) -> Result<bool, OperatorError> {
    let answers = |status: &Status| (status.payloads_taken, status.payloads_refused);
    let before = answers(&client.heartbeat()?);
    let order = PayloadOrder { mass_kg: args.mass_kg, centre_m: args.centre };
    client.payload(args.hand as usize, &order);
    let begun = Instant::now();
    loop {
        let status = client.heartbeat()?;
        let (taken, refused) = answers(&status);
        if refused != before.1 {
            let names = instance::read_names(run_dir);
            let why = explain::payload_refused(&status, &names).unwrap_or_default();
            err!("teleopctl: refused: {why}. The payload stays {}", explain::payload(&status));
            return Ok(false);
        }
        if taken != before.0 {
            out!("the hands carry   {}", explain::payload(&status));
            if status.payload_kg[args.hand as usize].to_bits() != args.mass_kg.to_bits() {
                err!("teleopctl: another operator set another payload at the same time");
                return Ok(false);
            }
            if let Some(why) = explain::payload_refused(&status, &instance::read_names(run_dir)) {
                err!("teleopctl: {why}");
                return Ok(false);
            }
            return Ok(true);
        }
        if begun.elapsed() > EFFECT_WITHIN {
            err!("teleopctl: control did not answer within {} s; the payload is unknown", EFFECT_WITHIN.as_secs());
            return Ok(false);
        }
        std::thread::sleep(HEARTBEAT);
    }
}
