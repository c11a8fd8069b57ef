//! Starts the processes in order and stops them in reverse order. The driver is among the last to stop.

use crate::cli::InstanceArgs;
use crate::doctor::holder;
use crate::processes::{END_WITHIN, PROCESSES, READY_WITHIN};
use instance::Instance;
use rt::{Exit, Failure};
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Returns the instance whose folder is `run_dir`.
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
    running: Vec<(&'static str, Child)>,
    socket: UnixDatagram,
    socket_path: PathBuf,
}

impl Children {
    /// Starts every process and waits until each is READY.
    pub fn start(instance: &Instance, place: &InstanceArgs, output: Output) -> Result<Self, Failure> {
        // The socket's name contains this process's id. A second start in the same folder disturbs nothing before
        // it is refused.
        remove_dead_sockets(instance.run_dir());
        let socket_path = instance.run_dir().join(format!("ready-{}.sock", std::process::id()));
        let _ = std::fs::remove_file(&socket_path);
        let socket = UnixDatagram::bind(&socket_path)
            .map_err(|error| Failure::new(Exit::CantCreate, rt::unwritable(&socket_path, &error)))?;
        socket
            .set_read_timeout(Some(Duration::from_millis(50)))
            .map_err(|error| Failure::new(Exit::Software, error))?;
        let mut children = Self { running: Vec::new(), socket, socket_path };
        for name in PROCESSES {
            if let Err(failure) = children.start_one(name, instance, place, output) {
                children.stop();
                return Err(failure);
            }
        }
        Ok(children)
    }

    /// Starts the process `name` and waits until it is READY. Can also restart a process that was killed.
    pub fn start_one(
        &mut self,
        name: &'static str,
        instance: &Instance,
        place: &InstanceArgs,
        output: Output,
    ) -> Result<(), Failure> {
        let program = std::env::current_exe().map_err(|error| Failure::new(Exit::Software, error))?;
        let mut command = Command::new(program);
        command.arg(name).arg("--config").arg(&place.config).arg("--run-dir").arg(instance.run_dir());
        if place.engage_without_realtime {
            command.arg("--engage-without-realtime");
        }
        if let Some(interface) = place.interface {
            command.arg("--interface").arg(interface.name());
        }
        let _ = std::fs::remove_file(instance.report(name));
        let log_path = instance.run_dir().join(format!("{name}.log"));
        if output == Output::Warnings {
            command.arg("--quiet");
        }
        if output == Output::Files {
            let log = std::fs::File::create(&log_path)
                .map_err(|error| Failure::new(Exit::CantCreate, rt::unwritable(&log_path, &error)))?;
            let twin = log.try_clone().map_err(|error| Failure::new(Exit::Software, error))?;
            command.stdout(log).stderr(twin);
        }
        // The child gets its own process group. Ctrl-C then reaches this process only, and it stops the others in
        // order.
        command.stdin(Stdio::null()).env("NOTIFY_SOCKET", &self.socket_path).process_group(0);
        let child = command.spawn().map_err(|error| Failure::new(Exit::Software, format!("{name}: {error}")))?;
        self.running.push((name, child));
        self.wait_ready(name, place).map_err(|mut failure| {
            if output == Output::Files
                && let Ok(log) = std::fs::read_to_string(&log_path)
            {
                failure.text = format!("{}\n{}", failure.text, log.trim_end());
            }
            failure
        })
    }

    fn wait_ready(&mut self, name: &str, place: &InstanceArgs) -> Result<(), Failure> {
        let give_up = Instant::now() + READY_WITHIN;
        let mut text = [0_u8; 512];
        while Instant::now() < give_up {
            if let Ok(length) = self.socket.recv(&mut text)
                && text[..length].split(|&byte| byte == b'\n').any(|line| line == b"READY=1")
            {
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
                return Err(Failure::new(exit, unready(ended, status, place)));
            }
        }
        Err(Failure::new(Exit::Unavailable, format!("{name} was not ready within {} s", READY_WITHIN.as_secs())))
    }

    /// Process id of `name`. `None` if it was not started or was killed.
    pub fn id(&self, name: &str) -> Option<u32> {
        self.running.iter().find(|(running, _)| *running == name).map(|(_, child)| child.id())
    }

    /// Sends SIGKILL and waits until the process has ended.
    pub fn kill(&mut self, name: &str) {
        if let Some(index) = self.running.iter().position(|(running, _)| *running == name) {
            let (_, mut child) = self.running.remove(index);
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// Returns the first process that has ended, if any.
    pub fn ended(&mut self) -> Option<(&'static str, ExitStatus)> {
        self.running.iter_mut().find_map(|(name, child)| child.try_wait().ok().flatten().map(|status| (*name, status)))
    }

    /// Stops every process in order. Returns the names of those that it had to kill or that ended badly.
    pub fn stop(&mut self) -> Vec<String> {
        let mut trouble = Vec::new();
        for name in PROCESSES.into_iter().rev() {
            let Some(index) = self.running.iter().position(|(running, _)| *running == name) else { continue };
            let (_, mut child) = self.running.remove(index);
            if let Ok(Some(status)) = child.try_wait() {
                trouble.push(format!("{name} had ended already ({status})"));
                continue;
            }
            rt::terminate(child.id());
            let give_up = Instant::now() + END_WITHIN;
            loop {
                match child.try_wait() {
                    Ok(Some(status)) if status.success() => break,
                    Ok(Some(status)) => {
                        trouble.push(format!("{name} failed ({status})"));
                        break;
                    }
                    _ if Instant::now() > give_up => {
                        let _ = child.kill();
                        let _ = child.wait();
                        trouble.push(format!("{name} did not end within {} s and was killed", END_WITHIN.as_secs()));
                        break;
                    }
                    _ => std::thread::sleep(Duration::from_millis(5)),
                }
            }
        }
        trouble
    }
}

/// Says that a process ended before it was READY. The driver may be a program of the user's own.
fn unready(ended: &str, status: ExitStatus, place: &InstanceArgs) -> String {
    let program = config::read_settings(&place.config).map(|settings| settings.driver.program).unwrap_or_default();
    if ended != "sim" || program.is_empty() {
        return format!("{ended} ended before it was ready ({status})");
    }
    format!(
        "driver.program = {program:?} ended before it was ready ({status}): docs/src/drivers.md says what a driver must do"
    )
}

impl Drop for Children {
    fn drop(&mut self) {
        self.stop();
        let _ = std::fs::remove_file(&self.socket_path);
    }
}
