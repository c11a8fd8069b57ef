//! Samples a run at a few hundred instants a minute, in bounded memory. Pictures and summaries are made from it.

use crate::pauses::{Pause, PauseFinder};
use messages::{JOINTS_MAX, JointCommand, JointTarget, RobotState, Status};
use world::Moment;

/// Largest number of instants. If there are more, every second one is dropped.
const ROWS_MAX: usize = 12_000;
/// Initial time between two instants, ns: 60 per second.
const PERIOD_NS: u64 = 16_666_666;
/// Largest number of pauses that are kept.
const PAUSES_MAX: usize = 1_000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Time in the file, s from its first state.
    pub at_s: f64,
    pub measured: [f64; JOINTS_MAX],
    pub command: Option<[f64; JOINTS_MAX]>,
    /// Positions of the newest target, and the mask of its joints. Joints without a target are left out.
    pub target: Option<([f64; JOINTS_MAX], u32)>,
    pub clearance_mm: Option<f64>,
    /// Time from seeing the person to executing the first command for that frame, ms. None without a person.
    pub latency_ms: Option<f64>,
    pub mode: u32,
}

#[derive(Clone, Debug, Default)]
pub struct Trace {
    rows: Vec<Row>,
    begin_ns: Option<u64>,
    period_ns: u64,
    next_ns: u64,
    command: Option<[f64; JOINTS_MAX]>,
    target: Option<([f64; JOINTS_MAX], u32)>,
    status: Option<(f64, u32)>,
    /// Origin that was executed last, and its age when it was first executed, ms.
    origin: u64,
    latency_ms: Option<f64>,
    finder: PauseFinder,
    newest_ns: u64,
    pauses: Vec<(f64, Pause)>,
}

impl Trace {
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Pauses of the machine, with the time of their end, s from the first state.
    pub fn pauses(&self) -> &[(f64, Pause)] {
        &self.pauses
    }

    /// Keeps a pause that ended at `end_ns`, and returns it.
    fn keep(&mut self, pause: Option<Pause>, end_ns: u64) -> Option<Pause> {
        if let (Some(pause), Some(begin_ns), true) = (pause, self.begin_ns, self.pauses.len() < PAUSES_MAX) {
            self.pauses.push((end_ns.saturating_sub(begin_ns) as f64 * 1e-9, pause));
        }
        pause
    }

    pub fn target(&mut self, target: &JointTarget) -> Option<Pause> {
        self.target = Some((target.q, target.valid_mask));
        let pause = self.finder.target(target);
        self.keep(pause, target.header.stamp.0)
    }

    pub fn command(&mut self, command: &JointCommand) {
        self.command = Some(command.q);
    }

    pub fn status(&mut self, status: &Status) -> Option<Pause> {
        self.status = Some((status.clearance_command_m * 1e3, status.mode));
        let pause = self.finder.status(status);
        self.keep(pause, status.header.stamp.0)
    }

    /// Ends a pause that lasts until the end of the run.
    pub fn finish(&mut self) -> Option<Pause> {
        let pause = self.finder.end();
        self.keep(pause, self.newest_ns)
    }

    /// Notes a state, and stores an instant if one is due.
    pub fn state(&mut self, state: &RobotState) -> Option<Pause> {
        self.store(state);
        self.newest_ns = state.header.stamp.0;
        let pause = self.finder.state(state);
        self.keep(pause, state.header.stamp.0)
    }

    fn store(&mut self, state: &RobotState) {
        let at_ns = state.header.stamp.0;
        let origin = state.header.origin;
        if origin.0 != self.origin {
            self.origin = origin.0;
            self.latency_ms = (origin.0 > 0).then(|| state.header.stamp.since(origin) as f64 * 1e-6);
        }
        if at_ns < self.next_ns || state.q_measured.iter().any(|q| !q.is_finite()) {
            return;
        }
        self.period_ns = self.period_ns.max(PERIOD_NS);
        self.next_ns = at_ns.saturating_add(self.period_ns);
        if self.rows.len() >= ROWS_MAX {
            let mut keep = false;
            self.rows.retain(|_| {
                keep = !keep;
                keep
            });
            self.period_ns = self.period_ns.saturating_mul(2);
        }
        let begin_ns = *self.begin_ns.get_or_insert(at_ns);
        self.rows.push(Row {
            at_s: (at_ns.saturating_sub(begin_ns)) as f64 * 1e-9,
            measured: state.q_measured,
            command: self.command,
            target: self.target,
            // The value is exactly zero before the first command.
            clearance_mm: self.status.map(|(clearance_mm, _)| clearance_mm).filter(|mm| mm.is_finite() && *mm != 0.0),
            latency_ms: self.latency_ms,
            mode: self.status.map_or(0, |(_, mode)| mode),
        });
    }

    pub fn moment(&mut self, moment: &Moment) {
        if let Some(target) = &moment.target {
            self.target(target);
        }
        if let Some(control) = &moment.control {
            self.status(&control.status);
            if let Some(command) = &control.command {
                self.command(command);
            }
        }
        if let Some(robot) = &moment.robot {
            self.state(robot);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, Stamp};

    #[test]
    fn trace_of_a_long_run_stays_bounded_and_covers_it_all() {
        let mut trace = Trace::default();
        let mut state = RobotState::ZERO;
        for second in 0..40_000_u64 {
            state.header.stamp = Stamp(1 + second * 1_000_000_000);
            trace.state(&state);
        }
        assert!(trace.rows().len() <= ROWS_MAX);
        assert!(trace.rows().last().unwrap().at_s > 39_000.0);
        assert!(trace.rows().windows(2).all(|pair| pair[0].at_s < pair[1].at_s));
    }
}
