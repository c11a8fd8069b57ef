//! Runs the commands of the tour. It shows each command as a person types it. Each has a time limit and ends with
//! the tour.

use crate::programs::Program;
use crate::starter::ended_within;
use rt::{Shutdown, out};
use std::fs::File;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Polling period of a command.
const LOOK: Duration = Duration::from_millis(20);
/// Longest time for a command to end after a request. `up` brings the robot to rest and stops five processes, one
/// by one.
const END_WITHIN: Duration = Duration::from_secs(15);
/// Number of output lines shown for a command.
const LINES_SHOWN: usize = 12;

#[derive(Debug)]
pub enum Stop {
    /// A requirement of the step is missing.
    Skip(String),
    Fail(String),
    Quit,
}

/// A command, both as it runs and as it is shown.
pub struct Line {
    command: Command,
    shown: String,
}

impl Line {
    pub fn program(program: Program) -> Result<Self, Stop> {
        let path = program.path().map_err(|failure| Stop::Skip(failure.text))?;
        Ok(Self { command: Command::new(path), shown: program.typed() })
    }

    /// Creates a command for any other program, by its path or its name in PATH.
    pub fn other(program: impl AsRef<Path>) -> Self {
        let program = program.as_ref();
        Self { command: Command::new(program), shown: program.display().to_string() }
    }

    pub fn with<S: AsRef<std::ffi::OsStr>>(mut self, arguments: impl IntoIterator<Item = S>) -> Self {
        for argument in arguments {
            let argument = argument.as_ref();
            let text = argument.to_string_lossy();
            let quote = if text.contains(char::is_whitespace) { "'" } else { "" };
            self.shown += &format!(" {quote}{text}{quote}");
            self.command.arg(argument);
        }
        self
    }
}

pub struct Ended {
    /// Exit code. `None` if a signal ended the command.
    pub code: Option<i32>,
    /// Output, if it was kept.
    pub text: String,
}

impl Ended {
    pub fn last_line(&self) -> &str {
        self.text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it printed nothing")
    }
}

pub struct Stage {
    /// Folder for the output of background commands.
    pub folder: PathBuf,
    pub shutdown: Shutdown,
}

impl Stage {
    /// Runs a command in the foreground. It draws in this terminal.
    pub fn run(&self, mut line: Line, within: Duration) -> Result<Ended, Stop> {
        out!("$ {}", line.shown);
        line.command.stdin(Stdio::null());
        self.wait(&mut line, within)
    }

    /// Runs a command and keeps its output. Shows the first lines.
    pub fn ask(&self, mut line: Line, within: Duration) -> Result<Ended, Stop> {
        out!("$ {}", line.shown);
        let path = self.folder.join("command.log");
        redirect(&mut line.command, &path)?;
        let mut ended = self.wait(&mut line, within)?;
        ended.text = std::fs::read_to_string(&path).unwrap_or_default();
        show(&ended.text);
        Ok(ended)
    }

    pub fn start(&self, name: &'static str, mut line: Line) -> Result<Background, Stop> {
        out!("$ {} &", line.shown);
        let log = self.folder.join(format!("{name}.log"));
        redirect(&mut line.command, &log)?;
        // The command gets its own process group. Ctrl-C then reaches only the tour, which ends the commands one
        // by one.
        let child = line.command.process_group(0).spawn();
        let child = child.map_err(|error| Stop::Skip(format!("{}: {error}", line.shown)))?;
        Ok(Background { name, child, log, shutdown: self.shutdown.clone(), ended: None })
    }

    /// Sleeps. Returns early if the tour ends.
    pub fn sleep(&self, time: Duration) -> Result<(), Stop> {
        if self.shutdown.sleep_until(rt::now().plus_ns(time.as_nanos() as u64)) { Ok(()) } else { Err(Stop::Quit) }
    }

    fn wait(&self, line: &mut Line, within: Duration) -> Result<Ended, Stop> {
        let child = line.command.spawn();
        let mut child = child.map_err(|error| Stop::Skip(format!("{}: {error}", line.shown)))?;
        let give_up = Instant::now() + within;
        loop {
            if let Ok(Some(status)) = child.try_wait() {
                // Ctrl-C reaches both processes.
                let quit = self.shutdown.requested();
                return if quit { Err(Stop::Quit) } else { Ok(Ended { code: status.code(), text: String::new() }) };
            }
            let late = Instant::now() > give_up;
            if late || self.shutdown.requested() {
                ended_within(&mut child, END_WITHIN);
                let text = format!("{}: not done within {} s", line.shown, within.as_secs());
                return Err(if late { Stop::Fail(text) } else { Stop::Quit });
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// A command in the background. It ends when this value is dropped.
pub struct Background {
    name: &'static str,
    child: Child,
    log: PathBuf,
    shutdown: Shutdown,
    ended: Option<Option<i32>>,
}

impl Background {
    /// Waits until the command prints a line that contains `words`. Returns that line.
    pub fn wait_for(&mut self, words: &str, within: Duration) -> Result<String, Stop> {
        let give_up = Instant::now() + within;
        loop {
            // Check first if the command has ended. Its output is then complete.
            let over = self.has_ended();
            let text = self.text();
            if let Some(line) = text.lines().find(|line| line.contains(words)) {
                return Ok(line.to_owned());
            }
            if over || Instant::now() > give_up {
                show(&text);
                let how = if over { "ended".into() } else { format!("did not say so within {} s", within.as_secs()) };
                return Err(Stop::Fail(format!("{} {how} before \"{words}\"", self.name)));
            }
            if self.shutdown.requested() {
                return Err(Stop::Quit);
            }
            std::thread::sleep(LOOK);
        }
    }

    pub fn has_ended(&mut self) -> bool {
        if self.ended.is_none() {
            self.ended = self.child.try_wait().ok().flatten().map(|status| status.code());
        }
        self.ended.is_some()
    }

    /// Stops the command. Returns its exit code and its whole output.
    pub fn end(mut self) -> Ended {
        self.finish();
        Ended { code: self.ended.flatten(), text: self.text() }
    }

    fn finish(&mut self) {
        if !self.has_ended() {
            self.ended = Some(ended_within(&mut self.child, END_WITHIN).and_then(|status| status.code()));
        }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        let read = File::open(&self.log).and_then(|mut file| file.read_to_string(&mut text));
        read.map_or(String::new(), |_| text)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.finish();
    }
}

fn redirect(command: &mut Command, path: &Path) -> Result<(), Stop> {
    let opened = File::create(path).and_then(|file| Ok((file.try_clone()?, file)));
    let (one, two) = opened.map_err(|error| Stop::Fail(rt::unwritable(path, &error)))?;
    command.stdin(Stdio::null()).stdout(one).stderr(two);
    Ok(())
}

fn show(text: &str) {
    for line in text.lines().take(LINES_SHOWN) {
        out!("  {line}");
    }
    if text.lines().count() > LINES_SHOWN {
        out!("  ...");
    }
}
