//! A separate machine under a real systemd, in namespaces. Needs only root, systemd and a cgroup2 hierarchy.

use harness::{SOON, soon, within_by};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

/// Allows one machine at a time. Four real-time processes are enough for a small computer.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Time between two looks. Each starts programs, which would keep the computer busy without it.
const LOOK: Duration = Duration::from_millis(100);

/// A user who is neither root nor the daemon's, but a member of the operators' group. The numbers come from machine.sh.
pub const OPERATOR: [&str; 2] = ["--setuid=1000", "--setgid=991"];

pub struct Machine {
    outer: Child,
    init: u32,
    cgroup: PathBuf,
    folder: tempfile::TempDir,
    _turn: MutexGuard<'static, ()>,
}

impl Machine {
    /// Boots a machine without teleopd. The error says why this computer cannot run one.
    pub fn boot() -> Result<Self, String> {
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let uid = std::fs::metadata("/proc/self").map(|metadata| std::os::unix::fs::MetadataExt::uid(&metadata));
        if uid.is_ok_and(|uid| uid != 0) {
            return Err("namespaces and cgroups need root".into());
        }
        for needed in ["/usr/lib/systemd/systemd", "/usr/bin/systemctl", "/usr/bin/unshare", "/usr/bin/nsenter"] {
            if !Path::new(needed).exists() {
                return Err(format!("there is no {needed}"));
            }
        }
        let cgroup = hierarchy()?.join(format!("teleop-test-{}", std::process::id()));
        std::fs::create_dir_all(&cgroup).map_err(|error| format!("{}: {error}", cgroup.display()))?;
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let outer = start(&cgroup, folder.path())?;
        let mut machine = Self { outer, init: 0, cgroup, folder, _turn: turn };
        let mut is_up = false;
        within_by(SOON, LOOK, || {
            is_up = machine.is_up();
            is_up || !matches!(machine.outer.try_wait(), Ok(None))
        });
        if !is_up {
            return Err(format!("systemd does not boot in namespaces here: {}", machine.console()));
        }
        let version = machine.run(&[], &["systemctl", "--version"]);
        println!("under a real {}", version.lines().next().unwrap_or("systemd"));
        Ok(machine)
    }

    fn is_up(&mut self) -> bool {
        let id = self.outer.id();
        let children = std::fs::read_to_string(format!("/proc/{id}/task/{id}/children")).unwrap_or_default();
        self.init = children.split_whitespace().next().and_then(|pid| pid.parse().ok()).unwrap_or(0);
        self.init != 0
            && self.inside("run/systemd/private").exists()
            && self.output(&[], &["systemctl", "is-active", "basic.target"]).status.success()
    }

    /// Returns the output of systemd and the services.
    pub fn console(&self) -> String {
        let read = |path: PathBuf| std::fs::read_to_string(path).unwrap_or_default();
        read(self.folder.path().join("console")) + &read(self.inside("tmp/log"))
    }

    /// Converts a path of the machine to the path as seen from here.
    pub fn inside(&self, path: &str) -> PathBuf {
        Path::new("/proc").join(self.init.to_string()).join("root").join(path)
    }

    /// Returns a command in the machine. `as_whom` are options of nsenter(1). Without options it runs as root.
    pub fn command(&self, as_whom: &[&str], words: &[&str]) -> Command {
        let mut command = Command::new("/usr/bin/nsenter");
        command
            .arg("--target")
            .arg(self.init.to_string())
            .args(["--mount", "--pid", "--cgroup", "--uts", "--ipc", "--net"]);
        command.args(as_whom).arg("--").args(words).stdin(Stdio::null());
        // Location at which `systemctl --user` finds the manager of the machine's one user.
        command.env("XDG_RUNTIME_DIR", "/run/user/1000");
        command
    }

    pub fn output(&self, as_whom: &[&str], words: &[&str]) -> Output {
        self.command(as_whom, words).output().expect("nsenter runs")
    }

    /// Runs a command that must succeed, and returns its output.
    pub fn run(&self, as_whom: &[&str], words: &[&str]) -> String {
        let output = self.output(as_whom, words);
        let errors = harness::stderr(&output);
        assert!(output.status.success(), "{words:?}: {}: {errors}\n{}", output.status, self.console());
        harness::stdout(&output)
    }

