//! The steps of the tour.

use super::Tour;
use super::stage::{Background, Line, Stop};
use crate::programs::{Program, RECORD, REPLAY, TELEOPCTL, TELEOPD};
use rt::out;
use serde_json::Value;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Motion of the first step, one of the project's motion files.
const MOTION: &str = "wave-left.bvh";
/// The client of the third step, in the source tree.
const PYTHON_CLIENT: &str = "tools/clients/python";
/// Number of attempts for a run on a machine that is too busy.
const ATTEMPTS: usize = 3;

/// Time limit of each action. A whole motion takes 25 s, a start 5 s, and engaging 5 s. A busy machine takes longer.
const RUN_WITHIN: Duration = Duration::from_secs(60);
const START_WITHIN: Duration = Duration::from_secs(30);
const ANSWER_WITHIN: Duration = Duration::from_secs(10);
const INSTALL_WITHIN: Duration = Duration::from_secs(90);
const BUILD_WITHIN: Duration = Duration::from_secs(1800);
/// Time for which the robot follows the Python client.
const FOLLOW: Duration = Duration::from_secs(4);
/// Time to wait for a lease. It outlasts its client's exit by a second.
const LEASE: Duration = Duration::from_millis(1500);

/// Builds missing programs in a source tree.
pub fn programs(tour: &mut Tour) -> Result<(), Stop> {
    let all_there = |all: &[Program]| all.iter().all(|program| program.found().is_some());
    if all_there(&[TELEOPCTL, REPLAY, RECORD]) || instance::is_installed() || !Path::new("Cargo.toml").exists() {
        return Ok(());
    }
    out!("\nSome programs are not built yet. That takes minutes, once.");
    if !tour.goes_on("Enter builds them, q and Enter end the tour: ") {
        return Err(Stop::Quit);
    }
    let line = Line::other("cargo").with("build --release --bins -p teleopd -p replay -p record".split(' '));
    let ended = tour.stage.run(line, BUILD_WITHIN)?;
    if ended.code == Some(0) { Ok(()) } else { Err(Stop::Fail("cargo build failed".into())) }
}

pub fn own_motion(tour: &mut Tour) -> Result<String, Stop> {
    demo(tour, &motion()?)
}

fn motion() -> Result<PathBuf, Stop> {
    let motion = instance::default_motions().join(MOTION);
    if motion.exists() {
        return Ok(motion);
    }
    Err(Stop::Skip(format!("{} does not exist; run the tour from the repository's root", motion.display())))
}

/// Runs a demo. Retries if the machine was too busy.
fn demo(tour: &Tour, motion: &Path) -> Result<String, Stop> {
    for _ in 1..ATTEMPTS {
        match demo_once(tour, motion) {
            Err(Stop::Fail(why)) => out!("{why}. Trying again, in case this machine was too busy."),
            ended => return ended,
        }
    }
    demo_once(tour, motion)
}

fn demo_once(tour: &Tour, motion: &Path) -> Result<String, Stop> {
    let report = tour.stage.folder.join("report.json");
    let _ = std::fs::remove_file(&report);
    let line = Line::program(TELEOPD)?.with(["demo", "--motion"]).with([motion]).with(config(tour));
    let ended = tour.stage.run(line.with([Path::new("--report"), &report]), RUN_WITHIN)?;
    // Exit code 2 means that it held for most of the time, on a busy machine.
    if !matches!(ended.code, Some(0 | 2)) {
        return Err(Stop::Fail(format!("the demo ended with {}", code(ended.code))));
    }
    let text = std::fs::read_to_string(&report).unwrap_or_default();
    let report: Value = serde_json::from_str(&text).map_err(|_| Stop::Fail("the demo wrote no report".into()))?;
    let violations: u64 = report["violations"].as_object().into_iter().flatten().filter_map(|(_, n)| n.as_u64()).sum();
    let share = report["followed"]["share"].as_f64();
    let (Some(share), 0) = (share, violations) else {
        return Err(Stop::Fail(format!("the robot never followed, or broke {violations} limits")));
    };
    let busy = if ended.code == Some(2) { "; this machine is busy, so it held often" } else { "" };
    Ok(format!("the robot followed for {:.0} % of the motion and broke no limit{busy}", share * 100.0))
}

/// Starts `up`, a replayed person and the page.
pub fn page(tour: &mut Tour) -> Result<String, Stop> {
    let run_dir = instance(tour)?;
    let person = Line::program(REPLAY)?.with(["builtin", "--loop", "--run-dir"]).with([&run_dir]);
    let mut person = tour.stage.start("replay", person)?;
    person.wait_for("holding the first frame", START_WITHIN)?;
    let view = Line::program(TELEOPD)?.with(["view", "--port", "0", "--run-dir"]).with([&run_dir]).with(config(tour));
    let mut view = tour.stage.start("view", view)?;
    let line = view.wait_for("http://", START_WITHIN)?;
    let address = line.split_whitespace().find(|word| word.starts_with("http://")).unwrap_or_default();
    answers(address).map_err(|why| Stop::Fail(format!("{address}: {why}")))?;
    out!("The page is at {address}");
    if !tour.yes {
        out!("Open it in a browser on this machine. E engages, R releases, Space stops.");
        if !tour.goes_on("Enter when you have seen it, q and Enter end the tour: ") {
            return Err(Stop::Quit);
        }
    }
    Ok(format!("the page answered at {}", address.split('#').next().unwrap_or_default()))
}

