//! The grippers of a robot with trajectory controllers. Never does IO, and never reads a clock.
//!
//! A message holds the last points of the fingers' way, the present point, and the point at which they rest if no message
//! follows. The fingers then stop by themselves, and hold. The robot executes it as late as the arms' curves.
//!
//! Nothing here delays the arms. A hand is *joined* where its controller holds the fingers, while the arms follow and the
//! commanded gripper rests. Its fingers stay there until the closure changes. Then each goes to its place on the line from
//! open to closed, no faster than the robot file allows.

use crate::trajectory::Point;
use driver::GRIPPER_RAMP_S;
use messages::{GripperMotion, Stamp, TICK_S, deadline};
use robot::{Finger, Gripper};
use std::collections::VecDeque;

/// Ticks between two points: 10.7 ms. It is every second message of the arms.
pub const PERIOD_TICKS: u64 = 2 * crate::trajectory::PERIOD_TICKS;
/// Number of points of the past: 107 ms. The robot executes up to 45 ms behind.
const HISTORY_POINTS: usize = 10;
/// Ticks between two messages to fingers that rest: 107 ms. A controller whose goal is not reached gives it up. Fingers that
/// press on something never reach theirs, so messages go on.
const REPEAT_TICKS: u64 = 10 * PERIOD_TICKS;
/// Longest time between two points of a conversation, ticks: 43 ms. It is less than half of the time in which fingers brake.
const GAP_TICKS: u64 = 4 * PERIOD_TICKS;
/// The last point rests for this long, s. The next message comes before.
const REST_S: f64 = 0.3;
/// Largest distance of a controller's setpoint from what it was sent, as a share of the way from open to closed.
/// Assumption.
const OFF: f64 = 0.05;
/// A setpoint that changes by less than this share of the way stands.
const STANDS: f64 = 1e-3;
/// Time for which a setpoint must stand before the hand is joined, ns. It is that of the arms.
const STANDS_NS: u64 = crate::reference::STANDS_NS;
/// Age at which a measurement is not known any more, ns.
const OLD_NS: u64 = 100_000_000;
/// Rounding of a position, rad or m.
const ROUNDING: f64 = 1e-9;

/// The fingers at a point of their way.
#[derive(Clone, Debug)]
struct FingerPoint {
    k: u64,
    q: Vec<f64>,
    v: Vec<f64>,
    /// Where they rest if nothing follows.
    end: Vec<f64>,
}

/// State of a hand and of its controller at a look.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    pub now: Stamp,
    /// The arms execute what they are sent.
    pub follows: bool,
    /// Ticks by which the first point of a conversation lies in the past.
    pub before_ticks: u64,
}

#[derive(Clone, Debug)]
pub struct Hand {
    /// Closures of the left or the right hand.
    side: usize,
    gripper: Gripper,
    /// Effort limits of the fingers, N m or N. Empty if they are not known.
    efforts: Vec<f64>,
    /// Its controller's own setpoint, and the time of its last change. Empty before the first.
    reference: Vec<f64>,
    changed: Stamp,
    /// Measured closure and force, and their time.
    measured: Option<(f64, f64, Stamp)>,
    /// The closure at which it was joined.
    joined: Option<f64>,
    /// The closure has changed since then.
    moves: bool,
    past: VecDeque<FingerPoint>,
    sent_k: u64,
    /// Why nothing is sent. None while it is joined.
    idle: Option<String>,
}

impl Hand {
    pub fn new(side: usize, gripper: Gripper) -> Self {
        let (efforts, reference, changed, past) = (Vec::new(), Vec::new(), Stamp::NONE, VecDeque::new());
        let (measured, joined, moves, sent_k, idle) = (None, None, false, 0, None);
        Self { side, gripper, efforts, reference, changed, measured, joined, moves, past, sent_k, idle }
    }

    pub fn fingers(&self) -> &[Finger] {
        &self.gripper.fingers
    }

    /// Takes the effort limits of the fingers, N m or N.
    pub fn limit(&mut self, efforts: Vec<f64>) {
        self.efforts = efforts;
    }

    /// Why nothing is sent to this hand. None while it is joined.
    pub fn idle(&self) -> Option<&str> {
        self.idle.as_deref()
    }

