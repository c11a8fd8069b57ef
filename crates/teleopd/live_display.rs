//! The live line of a run and, in a terminal, the two figures above it.

use crate::figure;
use crate::process::bus_failure;
use bus::{Domain, Reader};
use instance::Instance;
use messages::{Mode, RobotState, Service, Skeleton, Status};
use rt::{Failure, out};
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Longest line, one less than a terminal's width. A full line would wrap.
const LINE_MAX: usize = 79;

pub struct LiveDisplay {
    skeletons: Reader<Skeleton>,
    states: Reader<RobotState>,
    model: robot::Model,
    frames: robot::Frames,
    skeleton: Option<Skeleton>,
    state: Option<RobotState>,
    terminal: bool,
    colour: bool,
    quiet: bool,
    /// Number of lines in the last picture. The next picture overwrites them.
    drawn: usize,
    last: Option<(Instant, u64)>,
    _domain: Domain,
}

impl LiveDisplay {
    pub fn new(instance: &Instance, model: robot::Model, quiet: bool) -> Result<Self, Failure> {
        let domain = Domain::open(instance.core_domain(), "demo").map_err(bus_failure)?;
        let terminal = std::io::stdout().is_terminal();
        Ok(Self {
            skeletons: domain.reader(Service::Skeleton).map_err(bus_failure)?,
            states: domain.reader(Service::RobotState).map_err(bus_failure)?,
            model,
            frames: robot::Frames::default(),
            skeleton: None,
            state: None,
            terminal,
            colour: rt::wants_colour(terminal),
            quiet,
            drawn: 0,
            last: None,
            _domain: domain,
        })
    }

    /// Draws `status` and the progress: how many frames of the total are published.
    pub fn draw(&mut self, status: Option<Status>, progress: (u64, u64)) {
        self.skeleton = self.skeletons.latest().or(self.skeleton);
        self.state = self.states.latest().or(self.state);
        let (false, Some(status)) = (self.quiet, status) else { return };
        let rate_hz = self.last.map_or(0.0, |(at, ticks)| (status.ticks - ticks) as f64 / at.elapsed().as_secs_f64());
        // A rate over less than a second is noisy. Without a terminal, one line a second is enough.
        let second = self.last.is_none_or(|(at, _)| at.elapsed() >= Duration::from_secs(1));
        if !self.terminal && !second {
            return;
        }
        if second {
            self.last = Some((Instant::now(), status.ticks));
        }
        let line = line(&status, progress, rate_hz);
        if !self.terminal {
            out!("{line}");
            return;
        }
        let mut text = String::new();
        if self.drawn > 0 {
            text.push_str(&format!("\x1b[{}A", self.drawn));
        }
        let picture = self.picture();
        self.drawn = picture.lines().count() + 1;
        for row in picture.lines() {
            text.push_str(&format!("\x1b[2K{row}\n"));
        }
        let line = if self.colour { format!("{}{line}\x1b[0m", colour(&status)) } else { line };
        out!("{text}\x1b[2K{line}");
        let _ = std::io::stdout().flush();
    }

    /// Returns the figures. Empty until person and robot are known, and if the terminal is too small.
    fn picture(&mut self) -> String {
        let (Some(skeleton), Some(state), true) = (&self.skeleton, &self.state, fits()) else { return String::new() };
        let human = figure::human(&skeleton.positions);
        let robot = figure::robot(&self.model, &mut self.frames, &state.q);
        figure::picture(&human, &robot, self.colour)
    }

    pub fn end(&mut self) {
        self.quiet = true;
    }
}

/// Returns true if the terminal is as large as the picture. A terminal of unknown size counts as 80 by 24.
fn fits() -> bool {
    let (columns, rows) = ratatui::crossterm::terminal::size().unwrap_or_default();
    let (width, height) = figure::SIZE;
    (columns == 0 || usize::from(columns) >= width) && (rows == 0 || usize::from(rows) > height)
}

fn line(status: &Status, (frame, frames): (u64, u64), rate_hz: f64) -> String {
    let line = format!(
        "{:<14} {frame:>4}/{frames} {rate_hz:4.0} Hz, input {:.0} ms, nearest {:.0} mm, {:.1} deg behind",
        explain::activity(status).unwrap_or(explain::mode_name(status.mode)),
        status.input_age_ns as f64 * 1e-6,
        status.clearance_command_m * 1e3,
        status.limb_error_measured_rad.to_degrees(),
    );
    line.chars().take(LINE_MAX).collect()
}

/// Green while the robot follows, red once it is stopped, yellow in between.
fn colour(status: &Status) -> &'static str {
    match Mode::from_u32(status.mode) {
        Some(Mode::Engaged) => "\x1b[32m",
        Some(Mode::Faulted) | None => "\x1b[31m",
        Some(Mode::Engaging | Mode::Holding | Mode::Recovering) => "\x1b[33m",
        Some(Mode::Disengaged) => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn live_line_is_shorter_than_80_columns() {
        let mut status = Status { mode: Mode::Disengaged as u32, ..Status::ZERO };
        assert!(line(&status, (3, 1314), 1500.0).starts_with("Disengaged        3/1314 1500 Hz, input 0 ms"));
        (status.input_age_ns, status.clearance_command_m) = (u64::MAX, 123.0);
        status.limb_error_measured_rad = 3.1;
        assert!(line(&status, (120_000, 120_000), 99_999.0).chars().count() <= LINE_MAX);
    }
}
