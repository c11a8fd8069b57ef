//! A stream of positions, for a robot that holds the last one by itself.
//!
//! Nobody in such a robot plays a stop. If the loop falls silent in motion, the robot departs or the program ends, this thread
//! plays the certified stop. If this process dies, the robot holds the last position at once, from any speed.
//!
//! Where the robot blends two controllers by a *weight*, the weight rises from 0 to 1 before anything moves. The robot is
//! commanded to where it was measured meanwhile. After the last stop the weight falls again. The posture is held meanwhile.
//!
//! The controllers report no setpoint, so the robot's joints are compared with what was sent. A joint lags by at most
//! [`LAG_MAX_NS`], and must be within [`HELD`] of the positions of that time. Smaller errors are for `safety`.

use crate::estimate::Sample;
use crate::join::{HELD, MEETS, STANDS_NS, continues};
use crate::trajectory::Command;
use driver::Motion;
use messages::{JOINTS_MAX, Stamp, TICK_S, tick_at};
use std::collections::VecDeque;

/// Longest lag of a joint behind what was sent, ns: the most that `ros2.servo_lag_ms` may be, and two samples at 50 Hz.
const LAG_MAX_NS: u64 = 140_000_000;
/// Time for which sent positions are remembered, ns. The newest joint state may be 0.1 s old.
const REMEMBERED_NS: u64 = 300_000_000;
/// Silence of the loop after which the thread plays the stop, ticks: 10 ms, the most that `driver.silence_latch_ms` may be.
const LOOP_SILENT_TICKS: u64 = 15;
/// Time without a position after which the robot stands at the last one, ticks: 20 ms. It begins after the silence of a loop
/// and its jitter. Assumption.
const STOOD_TICKS: u64 = 30;
/// Largest age of the measurement of a robot that is joined again, ns. It is half of the silence after which it departs.
const FRESH_NS: u64 = 50_000_000;
/// A standing joint stays within this, rad or m. It is the band in which `safety` judges rest.
const STANDS: f64 = 0.005;
/// Rate of the weight, 1/s. Source: `weight_rate` in unitree_sdk2's g1_arm7_sdk_dds_example.
pub const WEIGHT_RATE_PER_S: f64 = 0.2;

/// State of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing was sent yet, or nothing any more.
    Released,
    /// The weight rises.
    Rising,
    /// The robot follows the loop.
    Following,
    /// The stop is played, then the weight falls.
    Stopping,
    /// The robot's emergency stop is pressed. The position that it gets is the measured one, so its release moves nothing.
    Pressed,
}

/// Setpoint that the robot gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Joint positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Weight, 0 to 1.
    pub weight: f64,
}

/// State of the robot at a look.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Time of the look.
    pub now: Stamp,
    /// The newest measurement.
    pub sample: Option<&'a Sample>,
    /// The emergency stop. None if nobody says.
    pub pressed: Option<bool>,
}

/// The stream to one robot.
#[derive(Clone, Debug)]
pub struct Stream {
    count: usize,
    period_ticks: u64,
    weighs: bool,
    a_max: [f64; JOINTS_MAX],
    phase: Phase,
    /// Command that the robot was sent last, and the tick at which it was sent.
    last: Command,
    sent_k: u64,
    /// The loop has commanded since the stream began.
    commanded: bool,
    weight: f64,
    recent: VecDeque<(Stamp, [f64; JOINTS_MAX])>,
    /// Posture within whose band the robot stands, and since when.
    stood: Option<(Stamp, [f64; JOINTS_MAX])>,
    departed: Option<String>,
}

impl Stream {
    /// A stream to `count` joints, one position each `period_ticks`. With `weighs`, the robot has a weight.
    pub fn new(count: usize, period_ticks: u64, weighs: bool, a_max: [f64; JOINTS_MAX]) -> Self {
        Self {
            count,
            period_ticks,
            weighs,
            a_max,
            phase: Phase::Released,
            last: Command { k: 0, motion: Motion::rest([0.0; JOINTS_MAX]) },
            sent_k: 0,
            commanded: false,
            weight: 0.0,
            recent: VecDeque::new(),
            stood: None,
            departed: None,
        }
    }