/// Returns the folder of the tour's instance. Starts the instance if it does not run.
fn instance(tour: &mut Tour) -> Result<PathBuf, Stop> {
    let run_dir = tour.stage.folder.join("run");
    if tour.instance.as_mut().is_none_or(Background::has_ended) {
        let up = Line::program(TELEOPD)?.with(["up", "--engage-without-realtime", "--run-dir"]).with([&run_dir]);
        let mut up = tour.stage.start("up", up.with(config(tour)))?;
        up.wait_for("READY", START_WITHIN)?;
        tour.instance = Some(up);
    }
    Ok(run_dir)
}

fn answers(address: &str) -> Result<(), String> {
    let host = address.trim_start_matches("http://").split('/').next().unwrap_or_default();
    let port = host.rsplit(':').next().and_then(|port| port.parse().ok()).ok_or("the address has no port")?;
    let ask = || -> std::io::Result<String> {
        let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port))?;
        stream.set_read_timeout(Some(ANSWER_WITHIN))?;
        write!(stream, "GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")?;
        let mut text = String::new();
        stream.read_to_string(&mut text).map(|_| text)
    };
    let text = ask().map_err(|error| error.to_string())?;
    let head = text.lines().next().unwrap_or_default();
    if head.contains(" 200 ") && text.contains("<html") { Ok(()) } else { Err(format!("the page answered \"{head}\"")) }
}

/// Runs its own Python client in its own virtual environment.
pub fn python(tour: &mut Tour) -> Result<String, Stop> {
    let client = Path::new(PYTHON_CLIENT);
    if !client.is_dir() {
        let text = format!("{PYTHON_CLIENT} does not exist; run the tour from the source repository's root");
        return Err(Stop::Skip(text));
    }
    let venv = tour.stage.folder.join("venv");
    let made = tour.stage.ask(Line::other("python3").with(["-m", "venv"]).with([&venv]), INSTALL_WITHIN)?;
    if made.code != Some(0) {
        return Err(Stop::Skip(format!("python3 cannot create a virtual environment: {}", made.last_line())));
    }
    let pip = Line::other(venv.join("bin/pip"));
    let pip = pip.with("install --quiet --disable-pip-version-check --retries 1 --timeout 10".split(' '));
    let installed = tour.stage.ask(pip.with([format!("./{PYTHON_CLIENT}")]), INSTALL_WITHIN)?;
    if installed.code != Some(0) {
        let why = installed.last_line();
        return Err(Stop::Skip(format!(
            "pip cannot install the client, most often because there is no network: {why}"
        )));
    }
    let run_dir = instance(tour)?;
    tour.stage.sleep(LEASE)?;
    let own = Line::other(venv.join("bin/python")).with([client.join("examples/own.py"), run_dir.clone()]);
    let mut own = tour.stage.start("own", own)?;
    own.wait_for("publishing", START_WITHIN)?;
    // A person must be visible for half a second before the robot can engage.
    tour.stage.sleep(LEASE)?;
    let outcome = engaged(tour, &run_dir)?;
    if own.has_ended() {
        return Err(Stop::Fail("own.py ended while the robot followed it".into()));
    }
    Ok(format!("the robot followed own.py for {} s; {outcome}", FOLLOW.as_secs()))
}

/// Engages, follows for a while and releases. Returns the last line of `teleopctl`.
fn engaged(tour: &Tour, run_dir: &Path) -> Result<String, Stop> {
    let give_up = Instant::now() + START_WITHIN;
    loop {
        let line = Line::program(TELEOPCTL)?.with(["engage", "--run-dir"]).with([run_dir]);
        let mut engage = tour.stage.start("engage", line)?;
        match engage.wait_for("engaged: ", START_WITHIN) {
            Ok(_) => {}
            // Frames may be late on a busy machine.
            Err(Stop::Fail(_)) if Instant::now() < give_up => {
                tour.stage.sleep(Duration::from_secs(1))?;
                continue;
            }
            Err(stop) => return Err(stop),
        }
        tour.stage.sleep(FOLLOW)?;
        let ended = engage.end();
        ended.text.lines().for_each(|line| out!("  {line}"));
        let released = ended.text.lines().find_map(|line| Some(line.split_once("released: ")?.1.to_owned()));
        return released.ok_or_else(|| Stop::Fail(format!("the robot was not released: {}", ended.last_line())));
    }
}

/// Records a run in virtual time, describes it, and plays it again live. The recording is the same on every machine.
pub fn recording(tour: &mut Tour) -> Result<String, Stop> {
    let (commands, file) = (tour.stage.folder.join("tour.csv"), tour.stage.folder.join("tour.mcap"));
    RECORD.path().map_err(|failure| Stop::Skip(failure.text))?;
    let line =
        Line::program(REPLAY)?.with([&motion()?]).with([Path::new("--offline"), &commands, "--record".as_ref(), &file]);
    let recorded = tour.stage.ask(line.with(config(tour)), RUN_WITHIN)?;
    if recorded.code != Some(0) {
        return Err(Stop::Fail(format!("replay: {}", recorded.last_line())));
    }
    let summary = Line::program(RECORD)?.with([Path::new("--summary"), &file]).with(config(tour));
    let summary = tour.stage.ask(summary, RUN_WITHIN)?;
    if summary.code != Some(0) || !summary.text.contains("complete") {
        return Err(Stop::Fail(format!("record --summary: {}", summary.last_line())));
    }
    Ok(format!("the recording is complete; played again, {}", demo(tour, &file)?))
}

/// Returns the option that names the settings. Empty if they are the default of every program.
fn config(tour: &Tour) -> Vec<OsString> {
    let default = tour.config == instance::default_config();
    if default { Vec::new() } else { vec!["--config".into(), tour.config.clone().into_os_string()] }
}

fn code(code: Option<i32>) -> String {
    code.map_or_else(|| "a signal".into(), |code| format!("exit code {code}"))
}
