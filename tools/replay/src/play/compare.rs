//! Shows that the stages reproduce a recording from its inputs, bit for bit.

use crate::cli::Cli;
use config::Overrides;
use rt::{Exit, Failure, out};
use std::path::Path;

pub fn run(cli: &Cli, recording: &Path) -> Result<(), Failure> {
    let loaded =
        config::load(&cli.config, Overrides::robot(cli.robot.as_ref())).map_err(Failure::with(Exit::Config))?;
    let found = record::compare(recording, &loaded).map_err(Failure::with(Exit::NoInput))?;
    for (what, counts) in [("targets", found.targets), ("commands", found.commands), ("statuses", found.statuses)] {
        let record::Counts { compared, missing, different } = counts;
        out!("{what:<9} {compared:>9} compared, {missing} missing, {different} different");
    }
    let name = recording.display();
    let mut wrong: Vec<_> = found.flaws.iter().map(|flaw| format!("{name}: {flaw}")).collect();
    wrong.extend(found.first.iter().map(|first| format!("{name}: the first difference is {first}")));
    if !found.equal() {
        return Err(Failure::new(Exit::Failed, wrong.join("\nreplay: ")));
    }
    out!("equal, bit for bit");
    Ok(())
}
