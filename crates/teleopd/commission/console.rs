//! The person at the terminal, and the log. Every line that is shown or answered is in the log, with its time.

use super::ports::{Person, Stop};
use rt::{Shutdown, out};
use std::fs::File;
use std::io::{BufRead, IsTerminal, Write};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, SystemTime};
use time::{OffsetDateTime, macros::format_description};

/// Polling period for signals while the person is asked.
const LOOK: Duration = Duration::from_millis(50);

pub struct Console {
    log: File,
    lines: Receiver<String>,
    shutdown: Shutdown,
}

impl Console {
    /// Opens the console. Lines of the standard input are read in a thread.
    pub fn open(log: File, shutdown: Shutdown) -> std::io::Result<Self> {
        let (sender, lines) = channel();
        let read = move || {
            for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("answers".into()).spawn(read)?;
        Ok(Self { log, lines, shutdown })
    }

    /// Writes to the log alone.
    pub fn log(&mut self, text: &str) {
        for line in text.lines().filter(|line| !line.is_empty()) {
            // A full disk shows at the end, where the log is synchronised.
            let _ = writeln!(self.log, "{} {line}", now_text());
        }
    }

    pub fn sync(&self) -> std::io::Result<()> {
        self.log.sync_all()
    }

    /// Waits for a line. What was typed before the question on a terminal answers nothing.
    fn ask(&mut self, question: &str) -> Result<String, Stop> {
        if std::io::stdin().is_terminal() {
            while self.lines.try_recv().is_ok() {}
        }
        self.print(question);
        loop {
            if self.shutdown.requested() {
                return Err(Stop::Interrupted);
            }
            match self.lines.recv_timeout(LOOK) {
                Ok(line) => {
                    self.log(&format!("answer: {:?}", line.trim()));
                    return Ok(line.trim().to_lowercase());
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Stop::Refused("the standard input ended before an answer".into()));
                }
            }
        }
    }
}

impl Person for Console {
    fn print(&mut self, text: &str) {
        out!("{text}");
        self.log(text);
    }

    fn confirm(&mut self, question: &str) -> Result<(), Stop> {
        loop {
            match self.ask(&format!("{question} (Enter, or n to end)"))?.as_str() {
                "" | "y" => return Ok(()),
                "n" => return Err(Stop::Refused("the person refused".into())),
                _ => self.print("Enter goes on, n ends the run."),
            }
        }
    }

    fn saw(&mut self, question: &str, otherwise: &str) -> Result<(), Stop> {
        loop {
            match self.ask(&format!("{question} (y/n)"))?.as_str() {
                "y" => return Ok(()),
                "n" => return Err(Stop::Failed(otherwise.to_owned())),
                _ => self.print("Type y or n, then Enter."),
            }
        }
    }
}

/// Returns the time of UTC, as `2026-11-26T10:15:30.123Z`.
pub fn now_text() -> String {
    time_text(SystemTime::now())
}

fn time_text(at: SystemTime) -> String {
    let format = format_description!("[year]-[month]-[day]T[hour]:[minute]:[second].[subsecond digits:3]Z");
    OffsetDateTime::from(at).format(format).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::UNIX_EPOCH;

    #[test]
    fn times_are_written_as_dates_of_utc() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00.250Z"),
            (951_782_400, "2000-02-29T00:00:00.250Z"),
            (1_735_689_599, "2024-12-31T23:59:59.250Z"),
            (1_795_651_200, "2026-11-26T00:00:00.250Z"),
        ] {
            let at = UNIX_EPOCH + Duration::from_millis(seconds * 1000 + 250);
            assert_eq!(time_text(at), text);
        }
    }
}
