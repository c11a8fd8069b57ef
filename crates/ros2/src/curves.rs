//! The conversation with trajectory controllers: what they were sent, and whether they execute it.

use crate::join::{Joined, Reference, agrees, continues};
use crate::trajectory::{Command, Past, Point, points};
use messages::{JOINTS_MAX, Stamp, tick_at};

/// Time by which the first point of a conversation lies in the past of the robot, ns: 25 ms, as long as the default delay.
pub(crate) const BEFORE_NS: u64 = 25_000_000;

/// The curves of one robot.
pub(crate) struct Curves {
    delay_ns: u64,
    past: Past,
    joined: Joined,
    reference: Reference,
    /// Acceleration limits, rad/s^2 or m/s^2.
    a_max: [f64; JOINTS_MAX],
    count: usize,
    departed: Option<String>,
}

/// State of the controllers at a look.
pub(crate) struct Known {
    pub(crate) now: Stamp,
    /// Bit j: a controller has joint j.
    pub(crate) joints: u32,
    /// All are active, with the joints of the robot file.
    pub(crate) active: bool,
    pub(crate) pressed: Option<bool>,
}

impl Curves {
    pub(crate) fn new(count: usize, delay_ns: u64, a_max: [f64; JOINTS_MAX]) -> Self {
        let (past, joined, reference) = (Past::default(), Joined::No, Reference::default());
        Self { delay_ns, past, joined, reference, a_max, count, departed: None }
    }

    /// Takes the setpoint `q` of the controller of joint `j`, which `name` names. `at` is its own time.
    pub(crate) fn hear(&mut self, j: usize, name: &str, q: f64, at: Option<Stamp>, now: Stamp) {
        self.reference.hear(j, q, now);
        let (Joined::Since(since), Some(at)) = (self.joined, at) else { return };
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

    pub(crate) fn departed(&self) -> Option<&str> {
        self.departed.as_deref()
    }

    /// The controllers' own setpoints, rad or m.
    pub(crate) fn held(&self) -> [f64; JOINTS_MAX] {
        self.reference.q
    }

    /// Notes that the robot fell silent.
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
    pub(crate) fn prepare(&mut self, commands: &[Command], known: &Known) -> bool {
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

    fn join_where_it_stands(&mut self, command: &Command, known: &Known) {
        let stands = self.reference.stands(known.joints, known.now);
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

    /// Notes that the command was sent.
    pub(crate) fn sent(&mut self, command: &Command) {
        self.past.sent(command);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use driver::Motion;
    use messages::deadline;

    /// Otherwise its controllers would bridge from where a joint is measured, off by what it lacks.
    #[test]
    fn first_message_begins_in_the_past_of_the_robot() {
        const DELAY_NS: u64 = 25_000_000;
        let mut curves = Curves::new(1, DELAY_NS, [8.0; JOINTS_MAX]);
        let (begin, k) = (Stamp(1_000_000_000), 2_000);
        curves.hear(0, "a", 0.3, None, begin);
        let now = deadline(k);
        let command = Command { k, motion: Motion::rest([0.3; JOINTS_MAX]) };
        let known = Known { now, joints: 1, active: true, pressed: Some(false) };
        assert!(curves.prepare(std::slice::from_ref(&command), &known));
        let (first, points) = curves.points(&command, 1);
        assert!(now.since(first) > DELAY_NS, "{} ns", now.since(first));
        assert!(points.iter().all(|point| point.positions == [0.3] && point.velocities == [0.0]));
        curves.sent(&command);
        let next = Command { k: k + 8, ..command };
        assert!(curves.prepare(std::slice::from_ref(&next), &Known { now: deadline(k + 8), ..known }));
    }
}
