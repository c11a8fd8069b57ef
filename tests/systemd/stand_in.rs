//! A stand-in for systemd's side of sd_notify(3). Starts the processes with the units' own command lines and
//! reads their messages.

use harness::SOON;
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, waitpid};
use nix::unistd::Pid;
use std::os::unix::net::UnixDatagram;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// WatchdogSec= of the stand-in. It is shorter than the units', to shorten the test.
const WATCHDOG: Duration = Duration::from_millis(400);

/// Shortest wait for a report.
const TURN: Duration = Duration::from_millis(1);

/// One process under the stand-in.
struct Service {
    name: &'static str,
    child: Child,
    socket: UnixDatagram,
}

/// Returns ExecStart= of the system's unit as words. This test's program, settings and folder replace the
/// installed ones.
fn command_line(name: &str, settings: &Path, run_dir: &Path) -> Vec<String> {
    let unit = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/systemd/system/teleop@.service");
    let text = std::fs::read_to_string(unit).expect("the template");
    let line = text.lines().find_map(|line| line.strip_prefix("ExecStart=")).expect("ExecStart=");
    let replaced = |word: &str| match word {
        "%i" => name.to_owned(),
        "/usr/bin/teleopd" => env!("CARGO_BIN_EXE_teleopd").to_owned(),
        "/etc/teleop/teleop.toml" => settings.display().to_string(),
        "/run/teleop" => run_dir.display().to_string(),
        other => other.to_owned(),
    };
    line.split_whitespace().map(replaced).collect()
}

impl Service {
    fn start(name: &'static str, run_dir: &Path) -> Self {
        let path = run_dir.join(format!("{name}.notify"));
        let socket = UnixDatagram::bind(&path).expect("a socket");
        let settings = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
        let log = std::fs::File::create(run_dir.join(format!("{name}.log"))).expect("a log");
        // As in systemd, the watchdog belongs to the started process, by its id.
        let child = Command::new("/bin/sh")
            .args(["-c", "WATCHDOG_PID=$$ exec \"$0\" \"$@\""])
            .args(command_line(name, &settings, run_dir))
            .env_clear()
            .env("NOTIFY_SOCKET", &path)
            .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())
            .current_dir("/")
            .stdin(Stdio::null())
            .stdout(log.try_clone().expect("a log"))
            .stderr(log)
            .spawn()
            .expect("a process");
        Self { name, child, socket }
    }

    /// Returns the next state that the process reports, within `time`.
    fn hears(&self, time: Duration) -> Option<String> {
        let mut text = [0; 512];
        self.socket.set_read_timeout(Some(time)).expect("a timeout");
        let length = self.socket.recv(&mut text).ok()?;
        Some(String::from_utf8_lossy(&text[..length]).into_owned())
    }

    fn waits_for(&self, state: &str) {
        let give_up = Instant::now() + SOON;
        while self.hears(Duration::from_millis(50)).is_none_or(|heard| !heard.lines().any(|line| line == state)) {
            assert!(Instant::now() < give_up, "{} never sent {state}", self.name);
        }
    }

    fn signal(&self, signal: &str) {
        let status = Command::new("/bin/sh").args(["-c", &format!("kill -{signal} {}", self.child.id())]).status();
        assert!(status.is_ok_and(|status| status.success()), "{}: kill -{signal}", self.name);
    }

    fn id(&self) -> Pid {
        Pid::from_raw(self.child.id() as i32)
    }

    /// Stops only the thread that ticks, until `resume_loop` is called from the same thread of the test.
    fn hang_loop(&self) -> nix::Result<()> {
        ptrace::seize(self.id(), ptrace::Options::empty())?;
        ptrace::interrupt(self.id())?;
        waitpid(self.id(), Some(WaitPidFlag::__WALL)).map(drop)
    }

    fn resume_loop(&self) -> nix::Result<()> {
        ptrace::detach(self.id(), None)
    }

    fn end(&mut self) -> ExitStatus {
        self.signal("TERM");
        self.waits_for("STOPPING=1");
        self.child.wait().expect("an end")
    }
}

/// Checks that no report arrives for two watchdog times. One more is allowed before it, for the last round of the loop.
fn fall_silent(services: &[Service], why: &str) {
    let begun = Instant::now();
    for service in services {
        while service.hears(WATCHDOG.saturating_sub(begun.elapsed()).max(TURN)).is_some() {}
    }
    let begun = Instant::now();
    for service in services {
        let heard = service.hears((2 * WATCHDOG).saturating_sub(begun.elapsed()).max(TURN));
        assert!(heard.is_none(), "{} {why}, and its watchdog is fed", service.name);
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn processes_notify_the_service_manager_unless_they_hang() {
    println!("under a stand-in that speaks NOTIFY_SOCKET and WATCHDOG_USEC");
    let folder = tempfile::Builder::new().prefix("tp").tempdir().expect("a folder");
    let mut services: Vec<Service> = Vec::new();
    for name in teleopd::PROCESSES {
        let service = Service::start(name, folder.path());
        let first = service.hears(SOON).unwrap_or_else(|| panic!("{name} sent nothing"));
        assert!(first.lines().any(|line| line == "READY=1"), "{name} sent {first:?} first");
        services.push(service);
    }
    for service in &services {
        for _ in 0..3 {
            service.waits_for("WATCHDOG=1");
        }
    }
    for service in &services {
        service.signal("STOP");
    }
    fall_silent(&services, "stands still");
    for service in &services {
        service.signal("CONT");
    }
    for service in &services {
        service.waits_for("WATCHDOG=1");
    }
    match services.iter().try_for_each(Service::hang_loop) {
        Ok(()) => fall_silent(&services, "has a loop that hangs"),
        Err(error) => println!("note: a single thread cannot be stopped here: {error}"),
    }
    for service in &services {
        let _ = service.resume_loop();
        service.waits_for("WATCHDOG=1");
    }
    while let Some(mut service) = services.pop() {
        let status = service.end();
        assert!(status.success() && status.signal().is_none(), "{}: {status}", service.name);
    }
    let text = std::fs::read_to_string(folder.path().join("driver.json")).expect("figures");
    let driver: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(driver["ended_at_rest"], true, "{driver:#}");
    if let Ok(instance) = instance::Instance::new(folder.path()) {
        instance.retire();
    }
}
