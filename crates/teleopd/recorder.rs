//! The recorder of `up` and `demo`. It is a child process that only reads. If it fails, the robot goes on.

use crate::cli::InstanceArgs;
use crate::process::realtime::keep_off;
use crate::processes::END_WITHIN;
use crate::programs::RECORD;
use crate::starter::{ReadySocket, ended_within};
use instance::Instance;
use rt::err;
use rt::{Exit, Failure};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Longest time until the recorder reads. It loads the settings and opens the services.
const READY_WITHIN: Duration = Duration::from_secs(10);

/// The running recorder.
pub struct Recorder {
    child: Child,
    /// True once this process has reported that the recorder ended by itself.
    is_reported: bool,
}

impl Recorder {
    /// Starts the recorder if a file is given, and waits until it reads.
    pub fn start_if(file: Option<&Path>, instance: &Instance, place: &InstanceArgs) -> Result<Option<Self>, Failure> {
        file.map(|file| Self::start(file, instance, place)).transpose()
    }

    /// Starts the recorder and waits until it reads.
    pub fn start(file: &Path, instance: &Instance, place: &InstanceArgs) -> Result<Self, Failure> {
        refuse_unwritable(file)?;
        let software = |error: std::io::Error| Failure::new(Exit::Software, format!("recorder: {error}"));
        let path = instance.run_dir().join(format!("record-{}.sock", std::process::id()));
        let ready = ReadySocket::bind(path).map_err(software)?;
        let mut command = Command::new(RECORD.path()?);
        command.arg(file).arg("--full");
        place.hand_on(&mut command, instance);
        // If this process is killed, the recorder ends as on a signal. It must not record people without a request.
        command.arg("--child-of").arg(std::process::id().to_string());
        // The recorder gets its own process group, so that Ctrl-C ends the other processes first.
        command.stdin(Stdio::null()).env("NOTIFY_SOCKET", &ready.path).process_group(0);
        let mut recorder = Self { child: spawned_aside(command, place).map_err(software)?, is_reported: false };
        recorder.wait_ready(&ready).map(|()| recorder)
    }

    fn wait_ready(&mut self, ready: &ReadySocket) -> Result<(), Failure> {
        let give_up = Instant::now() + READY_WITHIN;
        while Instant::now() < give_up {
            if ready.hears_ready() {
                return Ok(());
            }
            if let Ok(Some(status)) = self.child.try_wait() {
                self.is_reported = true;
                let exit = match status.code() {
                    Some(73) => Exit::CantCreate,
                    Some(78) => Exit::Config,
                    _ => Exit::Unavailable,
                };
                return Err(Failure::new(exit, format!("the recorder ended before it was ready ({status})")));
            }
        }
        Err(Failure::new(Exit::Unavailable, format!("the recorder was not ready within {} s", READY_WITHIN.as_secs())))
    }

    /// Reports once that the recorder ended by itself. The robot goes on.
    pub fn watch(&mut self) {
        if !self.is_reported
            && let Ok(Some(status)) = self.child.try_wait()
        {
            self.is_reported = true;
            err!("teleopd: the recorder ended by itself ({status}); the instance continues");
        }
    }

    /// Stops the recorder after it has read everything. Returns the problem if it ended badly.
    pub fn stop(&mut self) -> Option<String> {
        let judged = |status: ExitStatus| (!status.success()).then(|| format!("the recorder failed ({status})"));
        if let Ok(Some(status)) = self.child.try_wait() {
            return judged(status).or_else(|| Some("the recorder had ended already".to_owned()));
        }
        let Some(status) = ended_within(&mut self.child, END_WITHIN) else {
            return Some(format!("the recorder did not end within {} s and was killed", END_WITHIN.as_secs()));
        };
        self.is_reported = true;
        judged(status)
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Refuses a file that exists or cannot be created. The recorder refuses it too, but then both programs print a message.
fn refuse_unwritable(file: &Path) -> Result<(), Failure> {
    let made = std::fs::OpenOptions::new().write(true).create_new(true).open(file);
    made.and_then(|_| std::fs::remove_file(file)).map_err(|error| Failure::unwritable(file, &error))
}

/// Starts `command` off the cores of the real-time processes. A child inherits the cores of the thread that starts it.
fn spawned_aside(mut command: Command, place: &InstanceArgs) -> std::io::Result<Child> {
    let settings = config::load(&place.config, place.overrides()).ok().map(|loaded| loaded.settings.realtime);
    let spawned = std::thread::scope(|scope| {
        let spawn = || {
            settings.as_ref().map(keep_off);
            command.spawn()
        };
        scope.spawn(spawn).join()
    });
    spawned.unwrap_or_else(|_| Err(std::io::Error::other("its thread panicked")))
}