    /// Begins at the measured posture.
    pub fn begin(&mut self, measured: &[f64; JOINTS_MAX], now: Stamp) {
        let k = tick_at(now);
        self.last = Command { k, motion: Motion::rest(*measured) };
        (self.sent_k, self.commanded, self.departed) = (k, false, None);
        self.recent = VecDeque::from([(Stamp(now.0.saturating_sub(REMEMBERED_NS)), *measured)]);
        (self.phase, self.weight) = if self.weighs { (Phase::Rising, 0.0) } else { (Phase::Following, 1.0) };
    }

    /// True while the robot follows the loop.
    pub fn follows(&self) -> bool {
        self.phase == Phase::Following
    }

    /// True once nothing is sent any more.
    pub fn is_released(&self) -> bool {
        self.phase == Phase::Released
    }

    /// Position at which the robot is held, rad or m.
    pub fn held(&self) -> &[f64; JOINTS_MAX] {
        &self.last.motion.q
    }

    /// Why the robot does not follow. None while it does.
    pub fn departed(&self) -> Option<&str> {
        self.departed.as_deref()
    }

    /// Plays the stop, and gives the robot back.
    pub fn depart(&mut self, why: String) {
        if matches!(self.phase, Phase::Rising | Phase::Following | Phase::Pressed) {
            self.phase = Phase::Stopping;
            self.departed = Some(why);
        }
    }

    /// Compares a measurement with what was sent. `names` are those of the joints.
    pub fn compare(&mut self, sample: &Sample, names: &[String]) {
        let strays = |from: &[f64; JOINTS_MAX]| (0..self.count).any(|j| !((sample.q[j] - from[j]).abs() <= STANDS));
        if self.stood.as_ref().is_none_or(|(_, from)| strays(from)) {
            self.stood = Some((sample.measured, sample.q));
        }
        // A weight of less than one leaves the robot to another controller too, but the posture stays the same.
        if !matches!(self.phase, Phase::Rising | Phase::Following) {
            return;
        }
        let (from, until) = (Stamp(sample.measured.0.saturating_sub(LAG_MAX_NS)), sample.measured);
        // The position in force at the beginning counts, too.
        let first = self.recent.iter().rposition(|(at, _)| *at <= from).unwrap_or(0);
        let window = || self.recent.iter().skip(first).take_while(|(at, _)| *at <= until);
        for j in 0..self.count {
            let (low, high) =
                window().fold((f64::INFINITY, -f64::INFINITY), |(low, high), (_, q)| (low.min(q[j]), high.max(q[j])));
            if low <= high && !((low - HELD..=high + HELD).contains(&sample.q[j])) {
                let off = (sample.q[j] - sample.q[j].clamp(low, high)) * 1e3;
                let name = &names[j];
                return self.depart(format!("`{name}` is {off:.0} mrad or mm from where it was sent"));
            }
        }
    }

    /// Returns the position that the robot gets now, if it gets one. `commands` are those of the loop since the last call.
    pub fn next(&mut self, commands: &[Command], known: &Known) -> Option<Position> {
        let k = tick_at(known.now);
        match self.phase {
            Phase::Released => return self.rejoin(commands.last()?, known),
            Phase::Following if known.pressed != Some(false) => self.feel(known.pressed),
            Phase::Following => self.take(commands.last(), k)?,
            _ if k < self.sent_k + self.period_ticks => return None,
            Phase::Rising => self.rise(known.pressed, k),
            Phase::Stopping => self.stop(k),
            Phase::Pressed => self.rest_at(known),
        }
        self.sent_k = k;
        self.recent.push_back((known.now, self.last.motion.q));
        while self.recent.len() > 1 && self.recent[1].0.0 + REMEMBERED_NS < known.now.0 {
            self.recent.pop_front();
        }
        Some(Position { q: self.last.motion.q, weight: self.weight })
    }

    /// Part of the weight's way since the last position. A pause does not make it faster.
    fn step(&self, k: u64) -> f64 {
        (k - self.sent_k).min(2 * self.period_ticks) as f64 * TICK_S * WEIGHT_RATE_PER_S
    }

    fn rise(&mut self, pressed: Option<bool>, k: u64) {
        if pressed != Some(false) {
            return self.feel(pressed);
        }
        self.weight = (self.weight + self.step(k)).min(1.0);
        if self.weight == 1.0 {
            self.phase = Phase::Following;
        }
    }

