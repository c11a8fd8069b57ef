//! Counts the judge's violations of true motion that no fault of the robot explains.

use crate::oracle::Seen;
use plant::{CLEARANCE_MARGIN_M, ViolationKind};

/// Ticks between two looks of the judge, 2 ms, and one more.
const LOOK_TICKS: u64 = 3 + 1;

#[derive(Clone, Copy, Debug, Default)]
pub struct TrueMotion {
    total: u64,
    clearances: u64,
    /// The greatest clearance since, m, and the tick of the last violation, of a robot that its own fault brought too
    /// close to itself. Until it is clear again, the judge counts every look.
    close: Option<(f64, u64)>,
}

impl TrueMotion {
    /// Returns the number of new violations that no fault explains. A robot that its fault brought too close may stay
    /// so until a recovery has moved it apart, but comes no closer.
    pub fn new_violations(&mut self, seen: &Seen<'_>) -> u64 {
        let (total, clearances) = (seen.judged.total(), seen.judged.count(ViolationKind::Clearance));
        // A simulation that begins with another robot counts from zero.
        let new = total.saturating_sub(self.total);
        let are_clearances = clearances.saturating_sub(self.clearances) == new;
        (self.total, self.clearances) = (total, clearances);
        let clearance_m = seen.judged.clearance_m;
        if new == 0 {
            self.close = self.close.filter(|(_, tick)| seen.tick <= tick + LOOK_TICKS);
            return 0;
        }
        if seen.robot_faulty {
            self.close = Some((clearance_m, seen.tick));
            return 0;
        }
        match &mut self.close {
            Some((greatest, tick)) if are_clearances && clearance_m >= *greatest - CLEARANCE_MARGIN_M => {
                (*greatest, *tick) = (clearance_m.max(*greatest), seen.tick);
                0
            }
            _ => new,
        }
    }
}