    pub fn leave(&mut self, why: String) {
        (self.joined, self.moves, self.idle) = (None, false, Some(why));
        self.past.clear();
    }

    /// Takes positions and efforts of all fingers, in the order of the robot file. `efforts` is empty if none are reported.
    pub fn measure(&mut self, q: &[f64], efforts: &[f64], now: Stamp) {
        let closure = self.closure(q).clamp(0.0, 1.0);
        if closure.is_finite() {
            self.measured = Some((closure, self.force_n(efforts), now));
        }
    }

    /// Force between the fingers by the share of the motors' efforts that closes them, N. 0 if no efforts are known.
    fn force_n(&self, efforts: &[f64]) -> f64 {
        let count = self.fingers().len();
        if efforts.len() != count || self.efforts.len() != count {
            return 0.0;
        }
        let share = |((finger, effort), limit): ((&Finger, &f64), &f64)| {
            (effort * (finger.closed - finger.open).signum() / limit).clamp(0.0, 1.0)
        };
        let shares: f64 = self.fingers().iter().zip(efforts).zip(&self.efforts).map(share).sum();
        let force_n = self.gripper.force_max_n * shares / count as f64;
        if force_n.is_finite() { force_n } else { 0.0 }
    }

    /// Mean of the fingers' closures. Fingers may turn and slide, so their units do not matter.
    fn closure(&self, q: &[f64]) -> f64 {
        let one = |(finger, q): (&Finger, &f64)| (q - finger.open) / (finger.closed - finger.open);
        self.fingers().iter().zip(q).map(one).sum::<f64>() / self.fingers().len() as f64
    }

    /// Measured closure, force and the controller's own closure at `now`. None if one of them is not known.
    pub fn state(&self, now: Stamp) -> Option<[f64; 3]> {
        let (closure, force_n, at) = self.measured?;
        let known = now.since(at) <= OLD_NS && !self.reference.is_empty();
        known.then(|| [closure, force_n, self.closure(&self.reference)])
    }

