//! The conversation with trajectory controllers: what they were sent, and whether they execute it.

use crate::clock::SETTLES_NS;
use crate::reference::{Joined, Reference, agrees, continues};
use crate::trajectory::{Command, History, Point, points};
use messages::{JOINTS_MAX, Stamp, deadline, tick_at};

/// Time by which the first point of a conversation lies in the past of the robot, ns: 25 ms, as long as the default delay.
pub(crate) const BEFORE_NS: u64 = 25_000_000;

pub(crate) struct Curves {
    delay_ns: u64,
    past: History,
    joined: Joined,
    reference: Reference,
    /// Acceleration limits, rad/s^2 or m/s^2.
    a_max: [f64; JOINTS_MAX],
    count: usize,
    departed: Option<String>,
    /// The robot executes the last message from this time on, by a clock that is known.
    executed: Stamp,
}

/// State of the controllers at a look.
pub(crate) struct Observation {
    pub(crate) now: Stamp,
    /// Bit j: a controller has joint j.
    pub(crate) joints: u32,
    /// All are active, with the joints of the robot file, and their clock has settled.
    pub(crate) active: bool,
    pub(crate) pressed: Option<bool>,
}

impl Curves {
    pub(crate) fn new(count: usize, delay_ns: u64, a_max: [f64; JOINTS_MAX]) -> Self {
        let (past, joined, reference) = (History::default(), Joined::No, Reference::default());
        Self { delay_ns, past, joined, reference, a_max, count, departed: None, executed: Stamp::NONE }
    }

    /// Takes the setpoint `q` of the controller of joint `j`, which `name` names. `at` is its own time.
    pub(crate) fn receive(&mut self, j: usize, name: &str, q: f64, at: Stamp) {
        self.reference.receive(j, q, at);
        let Joined::Since(since) = self.joined else { return };
        let then = Stamp(at.0.saturating_sub(self.delay_ns));
        if then.since(since) == 0 {
            return;
        }
        if let Some(sent) = self.past.expected(then)
            && !agrees(q, sent.q[j], sent.v[j])
        {
            let off = (q - sent.q[j]) * 1e3;
            self.depart(format!(
                "the controller of `{name}` is {off:.1} mrad or mm off what it was sent: messages were lost"
            ));
        }
    }

    pub(crate) fn depart(&mut self, why: String) {
        if self.joined != Joined::Departed {
            self.joined = Joined::Departed;
            self.departed = Some(why);
            self.past.clear();
        }
    }

    /// Forgets what was heard until `now`, because its times mean nothing any more. A new offset is exact once it has settled.
    pub(crate) fn lose_clock(&mut self, now: Stamp) {
        self.reference = Reference::default();
        self.executed = self.executed.max(now.plus_ns(SETTLES_NS));
    }

    pub(crate) fn departed(&self) -> Option<&str> {
        self.departed.as_deref()
    }

    /// The controllers' own setpoints, rad or m.
    pub(crate) fn held(&self) -> [f64; JOINTS_MAX] {
        self.reference.q
    }

    pub(crate) fn fall_silent(&mut self) {
        if matches!(self.joined, Joined::Since(_)) {
            self.depart("the robot fell silent".to_owned());
        }
    }

    /// True while the robot is not known to do something else.
    pub(crate) fn follows(&self) -> bool {
        self.joined != Joined::Departed
    }

    /// Prepares the message of the last of `commands`. Returns true if it may be sent.
    pub(crate) fn prepare(&mut self, commands: &[Command], known: &Observation) -> bool {
        let Some(command) = commands.last() else { return false };
        match (self.joined, known.pressed) {
            (Joined::Since(_), Some(false)) => {
                let executing_k = tick_at(Stamp(known.now.0.saturating_sub(self.delay_ns)));
                let from = self.past.prepare(commands, executing_k);
                if !from.is_some_and(|from| continues(&self.a_max, &from, command)) {
                    self.depart("a setpoint did not continue what the robot executes".to_owned());
                }
            }
            (Joined::Since(_), None) => {
                self.depart("nobody says whether the emergency stop is pressed: its publisher left".to_owned());
            }
            (Joined::Since(_), Some(true)) => self.depart("the emergency stop is pressed".to_owned()),
            (Joined::No | Joined::Departed, _) => self.join_where_it_stands(command, known),
        }
        matches!(self.joined, Joined::Since(_))
    }

