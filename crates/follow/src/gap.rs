//! The gaps between an arm and the rest of the robot along the horizon, as the solver sees them.
//!
//! A gap is the distance of a pair of capsules beyond the robot's least clearance. Around the posture q0 in which
//! it was evaluated it is taken as linear:
//!
//! ```text
//! gap(q) = gap(q0) + slope . (q - q0)
//! ```

use crate::NODES;
use crate::arm::ArmVector;

/// Nodes at which pairs are evaluated: half a second ahead, a tenth apart.
pub(crate) const WATCHED: [usize; 5] = [0, 5, 11, 17, NODES - 1];
/// The watched node that is nearest to each node.
const NEAREST: [usize; NODES] = nearest_watched();
/// Width from which a gap costs nothing, m. It is 2 mm more than whole-body control keeps of its stops, so that a stop
/// is rarely what holds an arm. Wider, hanging arms stood farther from the body: 0.4 degrees for each millimetre, on six
/// clips with G1.
const MARGIN_M: f64 = 5e-3;
/// Width by which a gap is too narrow if it costs its whole weight, m.
pub const GAP_M: f64 = 0.015;
/// Gaps that are kept at a watched node. The narrowest ones are.
const GAPS_MAX: usize = 8;

const fn nearest_watched() -> [usize; NODES] {
    let mut nearest = [0; NODES];
    let mut node = 0;
    while node < NODES {
        let mut i = 1;
        while i < WATCHED.len() {
            if WATCHED[i].abs_diff(node) < WATCHED[nearest[node]].abs_diff(node) {
                nearest[node] = i;
            }
            i += 1;
        }
        node += 1;
    }
    nearest
}

/// A gap as a linear function of the joints that turn limbs, m and m/rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Width in the posture in which it was evaluated, m.
    width_m: f64,
    /// The same, extended to q = 0, m.
    at_zero_m: f64,
    slope: ArmVector,
}

impl Gap {
    /// Creates a gap of `width_m` at `q`, with its derivative by the joints, m/rad.
    pub fn new(width_m: f64, slope: ArmVector, q: &ArmVector) -> Self {
        Self { width_m, at_zero_m: width_m - slope.dot(q), slope }
    }

    /// Width that it lacks at `q`, as a share of [`GAP_M`]. Zero if it is wide enough.
    #[inline]
    pub fn missing(&self, q: &ArmVector) -> f64 {
        // Unlike `clamp`, this makes nothing of NaN.
        ((MARGIN_M - self.at_zero_m - self.slope.dot(q)) / GAP_M).max(0.0)
    }

    /// Its derivative by the joints, m/rad.
    #[inline]
    pub fn slope(&self) -> &ArmVector {
        &self.slope
    }
}

/// The narrowest gaps at each watched node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaps {
    gaps: [[Gap; GAPS_MAX]; WATCHED.len()],
    len: [usize; WATCHED.len()],
}

impl Gaps {
    /// Knows no gap.
    pub fn none() -> Self {
        let nothing = Gap { width_m: f64::INFINITY, at_zero_m: f64::INFINITY, slope: ArmVector::zeros() };
        Self { gaps: [[nothing; GAPS_MAX]; WATCHED.len()], len: [0; WATCHED.len()] }
    }

    /// The gaps that hold at a node.
    #[inline]
    pub fn at_node(&self, node: usize) -> &[Gap] {
        let watched = NEAREST[node];
        &self.gaps[watched][..self.len[watched]]
    }

    /// Drops the gaps at a watched node, before they are evaluated again.
    pub(crate) fn clear(&mut self, watched: usize) {
        self.len[watched] = 0;
    }

    /// Adds a gap at a watched node. If there is no place left, the widest one goes.
    pub fn insert(&mut self, watched: usize, gap: Gap) {
        let (gaps, len) = (&mut self.gaps[watched], &mut self.len[watched]);
        let mut place = *len;
        while place > 0 && gap.width_m < gaps[place - 1].width_m {
            place -= 1;
        }
        if place == GAPS_MAX {
            return;
        }
        *len = (*len + 1).min(GAPS_MAX);
        gaps.copy_within(place..*len - 1, place + 1);
        gaps[place] = gap;
    }
}
