//! Shows that the stages make of a recording's inputs what was recorded, bit for bit.

use crate::{Cli, EX_NOINPUT, Failure};
use pipeline::Overrides;
use std::path::Path;

/// Compares, and says what was compared.
pub fn run(cli: &Cli, recording: &Path) -> Result<(), Failure> {
    let loaded = pipeline::load(&cli.config, Overrides::default()).map_err(Failure::config)?;
    let found = record::compare(recording, &loaded).map_err(|error| Failure(EX_NOINPUT, error.to_string()))?;
    for (what, (compared, differ)) in
        [("targets", found.targets), ("commands", found.commands), ("statuses", found.statuses)]
    {
        println!("{what:<9} {compared:>9} compared, {differ} differ");
    }
    if let Some(why) = &found.broken_off {
        return Err(Failure::failed(format!("{}: {why}", recording.display())));
    }
    if let Some(first) = &found.first {
        return Err(Failure::failed(format!("{}: the first that differs is {first}", recording.display())));
    }
    if !found.equal() {
        return Err(Failure::failed(format!("{}: holds no target or no command to compare", recording.display())));
    }
    println!("equal, bit for bit");
    Ok(())
}
