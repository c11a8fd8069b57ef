//! A stream of positions, for a robot that holds the last one by itself.
//!
//! Nobody in such a robot plays a stop. If the loop falls silent in motion, the robot departs or the program ends, this thread
//! plays the certified stop. If this process dies, the robot holds the last position at once, from any speed.
//!
//! Where the robot blends two controllers by a *weight*, the weight rises from 0 to 1 before anything moves. The robot is
//! commanded to where it was measured meanwhile. After the last stop the weight falls again. The posture is held meanwhile.
//!
//! The controllers report no setpoint, so the robot's joints are compared with what was sent. A joint lags by at most
//! `LAG_MAX_NS`, and must be within `HELD` of the positions of that time. Smaller errors are for `safety`.

use crate::estimate::Sample;
use crate::reference::{HELD, MEETS, STANDS_NS, continues};
use crate::trajectory::Command;
use driver::PlanPlayback;
use messages::{JOINTS_MAX, JointMotion, Stamp, TICK_S, tick_at};
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing was sent yet, or nothing any more.
    Released,
    Rising,
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
pub struct Observation<'a> {
    pub now: Stamp,
    pub sample: Option<&'a Sample>,
    /// The emergency stop. None if nobody says.
    pub pressed: Option<bool>,
}

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
    /// The program ends, so nothing is sent to a pressed robot any more.
    ends: bool,
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
            last: Command { k: 0, motion: JointMotion::rest([0.0; JOINTS_MAX]) },
            sent_k: 0,
            commanded: false,
            weight: 0.0,
            recent: VecDeque::new(),
            stood: None,
            departed: None,
            ends: false,
        }
    }

    /// Begins at the measured posture.
    pub fn begin(&mut self, measured: &[f64; JOINTS_MAX], now: Stamp) {
        let k = tick_at(now);
        self.last = Command { k, motion: JointMotion::rest(*measured) };
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

    /// Plays the stop, and gives the robot back. A robot whose emergency stop is pressed goes on getting where it is.
    pub fn depart(&mut self, why: String) {
        if matches!(self.phase, Phase::Rising | Phase::Following) {
            self.phase = Phase::Stopping;
            self.departed = Some(why);
        }
    }

    /// Departs because the program ends. Then a pressed robot gets nothing either.
    pub fn end(&mut self) {
        self.ends = true;
        self.depart("the driver ends".to_owned());
        if self.phase == Phase::Pressed {
            self.phase = Phase::Stopping;
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
    pub fn next(&mut self, commands: &[Command], known: &Observation) -> Option<Position> {
        let k = tick_at(known.now);
        // A departed robot may sag, too. Its last position would lift it at the release of the emergency stop.
        let departed = self.departed.is_some() && matches!(self.phase, Phase::Released | Phase::Stopping);
        if departed && known.pressed == Some(true) && !self.weighs && !self.ends {
            self.phase = Phase::Pressed;
        }
        match self.phase {
            Phase::Released => return self.rejoin(commands.last()?, known),
            Phase::Following if known.pressed != Some(false) => self.react_to_emergency_stop(known.pressed),
            Phase::Following => self.follow_loop(commands.last(), k)?,
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
            return self.react_to_emergency_stop(pressed);
        }
        self.weight = (self.weight + self.step(k)).min(1.0);
        if self.weight == 1.0 {
            self.phase = Phase::Following;
        }
    }

    /// Reacts to an emergency stop that is not known to be released.
    fn react_to_emergency_stop(&mut self, pressed: Option<bool>) {
        if pressed.is_none() {
            return self.depart("nobody says whether the emergency stop is pressed: its publisher left".to_owned());
        }
        self.depart("the emergency stop is pressed".to_owned());
        if !self.weighs {
            self.phase = Phase::Pressed;
        }
    }

    /// Takes the loop's newest command. None if nothing is due.
    fn follow_loop(&mut self, command: Option<&Command>, k: u64) -> Option<()> {
        let Some(command) = command else {
            // A robot that stands is held without the loop, too.
            if !self.commanded || self.last.motion.is_at_rest() {
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
            self.last.motion = JointMotion::rest(self.last.motion.q);
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
        !self.last.motion.is_at_rest() && k > self.sent_k + STOOD_TICKS
    }

    fn stop(&mut self, k: u64) {
        if self.has_stood(k) {
            self.last.motion = JointMotion::rest(self.last.motion.q);
        } else if !self.last.motion.is_at_rest() {
            // After a short pause the stop goes on where it was.
            self.last.motion.play((k - self.sent_k).min(2 * self.period_ticks));
        } else if self.weighs && self.weight > 0.0 {
            self.weight = (self.weight - self.step(k)).max(0.0);
        } else {
            self.phase = Phase::Released;
        }
    }

    fn rest_at(&mut self, known: &Observation) {
        if known.pressed == Some(false) {
            self.phase = Phase::Stopping;
        } else if let Some(sample) = known.sample.filter(|sample| known.now.since(sample.measured) <= FRESH_NS) {
            self.last.motion = JointMotion::rest(sample.q);
        }
    }

    /// Follows the loop again where the robot stands and is held. A robot with a weight was given back for good.
    fn rejoin(&mut self, command: &Command, known: &Observation) -> Option<Position> {
        let (stood, _) = self.stood.filter(|(since, _)| known.now.since(*since) >= STANDS_NS)?;
        let fresh = |sample: &&Sample| known.now.since(sample.measured) <= FRESH_NS;
        let sample = known.sample.filter(|sample| sample.measured >= stood).filter(fresh)?;
        let near = |a: &[f64; JOINTS_MAX], b: &[f64; JOINTS_MAX], most: f64| {
            (0..self.count).all(|j| (a[j] - b[j]).abs() <= most)
        };
        let stands = near(&sample.q, self.held(), HELD);
        let meets = command.motion.is_at_rest() && near(&command.motion.q, self.held(), MEETS);
        if !self.weighs && self.departed.is_some() && known.pressed == Some(false) && stands && meets {
            let held = *self.held();
            self.begin(&held, known.now);
        }
        None
    }
}

#[cfg(test)]
mod tests;
