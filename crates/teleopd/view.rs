//! Shows a running instance in a browser.

use crate::children::instance_in;
use crate::cli;
use crate::exit::{Exit, Failure};
use crate::recorder;
use pipeline::Instance;
use rt::Shutdown;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use view::{Server, ViewError};

/// How often the signals are looked for.
const LOOK: Duration = Duration::from_millis(50);

/// Serves until a signal.
pub fn run(options: &cli::View) -> Result<Exit, Failure> {
    if let Some(recording) = &options.recording {
        return recorded(options, recording);
    }
    let shutdown = Shutdown::on_signals().map_err(|error| Failure::new(Exit::Software, error))?;
    let place = &options.place;
    let instance = instance_in(&place.run_dir)?;
    let server = start(&instance, place, options.port)?;
    out!(
        "teleopd: shows {} at {}\nteleopd: who knows this address may operate the robot; Ctrl-C ends the page, not the \
         instance",
        instance.run_dir().display(),
        server.address()
    );
    while !shutdown.requested() {
        if server.has_ended() {
            return Err(Failure::new(Exit::Software, "the server of the page ended by itself"));
        }
        std::thread::sleep(LOOK);
    }
    Ok(Exit::after(&shutdown))
}

/// Becomes the program that reads recordings.
fn recorded(options: &cli::View, recording: &Path) -> Result<Exit, Failure> {
    let mut command = Command::new(recorder::program()?);
    command.arg("--view").arg(recording).arg("--port").arg(options.port.to_string());
    command.arg("--config").arg(&options.place.config);
    Err(Failure::new(Exit::Software, command.exec()))
}

/// A server for `instance` as it was started at `place`.
pub fn start(instance: &Instance, place: &cli::Place, port: u16) -> Result<Server, Failure> {
    let loaded = pipeline::load(&place.config, place.overrides()).map_err(|error| Failure::new(Exit::Config, error))?;
    Server::live(instance, &loaded.model, port).map_err(|error| match error {
        ViewError::Bus(error) => crate::process::bus_failure(error),
        error => Failure::new(Exit::Unavailable, error),
    })
}
