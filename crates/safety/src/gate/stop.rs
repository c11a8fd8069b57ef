//! The stop of a joint after it was judged: the beginning of each phase, and the extremes.

use super::fixed::{Extremes, Point};
use super::stored::Phases;

/// A stop from a point, in units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stop {
    phases: Phases,
    /// The beginning of each phase, and the end of the last one.
    points: [Point; 4],
    /// Least and greatest position, and largest speed and acceleration on the way.
    pub(super) q: [i64; 2],
    pub(super) v: i64,
    pub(super) a: i64,
}

impl Stop {
    /// Creates a stop of which no phase is judged yet.
    pub(super) fn new(start: Point, phases: &Phases) -> Self {
        Self { phases: *phases, points: [start; 4], q: [start.q; 2], v: start.v.abs(), a: start.a.abs() }
    }

    /// Notes that phase `i` leads to `end`, by way of `extremes`.
    pub(super) fn record(&mut self, i: usize, end: Point, extremes: &Extremes) {
        self.points[i + 1..].fill(end);
        self.q = [self.q[0].min(extremes.q[0]), self.q[1].max(extremes.q[1])];
        self.v = self.v.max(extremes.v[1]).max(-extremes.v[0]);
        // The acceleration is linear within a phase.
        self.a = self.a.max(end.a.abs());
    }

    /// Duration of the stop, in units of time.
    pub(super) fn duration(&self) -> i64 {
        self.phases.iter().map(|phase| phase.duration).sum()
    }

    /// Point at which the stop ends.
    pub(super) fn end(&self) -> Point {
        self.points[3]
    }

    /// Point after `played` units of time. It is equal to the point that `Stored` plays, to the unit.
    pub(super) fn at(&self, played: i64) -> Point {
        let mut left = played;
        for (phase, from) in self.phases.iter().zip(&self.points) {
            if left < phase.duration {
                return from.after(phase.jerk, left);
            }
            left -= phase.duration;
        }
        Point { q: self.end().q, v: 0, a: 0 }
    }

    /// Largest distance from the beginning, in units.
    pub(super) fn travel(&self) -> i64 {
        (self.q[1] - self.points[0].q).max(self.points[0].q - self.q[0])
    }
}
