//! Starts the processes in order and stops them in reverse order. The driver is among the last to stop.

use crate::cli::InstanceArgs;
use crate::doctor::holder;
use crate::processes::{END_WITHIN, PROCESSES, READY_WITHIN};
use crate::programs::ROS2;
use crate::starter::{ReadySocket, ended_within};
use instance::Instance;
use rt::{Exit, Failure};
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Instant;

pub fn instance_in(run_dir: &Path) -> Result<Instance, Failure> {
    Instance::new(run_dir).map_err(|error| Failure::new(Exit::Unavailable, rt::unwritable(run_dir, &error)))
}

/// Returns an error if an instance already runs in this folder. Call it before anything is started there.
pub fn refuse_second(instance: &Instance) -> Result<(), Failure> {
    let Some(pid) = holder(&instance.operator_lock()) else { return Ok(()) };
    let folder = instance.run_dir().display();
    let text = format!(
        "an instance already runs in {folder} (its control is process {pid}). Query it with teleopctl --run-dir \
         {folder} status; a second one needs another --run-dir"
    );
    Err(Failure::new(Exit::TempFail, text))
}

/// Removes the READY sockets of starters that were killed. No process listens on them any more.
fn remove_dead_sockets(run_dir: &Path) {
    let is_for_ready =
        |name: &str| name.ends_with(".sock") && (name.starts_with("ready-") || name.starts_with("record-"));
    for entry in std::fs::read_dir(run_dir).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_some_and(is_for_ready) {
            let answer = UnixDatagram::unbound().and_then(|socket| socket.connect(entry.path()));
            if answer.is_err_and(|error| error.kind() == std::io::ErrorKind::ConnectionRefused) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Destination of the processes' log output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// To `<run dir>/<name>.log`.
    Files,
    /// To this process's own streams, everything.
    All,
    /// To this process's own streams, warnings and errors alone.
    Warnings,
}

/// Running processes of one instance.
pub struct Children {
    program: PathBuf,
    instance: Instance,
    place: InstanceArgs,
    output: Output,
    running: Vec<(&'static str, Child)>,
    ready: ReadySocket,
}

impl Children {
    /// Starts every process from the running executable, and waits until each is READY.
    pub fn start(instance: &Instance, place: &InstanceArgs, output: Output) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::with(Exit::Software))?;
        let mut children = Self::none(program, instance, place, output)?;
        children.start_all()?;
        Ok(children)
    }

    /// Starts no process yet. `program` is the executable of each.
    pub fn none(program: PathBuf, instance: &Instance, place: &InstanceArgs, output: Output) -> Result<Self, Failure> {
        // The socket's name contains this process's id. A second start in the same folder disturbs nothing before
        // it is refused.
        remove_dead_sockets(instance.run_dir());
        let path = instance.run_dir().join(format!("ready-{}.sock", std::process::id()));
        let ready = ReadySocket::bind(path.clone()).map_err(|error| Failure::unwritable(&path, &error))?;
        let (instance, place) = (instance.clone(), place.clone());
        Ok(Self { program, instance, place, output, running: Vec::new(), ready })
    }

    /// Starts every process in order, each when the one before is READY.
    pub fn start_all(&mut self) -> Result<(), Failure> {
        PROCESSES.into_iter().try_for_each(|name| self.start_one(name))
    }

    /// Returns the command line that starts the process `name`.
    pub fn command(&self, name: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.arg(name);
        self.place.hand_on(&mut command, &self.instance);
        command.stdin(Stdio::null());
        command
    }

    /// Returns the file that receives the log of process `name` with `Output::Files`.
    pub fn log(&self, name: &str) -> PathBuf {
        self.instance.run_dir().join(format!("{name}.log"))
    }

    /// Starts the process `name` and waits until it is READY. Can also restart a process that was killed.
    pub fn start_one(&mut self, name: &'static str) -> Result<(), Failure> {
        self.spawn(name)?;
        self.wait_ready(name).map_err(|mut failure| {
            if self.output == Output::Files
                && let Ok(log) = std::fs::read_to_string(self.log(name))
            {
                failure.text = format!("{}\n{}", failure.text, log.trim_end());
            }
            failure
        })
    }

    /// Starts the process `name`, and does not wait for it.
    pub fn spawn(&mut self, name: &'static str) -> Result<(), Failure> {
        let mut command = self.command(name);
        let _ = std::fs::remove_file(self.instance.report(name));
        match self.output {
            Output::Warnings => _ = command.arg("--quiet"),
            Output::Files => {
                let path = self.log(name);
                let log = std::fs::File::create(&path).map_err(|error| Failure::unwritable(&path, &error))?;
                let twin = log.try_clone().map_err(Failure::with(Exit::Software))?;
                command.stdout(log).stderr(twin);
            }
            Output::All => {}
        }
        // The child gets its own process group. Ctrl-C then reaches this process only, and it stops the others in
        // order.
        command.env("NOTIFY_SOCKET", &self.ready.path).process_group(0);
        let child = command.spawn().map_err(|error| Failure::new(Exit::Software, format!("{name}: {error}")))?;
        self.running.push((name, child));
        Ok(())
    }

    fn wait_ready(&mut self, name: &str) -> Result<(), Failure> {
        let give_up = Instant::now() + READY_WITHIN;
        while Instant::now() < give_up {
            if self.ready.hears_ready() {
                return Ok(());
            }
            if let Some((ended, status)) = self.ended() {
                let exit = match status.code() {
                    Some(78) => Exit::Config,
                    Some(75) => Exit::TempFail,
                    Some(66) => Exit::NoInput,
                    Some(69) => Exit::Unavailable,
                    _ => Exit::Software,
                };
                return Err(Failure::new(exit, unready(ended, status, &self.place)));
            }
        }
        Err(Failure::new(Exit::Unavailable, format!("{name} was not ready within {} s", READY_WITHIN.as_secs())))
    }

    /// Process id of `name`. `None` if it was not started or was killed.
    pub fn id(&self, name: &str) -> Option<u32> {
        self.running.iter().find(|(running, _)| *running == name).map(|(_, child)| child.id())
    }

    /// Removes the process `name` from the running ones, as it is. `None` if it was not started or was killed.
    pub fn take(&mut self, name: &str) -> Option<Child> {
        let index = self.running.iter().position(|(running, _)| *running == name)?;
        Some(self.running.remove(index).1)
    }

    /// Sends SIGKILL and waits until the process has ended.
    pub fn kill(&mut self, name: &str) {
        if let Some(mut child) = self.take(name) {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// Returns true if the process `name` was started and has not ended.
    pub fn runs(&mut self, name: &str) -> bool {
        let child = self.running.iter_mut().find(|(running, _)| *running == name);
        child.is_some_and(|(_, child)| matches!(child.try_wait(), Ok(None)))
    }

    /// Returns the first process that has ended, if any.
    pub fn ended(&mut self) -> Option<(&'static str, ExitStatus)> {
        self.running.iter_mut().find_map(|(name, child)| child.try_wait().ok().flatten().map(|status| (*name, status)))
    }

    /// Stops every process in order. Returns the names of those that it had to kill or that ended badly.
    pub fn stop(&mut self) -> Vec<String> {
        PROCESSES.into_iter().rev().filter_map(|name| self.end(name).err()).collect()
    }

    /// Stops the process `name`, if it runs.
    pub fn end(&mut self, name: &str) -> Result<(), String> {
        let Some(mut child) = self.take(name) else { return Ok(()) };
        if let Ok(Some(status)) = child.try_wait() {
            return Err(format!("{name} had ended already ({status})"));
        }
        match ended_within(&mut child, END_WITHIN) {
            Some(status) if status.success() => Ok(()),
            Some(status) => Err(format!("{name} failed ({status})")),
            None => Err(format!("{name} did not end within {} s and was killed", END_WITHIN.as_secs())),
        }
    }
}

/// Says that a process ended before it was READY. The driver may be a program of the user's own.
fn unready(ended: &str, status: ExitStatus, place: &InstanceArgs) -> String {
    let program = config::read_settings(&place.config, &place.overrides())
        .map(|settings| settings.driver.program)
        .unwrap_or_default();
    if ended == "driver" && program.ends_with(ROS2.name()) {
        return format!("{program} ended before it was ready ({status}): its own words say why");
    }
    if ended != "driver" || program.is_empty() {
        return format!("{ended} ended before it was ready ({status})");
    }
    format!(
        "driver.program = {program:?} ended before it was ready ({status}): docs/src/drivers.md says what a driver must do"
    )
}

impl Drop for Children {
    fn drop(&mut self) {
        self.stop();
    }
}