    fn join_where_it_stands(&mut self, command: &Command, known: &Observation) {
        let stands = self.reference.stands(known.joints, self.executed);
        let meets = stands && self.reference.meets(&command.motion, self.count);
        if known.active && meets && known.pressed == Some(false) {
            // A controller bridges from the measured position to a first point in the future. This one lies in its past.
            self.past.begin(command, tick_at(Stamp(self.delay_ns + BEFORE_NS)));
            (self.joined, self.departed) = (Joined::Since(known.now), None);
        } else {
            self.joined = Joined::Departed;
            self.departed.get_or_insert_with(|| "the robot does not stand where the driver begins".to_owned());
        }
    }

    /// The points for the joints in `joints`, and the time of the first one.
    pub(crate) fn points(&self, command: &Command, joints: u32) -> (Stamp, Vec<Point>) {
        points(self.past.points(), command, joints)
    }

    pub(crate) fn sent(&mut self, command: &Command) {
        self.past.sent(command);
        self.executed = deadline(command.k).plus_ns(self.delay_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::JointMotion;

    /// Otherwise its controllers would bridge from where a joint is measured, off by what it lacks.
    #[test]
    fn first_message_begins_in_the_past_of_the_robot() {
        const DELAY_NS: u64 = 25_000_000;
        let mut curves = Curves::new(1, DELAY_NS, [8.0; JOINTS_MAX]);
        let (begin, k) = (Stamp(1_000_000_000), 2_000);
        let now = deadline(k);
        curves.receive(0, "a", 0.3, begin);
        curves.receive(0, "a", 0.3, now);
        let command = Command { k, motion: JointMotion::rest([0.3; JOINTS_MAX]) };
        let known = Observation { now, joints: 1, active: true, pressed: Some(false) };
        assert!(curves.prepare(std::slice::from_ref(&command), &known));
        let (first, points) = curves.points(&command, 1);
        assert!(now.since(first) > DELAY_NS, "{} ns", now.since(first));
        assert!(points.iter().all(|point| point.positions == [0.3] && point.velocities == [0.0]));
        curves.sent(&command);
        let next = Command { k: k + 8, ..command };
        assert!(curves.prepare(std::slice::from_ref(&next), &Observation { now: deadline(k + 8), ..known }));
    }

    /// A robot that stood, was sent a motion and fell silent may move meanwhile.
    #[test]
    fn f117_silent_robot_is_joined_after_it_was_seen_to_stand_since_the_last_message() {
        const DELAY_NS: u64 = 25_000_000;
        let mut curves = Curves::new(1, DELAY_NS, [8.0; JOINTS_MAX]);
        let rest = |k: u64| Command { k, motion: JointMotion::rest([0.3; JOINTS_MAX]) };
        let known = |k: u64| Observation { now: deadline(k), joints: 1, active: true, pressed: Some(false) };
        (0..=30).for_each(|n| curves.receive(0, "a", 0.3, deadline(2_000 + 15 * n)));
        assert!(curves.prepare(&[rest(2_450)], &known(2_450)));
        curves.sent(&rest(2_450));
        curves.fall_silent();
        // The robot executes that message from 2_487.5 on, and 200 ms are 300 ticks.
        for (heard, joins) in [(2_455, false), (2_480, false), (2_786, false), (2_788, true)] {
            curves.receive(0, "a", 0.3, deadline(heard));
            assert_eq!(curves.prepare(&[rest(3_500)], &known(3_500)), joins, "{heard}");
        }
    }

    /// Late stamps make a new offset too small. Setpoints then seem newer than they are.
    #[test]
    fn f117_robot_whose_clock_jumped_is_joined_after_the_new_clock_settled() {
        let mut curves = Curves::new(1, 25_000_000, [8.0; JOINTS_MAX]);
        let rest = Command { k: 9_000, motion: JointMotion::rest([0.3; JOINTS_MAX]) };
        let known = Observation { now: deadline(9_000), joints: 1, active: true, pressed: Some(false) };
        (0..=30).for_each(|n| curves.receive(0, "a", 0.3, deadline(2_000 + 15 * n)));
        curves.lose_clock(deadline(2_450));
        // 1 s and 200 ms are 1800 ticks.
        for (heard, joins) in [(2_451, false), (4_240, false), (4_251, true)] {
            curves.receive(0, "a", 0.3, deadline(heard));
            assert_eq!(curves.prepare(&[rest], &known), joins, "{heard}");
        }
    }
}