    /// Reacts to an emergency stop that is not known to be released.
    fn feel(&mut self, pressed: Option<bool>) {
        if pressed.is_none() {
            return self.depart("nobody says whether the emergency stop is pressed: its publisher left".to_owned());
        }
        self.depart("the emergency stop is pressed".to_owned());
        if !self.weighs {
            self.phase = Phase::Pressed;
        }
    }

    /// Takes the loop's newest command. None if nothing is due.
    fn take(&mut self, command: Option<&Command>, k: u64) -> Option<()> {
        let Some(command) = command else {
            // A robot that stands is held without the loop, too.
            if !self.commanded || self.last.motion.at_rest() {
                return (k >= self.sent_k + self.period_ticks).then_some(());
            }
            if k <= self.last.k + LOOP_SILENT_TICKS {
                return None;
            }
            self.depart("the driver's loop fell silent".to_owned());
            self.stop(k);
            return Some(());
        };
        self.commanded = true;
        let moved = |j: usize| (command.motion.q[j] - self.last.motion.q[j]).abs();
        if self.has_stood(k) || (0..self.count).any(|j| !(moved(j) <= HELD)) {
            self.last.motion = Motion::rest(self.last.motion.q);
            self.depart("this machine paused in motion, or a setpoint jumped".to_owned());
        } else if !continues(&self.a_max, &self.last, command) {
            self.depart("a setpoint did not continue what the robot executes".to_owned());
            self.stop(k);
        } else {
            self.last = *command;
        }
        Some(())
    }

    /// True if this thread paused in motion for so long that the robot stands meanwhile. It may not be set in motion again.
    fn has_stood(&self, k: u64) -> bool {
        !self.last.motion.at_rest() && k > self.sent_k + STOOD_TICKS
    }

    fn stop(&mut self, k: u64) {
        if self.has_stood(k) {
            self.last.motion = Motion::rest(self.last.motion.q);
        } else if !self.last.motion.at_rest() {
            // After a short pause the stop goes on where it was.
            self.last.motion.play((k - self.sent_k).min(2 * self.period_ticks));
        } else if self.weighs && self.weight > 0.0 {
            self.weight = (self.weight - self.step(k)).max(0.0);
        } else {
            self.phase = Phase::Released;
        }
    }

    fn rest_at(&mut self, known: &Known) {
        if known.pressed == Some(false) {
            self.phase = Phase::Stopping;
        } else if let Some(sample) = known.sample {
            self.last.motion = Motion::rest(sample.q);
        }
    }

