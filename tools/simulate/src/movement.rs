//! Judges the true motion of the joints. A robot that does not move as commanded must be stopped, and must be
//! left alone until it is at rest.

use crate::modes::{Broken, moves};
use crate::oracle::Seen;
use messages::{Fault, Faults, JOINTS_MAX, Mode, TICK_HZ, TICK_S, Transition};
use std::collections::VecDeque;

/// Ticks over which a speed is measured: 20 ms, as in docs/src/stopping.md.
const SPEED_TICKS: usize = TICK_HZ as usize / 50;
/// Ticks over which a mean is taken: 0.3 s.
const MEAN_TICKS: usize = 3 * TICK_HZ as usize / 10;
/// Difference of true and commanded speed that must have stopped the robot: a root mean square over `MEAN_TICKS`, as a share
/// of the largest speed. `safety` bounds the mean square with a time constant of 0.25 s by 0.25^2. A mean square M over 0.3 s
/// raises it to M (0.3 / 0.25) exp(-0.3 / 0.25) = 0.36 M at least. So root M is below 0.42. The servo's lag takes the rest.
const SPEED_SHARE: f64 = 0.5;
/// Ticks that a sample, and the decision about it, may take to arrive.
const LATE: u64 = 15;
/// A joint that moves this far from its place, rad, must have been noticed. The promise is 20 mrad from where it came
/// to rest. The judge takes a later place as reference, and the joint came to rest no farther than that.
const FAR_RAD: f64 = 0.045;
/// Consecutive ticks for which it must be far: 10 ms.
const FAR_TICKS: u64 = TICK_HZ / 100 + LATE;
/// A joint stands if it stays within this range, rad, for `STANDS_TICKS` ticks: less motion, for longer, than at rest.
const STANDS_RAD: f64 = 0.001;
const STANDS_TICKS: usize = TICK_HZ as usize * 11 / 100;
/// The robot's rest is a band of 5 mrad to both sides for 100 ms. These are the range, rad, with the noise of
/// encoders, and the ticks, less the delay of a sample.
const REST_RAD: f64 = 0.011;
const REST_TICKS: usize = TICK_HZ as usize / 10 - LATE as usize;
/// If a command is at rest for this many ticks and the robot is not, that must have been noticed: 2 s.
const SETTLE_TICKS: u64 = 2 * TICK_HZ + LATE;
/// Ticks that a robot stood before a reset after its standstill was lost, less those in which it may begin to move.
const STAND_AGAIN_TICKS: usize = TICK_HZ as usize - 2 * LATE as usize;
/// The largest speed of a command at rest, rad/s or m/s.
const COMMAND_REST: f64 = 1e-7;

#[derive(Clone, Default)]
pub struct Movement {
    /// True positions of the joints, newest last.
    truths: VecDeque<[f64; JOINTS_MAX]>,
    /// True less commanded positions of successive ticks that control saw. Then the squares of their speeds,
    /// and the sum of these.
    off: VecDeque<[f64; JOINTS_MAX]>,
    squares: VecDeque<[f64; JOINTS_MAX]>,
    sum: [f64; JOINTS_MAX],
    /// Ticks of three conditions. `fast`: the mean is too large. `restless`: the command is at rest and the
    /// robot is not. `far`: a joint is far from its place.
    fast: u64,
    restless: u64,
    far: u64,
    place: Option<[f64; JOINTS_MAX]>,
    /// Ticks since an encoder was wrong, since a process restarted, and since the loss of standstill was reported.
    honest: u64,
    known: u64,
    lost: Option<u64>,
}

impl Movement {
    pub fn check(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        self.observe(seen);
        self.begins(seen)?;
        let seamless = self.known > 0 && self.honest > 0;
        let sent = seen.moment.robot.as_ref().filter(|_| seamless && seen.moment.state_seen.is_some());
        let Some(robot) = sent.filter(|_| seen.moment.control.is_some()) else {
            self.forget();
            return Ok(());
        };
        self.speed(seen, &robot.q, mode)?;
        let rests = robot.v.iter().chain(&robot.a).all(|x| x.abs() <= COMMAND_REST);
        if moves(mode) || !rests {
            (self.restless, self.far, self.place) = (0, 0, None);
            return Ok(());
        }
        self.standstill(seen, mode)
    }

    fn observe(&mut self, seen: &Seen<'_>) {
        if self.truths.len() > STAND_AGAIN_TICKS {
            self.truths.pop_front();
        }
        self.truths.push_back(seen.truth);
        // The simulation moves a robot in one tick while no driver runs.
        if seen.driver_restarted && self.moved(seen, 2, FAR_RAD).is_some() {
            self.truths.drain(..self.truths.len() - 1);
        }
        self.honest = if seen.encoders_lie { 0 } else { self.honest + 1 };
        let other = seen.driver_restarted || seen.control_restarted;
        (self.known, self.lost) = if other { (0, None) } else { (self.known + 1, self.lost.map(|ticks| ticks + 1)) };
        let status = seen.moment.control.as_ref().map(|control| Faults(control.status.faults));
        if status.is_some_and(|faults| faults.has(Fault::StandstillLost)) {
            self.lost = Some(0);
        }
    }