    /// Returns a property of a unit of `manager`: the system's or the user's.
    pub fn property(&self, manager: &Manager, unit: &str, property: &str) -> String {
        let words = [&["systemctl"], manager.option, &["show", "--value", "-p", property, unit]].concat();
        self.run(&manager.as_whom, &words).trim().to_owned()
    }

    /// Waits until the unit's property has this value.
    pub fn wait(&self, manager: &Manager, unit: &str, property: &str, value: &str) {
        self.wait_until(&format!("{unit} with {property}={value}"), || self.property(manager, unit, property) == value);
    }

    /// Waits four times as long as other tests: all processes of the machine are in a session of their own, which shares a busy
    /// computer with the other sessions.
    pub fn wait_until(&self, what: &str, done: impl FnMut() -> bool) {
        assert!(within_by(4 * SOON, LOOK, done), "never {what}: {}", self.console());
    }

    /// Returns the figures that a process left in the run folder.
    pub fn figures(&self, path: &str) -> serde_json::Value {
        let text = std::fs::read_to_string(self.inside(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
        serde_json::from_str(&text).expect("JSON")
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // unshare --kill-child also kills the machine's first process, and with it all others.
        let _ = self.outer.kill();
        let _ = self.outer.wait();
        soon(|| remove_cgroups(&self.cgroup));
    }
}

/// A service manager of the machine, and the user who controls it.
pub struct Manager {
    pub option: &'static [&'static str],
    pub as_whom: Vec<&'static str>,
}

impl Manager {
    pub fn system() -> Self {
        Self { option: &[], as_whom: vec![] }
    }

    /// Returns the manager of the machine's user `operator`.
    pub fn user() -> Self {
        Self { option: &["--user"], as_whom: OPERATOR.to_vec() }
    }
}

/// Returns the mount point of the cgroup2 hierarchy.
fn hierarchy() -> Result<PathBuf, String> {
    let mounts = std::fs::read_to_string("/proc/self/mounts").map_err(|error| format!("/proc/self/mounts: {error}"))?;
    let of_type_cgroup2 = |line: &str| {
        let mut fields = line.split(' ').skip(1);
        let (place, kind) = (fields.next()?, fields.next()?);
        (kind == "cgroup2").then(|| PathBuf::from(place))
    };
    mounts.lines().find_map(of_type_cgroup2).ok_or_else(|| "no cgroup2 hierarchy is mounted".into())
}

fn start(cgroup: &Path, folder: &Path) -> Result<Child, String> {
    let root = folder.join("root");
    let console = std::fs::create_dir(&root).and_then(|()| std::fs::File::create(folder.join("console")));
    let console = console.map_err(|error| error.to_string())?;
    let client = folder.join("client");
    std::fs::hard_link(std::env::current_exe().unwrap(), &client)
        .or_else(|_| std::fs::copy(std::env::current_exe().unwrap(), &client).map(drop))
        .map_err(|error| format!("{}: {error}", client.display()))?;
    let repository = env!("CARGO_MANIFEST_DIR");
    // The shell joins the cgroup. Only its later child processes are in it.
    let script = "echo $$ > \"$0/cgroup.procs\" && exec \"$@\"";
    Command::new("/bin/sh")
        .args(["-c", script])
        .arg(cgroup)
        .args(["/usr/bin/unshare", "--fork", "--kill-child=SIGKILL"])
        .args(["--pid", "--mount", "--cgroup", "--uts", "--ipc", "--net", "/bin/sh"])
        .arg(format!("{repository}/tests/systemd/machine.sh"))
        .arg(&root)
        .arg(repository)
        .args([env!("CARGO_BIN_EXE_teleopd"), env!("CARGO_BIN_EXE_teleopctl")])
        .arg(&client)
        .stdin(Stdio::null())
        .stdout(console.try_clone().map_err(|error| error.to_string())?)
        .stderr(console)
        .spawn()
        .map_err(|error| format!("unshare: {error}"))
}

/// Removes a cgroup and all below it, deepest first.
fn remove_cgroups(folder: &Path) -> bool {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            remove_cgroups(&entry.path());
        }
    }
    std::fs::remove_dir(folder).is_ok() || !folder.exists()
}