    /// Follows the loop again where the robot stands and is held. A robot with a weight was given back for good.
    fn rejoin(&mut self, command: &Command, known: &Known) -> Option<Position> {
        let (stood, _) = self.stood.filter(|(since, _)| known.now.since(*since) >= STANDS_NS)?;
        let fresh = |sample: &&Sample| known.now.since(sample.measured) <= FRESH_NS;
        let sample = known.sample.filter(|sample| sample.measured >= stood).filter(fresh)?;
        let near = |a: &[f64; JOINTS_MAX], b: &[f64; JOINTS_MAX], most: f64| {
            (0..self.count).all(|j| (a[j] - b[j]).abs() <= most)
        };
        let stands = near(&sample.q, self.held(), HELD);
        let meets = command.motion.at_rest() && near(&command.motion.q, self.held(), MEETS);
        if !self.weighs && self.departed.is_some() && known.pressed == Some(false) && stands && meets {
            let held = *self.held();
            self.begin(&held, known.now);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Layout, StopPlan, deadline};
    use wbc::JointStop;

    const A: f64 = 8.0;
    const PERIOD: u64 = 6;
    const START: u64 = 1_500;

    /// A stream, the tick at which it is, and everything that it sent since.
    struct Rig {
        stream: Stream,
        k: u64,
        pressed: Option<bool>,
        sent: Vec<(u64, Position)>,
    }

    impl Rig {
        fn new(weighs: bool) -> Self {
            let mut stream = Stream::new(2, PERIOD, weighs, [A; JOINTS_MAX]);
            stream.begin(&[0.3; JOINTS_MAX], deadline(START));
            Self { stream, k: START, pressed: Some(false), sent: Vec::new() }
        }

        fn sample(&self, off: f64) -> Sample {
            let q = self.stream.held().map(|q| q + off);
            Sample { measured: deadline(self.k), q, dq: [0.0; JOINTS_MAX] }
        }

        fn turn(&mut self, commands: &[Command]) {
            self.k += PERIOD;
            let sample = self.sample(0.0);
            let known = Known { now: deadline(self.k), sample: Some(&sample), pressed: self.pressed };
            if let Some(position) = self.stream.next(commands, &known) {
                self.sent.push((self.k, position));
            }
        }

        fn turn_for(&mut self, seconds: f64) {
            (0..(seconds / TICK_S) as u64 / PERIOD).for_each(|_| self.turn(&[]));
        }

        /// Lets the loop command a motion that speeds up to 0.4 rad/s.
        fn speed_up(&mut self) {
            let begin = self.k;
            for _ in 0..50 {
                let k = self.k + PERIOD;
                self.turn(&[Command { k, motion: moving((k - begin) as f64 * TICK_S) }]);
            }
            assert!(self.stream.follows() && self.stream.last.motion.v[0] > 0.3);
        }

        /// Largest acceleration of what was sent, by the limit.
        fn jolt(&self) -> f64 {
            let h = PERIOD as f64 * TICK_S;
            let q: Vec<f64> = self.sent.iter().map(|(_, position)| position.q[0]).collect();
            q.windows(3).map(|q| (q[2] - 2.0 * q[1] + q[0]).abs() / (h * h * A)).fold(0.0, f64::max)
        }

        /// Largest rate of the weight, 1/s.
        fn rate(&self) -> f64 {
            let rate = |pair: &[(u64, Position)]| {
                (pair[1].1.weight - pair[0].1.weight).abs() / ((pair[1].0 - pair[0].0) as f64 * TICK_S)
            };
            self.sent.windows(2).map(rate).fold(0.0, f64::max)
        }
    }

    /// A motion with 2 rad/s^2 from rest at 0.3 rad, `t` seconds after it began.
    fn moving(t: f64) -> Motion {
        let mut motion = Motion::rest([0.3 + t * t; JOINTS_MAX]);
        let mut plan = StopPlan::ZERO;
        (motion.v, motion.a) = ([2.0 * t; JOINTS_MAX], [2.0; JOINTS_MAX]);
        for j in 0..JOINTS_MAX {
            JointStop::new(2.0 * t, 2.0, A, 320.0).store(&mut plan, j);
        }
        motion.plan = plan;
        motion
    }

    #[test]
    fn weight_rises_and_falls_slowly_where_the_robot_is_held() {
        let mut rig = Rig::new(true);
        rig.turn_for(4.9);
        assert!(!rig.stream.follows(), "the loop may not move it yet");
        rig.turn_for(0.2);
        assert!(rig.stream.follows() && rig.stream.weight == 1.0);
        assert!(rig.sent.iter().all(|(_, position)| position.q == [0.3; JOINTS_MAX]));
        rig.stream.depart("the driver ends".to_owned());
        rig.turn_for(4.9);
        assert!(!rig.stream.is_released());
        rig.turn_for(0.2);
        assert!(rig.stream.is_released() && rig.stream.weight == 0.0);
        assert!((rig.rate() - WEIGHT_RATE_PER_S).abs() < 1e-9, "{}", rig.rate());
        let count = rig.sent.len();
        rig.turn(&[Command { k: rig.k + PERIOD, motion: Motion::rest([0.3; JOINTS_MAX]) }]);
        assert!(rig.sent.len() == count && !rig.stream.follows(), "it was given back for good");
    }

    #[test]
    fn f118_silent_loop_lets_the_thread_play_the_stop() {
        for weighs in [false, true] {
            let mut rig = Rig::new(weighs);
            rig.turn_for(5.1);
            rig.speed_up();
            let before = rig.stream.held()[0];
            rig.turn_for(1.0);
            assert!(rig.stream.departed().expect("it departed").contains("silent"));
            assert!(rig.stream.last.motion.at_rest() && rig.stream.held()[0] > before + 1e-3, "it stops ahead");
            assert_eq!(rig.stream.is_released(), !weighs);
        }
    }

    #[test]
    fn stop_of_the_thread_keeps_the_acceleration() {
        let mut rig = Rig::new(false);
        rig.turn(&[]);
        rig.speed_up();
        rig.stream.depart("the robot fell silent".to_owned());
        rig.turn_for(1.0);
        assert!(rig.stream.is_released() && rig.jolt() < 1.1, "{}", rig.jolt());
    }

    #[test]
    fn joint_that_is_not_where_it_was_sent_departs() {
        let names = ["a".to_owned(), "b".to_owned()];
        // Behind, the way of the last 0.14 s comes on top: 0.05 rad at the end of this motion.
        for (off, departs) in
            [(0.0, false), (0.04, false), (-0.08, false), (0.06, true), (-0.12, true), (f64::NAN, true)]
        {
            let mut rig = Rig::new(false);
            rig.turn(&[]);
            rig.speed_up();
            let sample = rig.sample(off);
            rig.stream.compare(&sample, &names);
            assert_eq!(rig.stream.departed().is_some(), departs, "{off}");
        }
        // A joint that lags by 0.1 s is where it was sent then, and no farther.
        let mut rig = Rig::new(false);
        rig.turn(&[]);
        rig.speed_up();
        let sample = Sample { q: rig.sent[rig.sent.len() - 26].1.q, ..rig.sample(0.0) };
        rig.stream.compare(&sample, &names);
        assert_eq!(rig.stream.departed(), None);
    }

    #[test]
    fn jump_or_step_of_the_speed_is_never_sent() {
        for (off, v) in [(0.2, 0.0), (0.01, 0.0), (0.0, -0.4)] {
            let mut rig = Rig::new(false);
            rig.turn(&[]);
            rig.speed_up();
            let mut command = rig.stream.last;
            command.k = rig.k + PERIOD;
            command.motion.q = command.motion.q.map(|q| q + off);
            command.motion.v = command.motion.v.map(|before| before + v);
            rig.turn(&[command]);
            assert!(!rig.stream.follows(), "{off}, {v}");
            let step = rig.sent[rig.sent.len() - 1].1.q[0] - rig.sent[rig.sent.len() - 2].1.q[0];
            assert!(step.abs() < 0.003, "{off}, {v}: {step}");
        }
    }

    #[test]
    fn robot_that_stood_during_a_pause_is_not_set_in_motion_again() {
        for has_command in [false, true] {
            let mut rig = Rig::new(false);
            rig.turn(&[]);
            rig.speed_up();
            let last = rig.sent[rig.sent.len() - 1].1.q;
            rig.k += STOOD_TICKS;
            let mut command = rig.stream.last;
            command.k = rig.k + PERIOD;
            command.motion.q = command.motion.q.map(|q| q + 0.01);
            rig.turn(if has_command { std::slice::from_ref(&command) } else { &[] });
            assert!(!rig.stream.follows());
            rig.turn_for(0.5);
            assert!(rig.stream.is_released() && rig.sent[rig.sent.len() - 1].1.q == last, "{has_command}");
        }
    }

    #[test]
    fn pressed_robot_gets_where_it_is_and_is_joined_again_there() {
        let mut rig = Rig::new(false);
        rig.turn(&[]);
        rig.speed_up();
        rig.pressed = Some(true);
        rig.turn_for(0.1);
        let sagged = Sample { q: [0.25; JOINTS_MAX], ..rig.sample(0.0) };
        rig.k += PERIOD;
        let known = Known { now: deadline(rig.k), sample: Some(&sagged), pressed: Some(true) };
        assert_eq!(rig.stream.next(&[], &known).expect("it is due").q, sagged.q);
        rig.pressed = Some(false);
        rig.turn_for(0.1);
        assert!(rig.stream.is_released());
        let names = ["a".to_owned(), "b".to_owned()];
        rig.stream.compare(&rig.sample(0.0), &names);
        let command = |k: u64, q: f64| [Command { k, motion: Motion::rest([q; JOINTS_MAX]) }];
        rig.turn(&command(rig.k + PERIOD, 0.25));
        assert!(!rig.stream.follows(), "it has not stood yet");
        rig.turn_for(0.3);
        rig.turn(&command(rig.k + PERIOD, 0.26));
        assert!(!rig.stream.follows(), "the loop is elsewhere");
        let stale = Sample { measured: deadline(rig.k - 100), ..rig.sample(0.0) };
        let known = Known { now: deadline(rig.k), sample: Some(&stale), pressed: Some(false) };
        rig.stream.next(&command(rig.k, 0.25), &known);
        assert!(!rig.stream.follows(), "nothing was heard of it");
        rig.turn(&command(rig.k + PERIOD, 0.25));
        assert!(rig.stream.follows() && rig.stream.departed().is_none());
    }
}
