//! Runs the commands of the tour: each is shown as a person types it, has a limit, and ends with the tour.

use crate::programs::Program;
use rt::{Shutdown, out};
use std::fs::File;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How often a command is looked after.
const LOOK: Duration = Duration::from_millis(20);
/// How long a command may take to end once it is asked to: `up` brings the robot to rest and ends five processes, one by one.
const END_WITHIN: Duration = Duration::from_secs(15);
/// Lines of a command's words that are shown.
const LINES_SHOWN: usize = 12;

/// Why a step ends early.
#[derive(Debug)]
pub enum Stop {
    /// What it needs is not here.
    Skip(String),
    /// Something was not as it must be.
    Fail(String),
    /// Whoever takes the tour ends it.
    Quit,
}

/// A command, as it runs and as it is shown.
pub struct Line {
    command: Command,
    shown: String,
}

impl Line {
    /// A program of the project.
    pub fn of(program: Program) -> Result<Self, Stop> {
        let path = program.path().map_err(|failure| Stop::Skip(failure.text))?;
        Ok(Self { command: Command::new(path), shown: program.typed() })
    }

    /// Any other program, by its path or its name in PATH.
    pub fn other(program: impl AsRef<Path>) -> Self {
        let program = program.as_ref();
        Self { command: Command::new(program), shown: program.display().to_string() }
    }

    /// Adds arguments.
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

/// How a command ended.
pub struct Ended {
    /// Its exit code; nothing if a signal ended it.
    pub code: Option<i32>,
    /// What it printed, where that was kept.
    pub text: String,
}

impl Ended {
    /// The last line that says something.
    pub fn last_line(&self) -> &str {
        self.text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing")
    }
}

/// Where commands run.
pub struct Stage {
    /// What they print in the background goes here.
    pub folder: PathBuf,
    pub shutdown: Shutdown,
}

impl Stage {
    /// Runs a command in the foreground; it draws in this terminal.
    pub fn run(&self, mut line: Line, within: Duration) -> Result<Ended, Stop> {
        out!("$ {}", line.shown);
        line.command.stdin(Stdio::null());
        self.wait(&mut line, within)
    }

    /// Runs a command, and keeps what it prints; some of it is shown.
    pub fn ask(&self, mut line: Line, within: Duration) -> Result<Ended, Stop> {
        out!("$ {}", line.shown);
        let path = self.folder.join("command.log");
        redirect(&mut line.command, &path)?;
        let mut ended = self.wait(&mut line, within)?;
        ended.text = std::fs::read_to_string(&path).unwrap_or_default();
        show(&ended.text);
        Ok(ended)
    }

    /// Starts a command in the background.
    pub fn start(&self, name: &'static str, mut line: Line) -> Result<Background, Stop> {
        out!("$ {} &", line.shown);
        let log = self.folder.join(format!("{name}.log"));
        redirect(&mut line.command, &log)?;
        // A process group of its own: Ctrl-C reaches the tour alone, which then ends one after the other.
        let child = line.command.process_group(0).spawn();
        let child = child.map_err(|error| Stop::Skip(format!("{}: {error}", line.shown)))?;
        Ok(Background { name, child, log, shutdown: self.shutdown.clone(), ended: None })
    }

    /// Waits; the tour's own end may come first.
    pub fn sleep(&self, time: Duration) -> Result<(), Stop> {
        if self.shutdown.sleep_until(rt::now().plus_ns(time.as_nanos() as u64)) { Ok(()) } else { Err(Stop::Quit) }
    }

    fn wait(&self, line: &mut Line, within: Duration) -> Result<Ended, Stop> {
        let child = line.command.spawn();
        let mut child = child.map_err(|error| Stop::Skip(format!("{}: {error}", line.shown)))?;
        let give_up = Instant::now() + within;
        loop {
            if let Ok(Some(status)) = child.try_wait() {
                // Ctrl-C reaches both.
                let quit = self.shutdown.requested();
                return if quit { Err(Stop::Quit) } else { Ok(Ended { code: status.code(), text: String::new() }) };
            }
            let late = Instant::now() > give_up;
            if late || self.shutdown.requested() {
                end(&mut child);
                let text = format!("{}: not done within {} s", line.shown, within.as_secs());
                return Err(if late { Stop::Fail(text) } else { Stop::Quit });
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// A command in the background; it ends with this.
pub struct Background {
    name: &'static str,
    child: Child,
    log: PathBuf,
    shutdown: Shutdown,
    ended: Option<Option<i32>>,
}

impl Background {
    /// Waits until it printed a line with `words`, which is returned.
    pub fn wait_for(&mut self, words: &str, within: Duration) -> Result<String, Stop> {
        let give_up = Instant::now() + within;
        loop {
            // Its end is looked for first: what it printed is complete then.
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

    /// Asks it to end; its exit code, and everything that it printed.
    pub fn end(mut self) -> Ended {
        self.finish();
        Ended { code: self.ended.flatten(), text: self.text() }
    }

    fn finish(&mut self) {
        if !self.has_ended() {
            self.ended = Some(end(&mut self.child));
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

/// SIGTERM, and SIGKILL for who does not end; the exit code.
fn end(child: &mut Child) -> Option<i32> {
    rt::terminate(child.id());
    let give_up = Instant::now() + END_WITHIN;
    while Instant::now() < give_up {
        if let Ok(Some(status)) = child.try_wait() {
            return status.code();
        }
        std::thread::sleep(LOOK);
    }
    let _ = child.kill();
    child.wait().ok().and_then(|status| status.code())
}

fn redirect(command: &mut Command, path: &Path) -> Result<(), Stop> {
    let opened = File::create(path).and_then(|file| Ok((file.try_clone()?, file)));
    let (one, two) = opened.map_err(|error| Stop::Fail(rt::unwritable(path, &error)))?;
    command.stdin(Stdio::null()).stdout(one).stderr(two);
    Ok(())
}

/// The first lines of what a command printed.
fn show(text: &str) {
    for line in text.lines().take(LINES_SHOWN) {
        out!("  {line}");
    }
    if text.lines().count() > LINES_SHOWN {
        out!("  ...");
    }
}
