//! How far a run is: a bar on a terminal, else a line every 10 s on standard error.

use indicatif::{ProgressBar, ProgressStyle};
use rt::err;
use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two lines, or between two redraws of the bar. Assumption: a person waits no longer before wondering.
const PERIOD: Duration = Duration::from_secs(10);

/// Progress of a run, shown until it is dropped.
pub struct Progress {
    bar: ProgressBar,
    lines: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    /// Shows how many of `length` units are done. `unit` is a word in the plural. Each line begins with the program's
    /// name.
    pub fn new(program: &'static str, length: u64, unit: &str) -> Self {
        if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new(length);
            let template = format!("{{wide_bar}} {{pos}}/{{len}} {unit}{{msg}}, {{elapsed}}, {{eta}} left");
            if let Ok(style) = ProgressStyle::with_template(&template) {
                bar.set_style(style);
            }
            // A part takes long. So the line appears at once, and shows the elapsed time.
            bar.tick();
            bar.enable_steady_tick(PERIOD);
            return Self { bar, lines: None };
        }
        Self::in_lines(length, unit, PERIOD, move |line| err!("{program}: {line}"))
    }

    /// Gives a line to `print` in each period.
    fn in_lines(length: u64, unit: &str, every: Duration, mut print: impl FnMut(String) + Send + 'static) -> Self {
        let bar = ProgressBar::hidden();
        bar.set_length(length);
        let (ended, until_ended) = channel::<()>();
        let (shown, unit) = (bar.clone(), unit.to_owned());
        let printer = std::thread::spawn(move || {
            while until_ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                let (done, more, s) = (shown.position(), shown.message(), shown.elapsed().as_secs());
                print(format!("{done}/{length} {unit}{more}, {s} s"));
            }
        });
        Self { bar, lines: Some((ended, printer)) }
    }

    /// Adds units that are done.
    pub fn add(&self, units: u64) {
        self.bar.inc(units);
    }

    /// Adds words behind the units.
    pub fn set_message(&self, words: String) {
        self.bar.set_message(words);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((ended, printer)) = self.lines.take() {
            drop(ended);
            let _ = printer.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_without_a_terminal_is_printed_in_lines() {
        let (sender, lines) = channel();
        let progress = Progress::in_lines(40, "ticks", Duration::from_millis(1), move |line| {
            let _ = sender.send(line);
        });
        assert!(lines.recv().unwrap().starts_with("0/40 ticks, 0 s"));
        progress.add(30);
        progress.set_message(", 2/7 goals".to_owned());
        // This many lines come by themselves, and the figures arrive in one of them.
        assert!(lines.iter().take(10_000).any(|line| line.starts_with("30/40 ticks, 2/7 goals, ")));
        drop(progress);
        // The printer has ended, so the lines do: this does not wait for ever.
        assert!(lines.iter().all(|line| line.contains("goals")));
    }
}
