//! Measures the operator of a page. `teleopctl calibrate` does it, and the page shows what it prints.

use crate::worker::Worker;
use instance::Instance;
use messages::{FNV_BASIS, fnv};
use std::io::{BufRead, BufReader, PipeReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvError, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest line that is shown, bytes. The program's own lines are shorter.
const LINE_BYTES: u64 = 1 << 10;
/// Time between two looks whether the program has ended.
const LOOK: Duration = Duration::from_millis(50);
/// Shortest time between two starts. Nobody stands in a T-pose sooner.
const PAUSE: Duration = Duration::from_secs(1);

#[derive(Debug)]
pub enum CalibrationRequest {
    /// Measure the person under this name.
    Start(String),
    /// Stop measuring. Nothing is written then.
    Stop,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct CalibrationReport {
    pub on: bool,
    /// The file was written. False until the measurement ends.
    pub written: bool,
    pub text: Option<String>,
}

/// Returns the number by which `ingest` knows the person of a page with this name, from its hash. 0 is a person without a
/// name.
pub fn operator_id(name: &str) -> u32 {
    if name.is_empty() { 0 } else { (fnv(FNV_BASIS, name.as_bytes()) as u32).max(1) }
}

/// Data with which the pages of an instance measure their persons.
#[derive(Clone, Debug)]
pub struct Measuring {
    /// Folder of the operators' files.
    pub operators: PathBuf,
    /// Silence after which a lease ends: `ingest.authority_timeout_ms`.
    pub lease: Duration,
}

/// The measurements of a page. Dropping it stops one that runs.
pub type CalibrationWorker = Worker<CalibrationRequest, CalibrationReport>;

impl CalibrationWorker {
    pub fn new(instance: &Instance, folder: &Path) -> std::io::Result<Self> {
        let program = std::env::current_exe()?.with_file_name("teleopctl");
        let (run_dir, folder) = (instance.run_dir().to_owned(), folder.to_owned());
        Self::start("calibration", move |asked, answer| Measurer { program, run_dir, folder, answer }.work(asked))
    }
}

/// A program that measures, and the thread that passes its lines on.
struct Measurement {
    child: Child,
    lines: JoinHandle<()>,
}

impl Measurement {
    /// Ends the program if it still runs. Returns true if it had written the file.
    fn end(mut self) -> bool {
        let _ = self.child.kill();
        let written = self.child.wait().is_ok_and(|status| status.success());
        let _ = self.lines.join();
        written
    }
}

struct Measurer {
    program: PathBuf,
    run_dir: PathBuf,
    folder: PathBuf,
    answer: Sender<CalibrationReport>,
}

impl Measurer {
    fn work(self, asked: &Receiver<CalibrationRequest>) {
        let (mut running, mut begun): (Option<Measurement>, Option<Instant>) = (None, None);
        loop {
            let request = match &running {
                None => asked.recv().map_err(|RecvError| RecvTimeoutError::Disconnected),
                Some(_) => asked.recv_timeout(LOOK),
            };
            match request {
                Ok(CalibrationRequest::Start(_)) if running.is_some() => {}
                Ok(CalibrationRequest::Start(_)) if begun.is_some_and(|begun| begun.elapsed() < PAUSE) => {
                    self.send_report(false, Some("Once a second at most: press again.".to_owned()));
                }
                Ok(CalibrationRequest::Start(name)) => {
                    begun = Some(Instant::now());
                    match self.begin(&name) {
                        Ok(measurement) => running = Some(measurement),
                        Err(error) => self.send_report(false, Some(self.cannot_start(&error))),
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Ok(CalibrationRequest::Stop) => {
                    if let Some(measurement) = running.take() {
                        let written = measurement.end();
                        self.send_report(written, (!written).then(|| "Stopped. Nothing was written.".to_owned()));
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    let _ = running.map(Measurement::end);
                    return;
                }
            }
            if let Some(measurement) = running.take_if(|running| matches!(running.child.try_wait(), Ok(Some(_)))) {
                // Its last lines come first.
                let written = measurement.end();
                self.send_report(written, None);
            }
        }
    }

    fn begin(&self, name: &str) -> std::io::Result<Measurement> {
        let (lines, writer) = std::io::pipe()?;
        let mut command = Command::new(&self.program);
        command.args(["calibrate", "--run-dir"]).arg(&self.run_dir).arg("--folder").arg(&self.folder);
        // A server that is killed cannot end it.
        command.args(["--child-of", &std::process::id().to_string()]);
        // A name that looks like an option is a name.
        command.arg("--").arg(name).stdin(Stdio::null()).stdout(writer.try_clone()?).stderr(writer);
        let mut child = command.spawn()?;
        // The lines end once no process can write any.
        drop(command);
        let _ = self.answer.send(CalibrationReport { on: true, written: false, text: None });
        let answer = self.answer.clone();
        let thread = std::thread::Builder::new().name("lines".into()).spawn(move || pass_on(lines, &answer));
        match thread {
            Ok(lines) => Ok(Measurement { child, lines }),
            Err(error) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(error)
            }
        }
    }

    fn cannot_start(&self, error: &std::io::Error) -> String {
        let missing = error.kind() == std::io::ErrorKind::NotFound;
        let remedy = if missing { ". Build it: cargo build --release --bin teleopctl" } else { "" };
        format!("{}: {error}{remedy}", self.program.display())
    }

    fn send_report(&self, written: bool, text: Option<String>) {
        let _ = self.answer.send(CalibrationReport { on: false, written, text });
    }
}

fn pass_on(lines: PipeReader, answer: &Sender<CalibrationReport>) {
    let mut lines = BufReader::new(lines);
    loop {
        let mut line = Vec::new();
        match lines.by_ref().take(LINE_BYTES).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let text = String::from_utf8_lossy(&line).trim().trim_start_matches("teleopctl: ").to_owned();
        if answer.send(CalibrationReport { on: true, written: false, text: Some(text) }).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn measurer(folder: &Path, script: &str) -> CalibrationWorker {
        let program = folder.join("program");
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).expect("a script");
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("a program");
        let own = folder.to_owned();
        let work = move |asked: &Receiver<_>, answer| {
            Measurer { program, run_dir: "/run/there".into(), folder: own, answer }.work(asked);
        };
        Worker::start("calibration", work).expect("a thread")
    }

    fn reports(worker: &CalibrationWorker) -> Vec<CalibrationReport> {
        let mut all = Vec::new();
        wait::wait_until("ended", || {
            all.extend(worker.answer());
            all.last().is_some_and(|last: &CalibrationReport| !last.on)
        });
        all
    }

    #[test]
    fn page_gets_every_line_before_the_end_and_names_are_no_options() {
        let folder = tempfile::tempdir().expect("a folder");
        let worker = measurer(folder.path(), r#"echo "$@"; echo "teleopctl: oh" >&2; test "$9" = --help"#);
        worker.ask(CalibrationRequest::Start("--help".to_owned()));
        let [begin, output, error, end] = reports(&worker).try_into().expect("four reports");
        assert!(begin.on && begin.text.is_none());
        let (folder, own) = (folder.path().display(), std::process::id());
        let expected = format!("calibrate --run-dir /run/there --folder {folder} --child-of {own} -- --help");
        assert_eq!((output.text, error.text.as_deref()), (Some(expected), Some("oh")));
        assert!(end.written && !output.written && !error.written);
    }

    #[test]
    fn measurement_stops_with_its_page_and_writes_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let script = format!("echo begun; sleep 1; sleep 1; touch {}/written", folder.path().display());
        for closes in [false, true] {
            let worker = measurer(folder.path(), &script);
            worker.ask(CalibrationRequest::Start("anna".to_owned()));
            worker.ask(CalibrationRequest::Start("berta".to_owned()));
            wait::wait_until("begun", || worker.answer().is_some_and(|report| report.text.as_deref() == Some("begun")));
            if !closes {
                worker.ask(CalibrationRequest::Stop);
                let end = reports(&worker).pop().expect("a report");
                assert_eq!(end.text.as_deref(), Some("Stopped. Nothing was written."));
            }
        }
        std::thread::sleep(Duration::from_millis(2_500));
        assert!(!folder.path().join("written").exists());
    }

    #[test]
    fn missing_program_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let worker = measurer(folder.path(), "");
        std::fs::remove_file(folder.path().join("program")).expect("it was there");
        worker.ask(CalibrationRequest::Start("anna".to_owned()));
        let text = reports(&worker).pop().and_then(|report| report.text).unwrap_or_default();
        assert!(text.contains("program: ") && text.contains("No such file"), "{text}");
    }
}