    /// Takes the controller's own setpoint, in the order of the robot file. One that is not where the fingers were sent ends
    /// the conversation.
    pub fn receive(&mut self, reference: &[f64], now: Stamp) {
        if reference.len() != self.fingers().len() || reference.iter().any(|q| !q.is_finite()) {
            return;
        }
        let range = |i: usize| (self.gripper.fingers[i].closed - self.gripper.fingers[i].open).abs();
        let stays = |i: usize| (reference[i] - self.reference[i]).abs() <= STANDS * range(i);
        if self.reference.is_empty() || !(0..reference.len()).all(stays) {
            self.changed = now;
            self.reference = reference.to_vec();
        }
        let strays = |i: &usize| {
            let sent = self.past.iter().flat_map(|moment| [moment.q[*i], moment.end[*i]]);
            let (low, high) = sent.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)));
            !(low - OFF * range(*i)..=high + OFF * range(*i)).contains(&reference[*i])
        };
        if self.joined.is_some()
            && let Some(i) = (0..reference.len()).find(strays)
        {
            let name = &self.fingers()[i].joint;
            self.leave(format!("the controller of `{name}` is not where it was sent"));
        }
    }

    /// Returns the time of the first point and the points of the message that is due at index `k`, if one is.
    pub fn next(&mut self, k: u64, motion: &GripperMotion, known: &Observation) -> Option<(Stamp, Vec<Point>)> {
        let (closure, rate) = (motion.closure[self.side], motion.rate[self.side]);
        if !known.follows {
            self.leave("the arms do not follow".to_owned());
            return None;
        }
        if !(closure.is_finite() && rate.is_finite())
            || (self.joined.is_none() && !self.begin_where_held(k, closure, rate, known))
        {
            return None;
        }
        let last = self.past.back()?;
        if k < last.k + PERIOD_TICKS {
            return None;
        }
        // By now the controller has braked the fingers by itself.
        if self.past.len() > 1 && k > last.k + GAP_TICKS {
            self.leave("the messages paused".to_owned());
            return None;
        }
        self.moves |= self.joined.is_some_and(|joined| (closure - joined).abs() > ROUNDING);
        let elapsed_s = (k - last.k) as f64 * TICK_S;
        let (mut q, mut v) = (last.q.clone(), vec![0.0; last.q.len()]);
        for (i, finger) in self.gripper.fingers.iter().enumerate().filter(|_| self.moves) {
            let range = finger.closed - finger.open;
            let (goal, most) = (finger.open + closure * range, self.gripper.speed * range.abs() * elapsed_s + ROUNDING);
            q[i] += (goal - q[i]).clamp(-most, most);
            v[i] = if (q[i] - goal).abs() <= ROUNDING { rate * range } else { (q[i] - last.q[i]) / elapsed_s };
        }
        let (end, stop_s) = self.rest(&q, &v);
        let rests = stop_s == 0.0 && self.past.iter().all(|moment| moment.q == q);
        self.past.push_back(FingerPoint { k, q, v, end });
        let repeats = k < self.sent_k + REPEAT_TICKS;
        let message = (!rests || !repeats).then(|| self.points(stop_s));
        while self.past.len() > HISTORY_POINTS {
            self.past.pop_front();
        }
        if message.is_some() {
            self.sent_k = k;
        }
        message
    }

    /// Begins where the controller holds the fingers, if they stand and the commanded gripper rests.
    fn begin_where_held(&mut self, k: u64, closure: f64, rate: f64, known: &Observation) -> bool {
        let why = if self.reference.is_empty() {
            "its controller does not say where it holds the fingers"
        } else if known.now.since(self.changed) < STANDS_NS {
            "its controller moves the fingers"
        } else if rate != 0.0 {
            "the hand closes or opens: it begins at rest"
        } else if (self.closure(&self.reference) - closure).abs() > OFF {
            "its controller holds the fingers elsewhere: the person's hand must meet them"
        } else {
            let (q, v) = (self.reference.clone(), vec![0.0; self.reference.len()]);
            let begin = FingerPoint { k: k.saturating_sub(known.before_ticks.max(PERIOD_TICKS)), end: q.clone(), q, v };
            (self.past, self.sent_k) = (VecDeque::from([begin]), 0);
            (self.joined, self.moves, self.idle) = (Some(closure), false, None);
            return true;
        };
        // The first reason says more.
        self.idle.get_or_insert_with(|| why.to_owned());
        false
    }

    /// Where the fingers rest if they brake from now on, and after which time, s. They brake as `driver` does: from full speed
    /// in [`GRIPPER_RAMP_S`].
    fn rest(&self, q: &[f64], v: &[f64]) -> (Vec<f64>, f64) {
        let share = |i: usize, finger: &Finger| v[i].abs() / (self.gripper.speed * (finger.closed - finger.open).abs());
        let fastest = self.fingers().iter().enumerate().map(|(i, finger)| share(i, finger)).fold(0.0, f64::max);
        let stop_s = GRIPPER_RAMP_S * fastest.min(1.0);
        let at = |(i, finger): (usize, &Finger)| {
            let (low, high) = (finger.open.min(finger.closed), finger.open.max(finger.closed));
            // A robot may hold a finger a little beyond its range.
            (q[i] + v[i] * stop_s / 2.0).clamp(low.min(q[i]), high.max(q[i]))
        };
        (self.fingers().iter().enumerate().map(at).collect(), stop_s)
    }

    /// The points of the message, and the time of the first one.
    fn points(&self, stop_s: f64) -> (Stamp, Vec<Point>) {
        let first = self.past.front().map_or(Stamp::NONE, |moment| deadline(moment.k));
        let point = |since_first_ns: u64, positions: &[f64], velocities: &[f64]| Point {
            since_first_ns,
            positions: positions.to_vec(),
            velocities: velocities.to_vec(),
        };
        let since = |moment: &FingerPoint| deadline(moment.k).since(first);
        let mut points: Vec<Point> =
            self.past.iter().map(|moment| point(since(moment), &moment.q, &moment.v)).collect();
        if let Some(now) = self.past.back() {
            let rest = vec![0.0; now.q.len()];
            // Two points of a controller may not have the same time.
            let stops = (stop_s > ROUNDING).then_some(stop_s);
            for time_s in stops.into_iter().chain([stop_s + REST_S]) {
                points.push(point(since(now) + (time_s * 1e9).round() as u64, &now.end, &rest));
            }
        }
        (first, points)
    }
}

#[cfg(test)]
mod tests;
