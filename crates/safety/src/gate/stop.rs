//! A joint's stop as it was judged: where its phases begin, and how far it reaches.

use super::fixed::{Extremes, Point};
use super::stored::Phases;

/// A stop from a point, in units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stop {
    phases: Phases,
    /// Where the phases begin, and the end of the last one.
    points: [Point; 4],
    /// Least and greatest position, and largest speed and acceleration on the way.
    pub(super) q: [i64; 2],
    pub(super) v: i64,
    pub(super) a: i64,
}

impl Stop {
    /// A stop of which nothing is judged yet.
    pub(super) fn new(start: Point, phases: &Phases) -> Self {
        Self { phases: *phases, points: [start; 4], q: [start.q; 2], v: start.v.abs(), a: start.a.abs() }
    }

    /// Notes that phase `i` leads to `end`, by way of `extremes`.
    pub(super) fn note(&mut self, i: usize, end: Point, extremes: &Extremes) {
        self.points[i + 1..].fill(end);
        self.q = [self.q[0].min(extremes.q[0]), self.q[1].max(extremes.q[1])];
        self.v = self.v.max(extremes.v[1]).max(-extremes.v[0]);
        // It is linear within a phase.
        self.a = self.a.max(end.a.abs());
    }

    /// Its length, in units of time.
    pub(super) fn duration(&self) -> i64 {
        self.phases.iter().map(|phase| phase.duration).sum()
    }

    /// Where it ends.
    pub(super) fn end(&self) -> Point {
        self.points[3]
    }

    /// Where it is after `played`: the point that `Stored` plays, to the unit.
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

    /// How far it leads from its beginning at most, in units.
    pub(super) fn travel(&self) -> i64 {
        (self.q[1] - self.points[0].q).max(self.points[0].q - self.q[0])
    }
}