    fn forget(&mut self) {
        self.off.clear();
        self.squares.clear();
        (self.sum, self.place) = ([0.0; JOINTS_MAX], None);
        (self.fast, self.restless, self.far) = (0, 0, 0);
    }

    /// Returns the joint that moved more than this range, rad, within the last ticks, and its range.
    fn moved(&self, seen: &Seen<'_>, ticks: usize, range_rad: f64) -> Option<(usize, f64)> {
        let ranges = (0..seen.robot.count).map(|j| {
            let last = self.truths.iter().rev().take(ticks).map(|truth| truth[j]);
            let (low, high) = last.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(q), h.max(q)));
            high - low
        });
        ranges.enumerate().find(|(j, range)| *range > seen.scale(*j) * range_rad)
    }

    /// Nothing begins on a robot that truly moves, whatever its command does.
    fn begins(&self, seen: &Seen<'_>) -> Result<(), Broken> {
        let made = seen.moment.control.as_ref().and_then(|control| control.transition).map(|made| made.why);
        let Some(why) = made.filter(|_| self.honest > REST_TICKS as u64) else { return Ok(()) };
        if ![Transition::RESET, Transition::ENABLED, Transition::RECOVERING].contains(&why) {
            return Ok(());
        }
        if let Some((j, by)) = self.moved(seen, REST_TICKS, REST_RAD) {
            return Err(("at rest", format!("joint {j} moved by {by} within {REST_TICKS} ticks")));
        }
        // The loss of standstill was reported just now, and all processes have run for long enough.
        let again = why == Transition::RESET
            && self.lost.is_some_and(|ticks| ticks <= LATE)
            && self.honest.min(self.known) > STAND_AGAIN_TICKS as u64;
        let moved = self.moved(seen, STAND_AGAIN_TICKS, REST_RAD).filter(|_| again);
        let Some((j, by)) = moved else { return Ok(()) };
        Err(("standstill", format!("reset, and joint {j} moved by {by} within a second")))
    }

    /// A joint that truly moves unlike its command for long enough is not moved on.
    fn speed(&mut self, seen: &Seen<'_>, sent: &[f64; JOINTS_MAX], mode: Mode) -> Result<(), Broken> {
        self.off.push_back(std::array::from_fn(|j| seen.truth[j] - sent[j]));
        if self.off.len() <= SPEED_TICKS {
            return Ok(());
        }
        let (then, now) = (self.off.pop_front().unwrap_or_default(), self.off.back().copied().unwrap_or_default());
        let square = std::array::from_fn(|j| {
            let speed = (now[j] - then[j]).abs() / (SPEED_TICKS as f64 * TICK_S);
            speed.min(seen.robot.limits[j].v_max).powi(2)
        });
        self.squares.push_back(square);
        let old = if self.squares.len() > MEAN_TICKS { self.squares.pop_front() } else { None };
        for (j, sum) in self.sum.iter_mut().enumerate() {
            *sum += square[j] - old.map_or(0.0, |old| old[j]);
        }
        let share = |j: usize| (self.sum[j].max(0.0) / MEAN_TICKS as f64).sqrt() / seen.robot.limits[j].v_max;
        let worst = (0..seen.robot.count).find(|&j| share(j) > SPEED_SHARE).filter(|_| moves(mode));
        self.fast = if worst.is_some() { self.fast + 1 } else { 0 };
        let Some(j) = worst.filter(|_| self.fast > LATE) else { return Ok(()) };
        Err(("velocity error", format!("joint {j} off by {} of its speed, but the robot still moves", share(j))))
    }

    /// A joint that nothing moves stays where it stood, or the robot is faulted.
    fn standstill(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        self.restless = if self.moved(seen, REST_TICKS, REST_RAD).is_some() { self.restless + 1 } else { 0 };
        if self.place.is_none()
            && self.honest > STANDS_TICKS as u64
            && self.moved(seen, STANDS_TICKS, STANDS_RAD).is_none()
        {
            self.place = Some(seen.truth);
        }
        let place = self.place.unwrap_or(seen.truth);
        let far = (0..seen.robot.count).find(|&j| (seen.truth[j] - place[j]).abs() > seen.scale(j) * FAR_RAD);
        self.far = if far.is_some() { self.far + 1 } else { 0 };
        if mode == Mode::Faulted {
            // The fault is reported. The new place is where the joint stands after the reset.
            (self.place, self.far) = (None, 0);
            return Ok(());
        }
        if let Some(j) = far.filter(|_| self.far > FAR_TICKS) {
            return Err(("standstill", format!("joint {j} left {} for {} without a fault", place[j], seen.truth[j])));
        }
        if self.restless > SETTLE_TICKS {
            return Err(("standstill", "the robot does not come to rest, and no fault is raised".into()));
        }
        Ok(())
    }
}
