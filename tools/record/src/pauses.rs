//! Finds pauses of this machine in the messages of a run: ticks that a process did not run, and a robot that sent nothing.

use messages::{Header, JointTarget, RobotState, Stamp, Status, TICK_HZ, state_flag};

/// Shortest pause that is marked, ns: 10 ms. `control` may miss ten deadlines in a row, 7 ms, before a robot stops.
const PAUSE_NS: u64 = 10_000_000;

/// A time in which a process ran no tick, or in which the robot was not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pause {
    pub subject: &'static str,
    pub length_ns: u64,
}

impl Pause {
    fn new(subject: &'static str, length_ns: u64) -> Option<Self> {
        (length_ns >= PAUSE_NS).then_some(Self { subject, length_ns })
    }

    pub fn length_s(&self) -> f64 {
        self.length_ns as f64 * 1e-9
    }

    pub fn text(&self) -> String {
        format!("{} for {:.0} ms", self.subject, self.length_s() * 1e3)
    }
}

/// The newest message of a process that counts its ticks.
#[derive(Clone, Copy, Debug, Default)]
struct Ticks(Option<Header>);

impl Ticks {
    /// Returns the time without ticks since the last message that was seen. Messages in between, which the recorder missed or
    /// left out, count as ticks.
    fn lost_ns(&mut self, header: &Header) -> u64 {
        let Some(last) = self.0.replace(*header).filter(|last| last.incarnation == header.incarnation) else {
            return 0;
        };
        let ran_ns = header.sequence.saturating_sub(last.sequence).saturating_mul(1_000_000_000) / TICK_HZ;
        header.stamp.since(last.stamp).saturating_sub(ran_ns)
    }
}

/// Takes messages in their order, and returns a pause when it is over.
#[derive(Clone, Copy, Debug, Default)]
pub struct PauseFinder {
    retarget: Ticks,
    driver: Ticks,
    /// Writer and missed deadlines of the newest status.
    missed: Option<(u32, u64)>,
    unseen_since: Option<Stamp>,
}

impl PauseFinder {
    pub fn target(&mut self, target: &JointTarget) -> Option<Pause> {
        Pause::new("the machine paused retarget", self.retarget.lost_ns(&target.header))
    }

    pub fn state(&mut self, state: &RobotState) -> Option<Pause> {
        if let Some(pause) = Pause::new("the machine paused the driver", self.driver.lost_ns(&state.header)) {
            return Some(pause);
        }
        if state.flags & state_flag::UNSEEN != 0 {
            self.unseen_since.get_or_insert(state.header.stamp);
            return None;
        }
        self.end()
    }

    /// Ends the time in which the robot was not seen, with the newest state.
    pub fn end(&mut self) -> Option<Pause> {
        let (since, Ticks(newest)) = (self.unseen_since.take()?, self.driver);
        Pause::new("the robot sent no measurement", newest?.stamp.since(since))
    }

    pub fn status(&mut self, status: &Status) -> Option<Pause> {
        let (writer, missed) = (status.header.incarnation, status.missed_deadlines);
        let (_, before) = self.missed.replace((writer, missed)).filter(|(known, _)| *known == writer)?;
        Pause::new("the machine paused control", missed.saturating_sub(before).saturating_mul(1_000_000_000) / TICK_HZ)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn pause_is_found_and_what_the_recorder_missed_is_none() {
        let header =
            |sequence, ms: u64| Header { sequence, stamp: Stamp(1 + ms * 1_000_000), incarnation: 1, ..Header::ZERO };
        let mut finder = PauseFinder::default();
        let state = |header, flags| RobotState { header, flags, ..RobotState::ZERO };
        // Every third message, then a recorder that is 60 ms late, a driver that is, and a driver that starts again.
        assert_eq!(finder.state(&state(header(3, 2), 0)), None);
        assert_eq!(finder.state(&state(header(93, 62), 0)), None);
        let pause = finder.state(&state(header(96, 124), 0)).expect("a pause");
        assert_eq!(pause.text(), "the machine paused the driver for 60 ms");
        let other = Header { incarnation: 2, ..header(1, 900) };
        assert_eq!(finder.state(&state(other, 0)), None);
        // The robot is unseen over two messages.
        let other = |sequence, ms| Header { incarnation: 2, ..header(sequence, ms) };
        assert_eq!(finder.state(&state(other(4, 902), state_flag::UNSEEN)), None);
        assert_eq!(finder.state(&state(other(34, 922), state_flag::UNSEEN)), None);
        let pause = finder.state(&state(other(64, 942), 0)).expect("a pause");
        assert_eq!(pause.text(), "the robot sent no measurement for 40 ms");
        // It is unseen until the end.
        let ends = [(94, 962), (124, 982)].map(|(n, ms)| finder.state(&state(other(n, ms), state_flag::UNSEEN)));
        assert_eq!((ends, finder.end().map(|pause| pause.length_ns)), ([None; 2], Some(20_000_000)));
        let status = |missed_deadlines| Status { missed_deadlines, ..Status::ZERO };
        assert_eq!(
            [0, 9, 24].map(|missed| finder.status(&status(missed)).map(|pause| pause.length_ns)),
            [None, None, Some(10_000_000)]
        );
    }
}
