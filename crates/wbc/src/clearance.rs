//! Distances of the checked pairs at one posture. Every certificate of a tick begins there.
//!
//! # Pairs that cannot meet
//!
//! Two postures differ by d_k in joint k alone. One becomes the other by a turn of d_k about one axis, or by a shift
//! along it. So no point of a capsule moves by more than R_k |d_k|, with the reach R_k of the
//! [`certificate`](crate::certificate). Joint by joint, a pair that was D apart when it was measured is now at least
//!
//! ```text
//! bound = D - sum over the moves since, and the joints k between its capsules, of R_k |d_k|
//! ```
//!
//! apart, on whatever way it came here. Joints that carry both capsules move them as one. The sums are kept per body, with
//! the largest reach of its capsules. They are those of the moves that happened, and of no assumed speed.
//!
//! *Same decisions.* No bound takes the place of a distance. A caller asks whether a pair is farther apart than it
//! cares for. If the bound says so, the distance would say so too, and the pair is not measured. In any other case it
//! is measured. The separation along the direction of the closest points may be below the distance, where axes are almost
//! parallel: by less than 1e-7 m at distances above 1 mm. The sums err by less than 6e-7 m, because they begin again
//! after [`MOVES_MAX`] moves, and after any move above [`MOVE_MAX`]. [`SPARE_M`] is more than both. A test compares the
//! decisions with and without bounds.

use crate::chain::{BODIES, Placement, Placements, TurnedJoints, UNTURNED, turn_joints};
use crate::geometry::{Geometry, NO_ROWS, Rows, Segment};
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Part of a bound that is not used, m. See the module's text.
const SPARE_M: f64 = 1e-6;
/// Moves after which the sums begin again. At most [`MOVE_MAX`] each, with levers of 10 m, they add up to 7e4 m. A sum
/// that size errs by 4e-12 m per move.
const MOVES_MAX: u32 = 1 << 16;
/// Largest move of a joint that a bound may survive, rad or m: 150 rad/s for a tick.
const MOVE_MAX: f64 = 0.1;

/// A posture with its placements, and what is known of the distances there.
#[derive(Clone, Debug)]
pub(crate) struct Anchor {
    pub(crate) q: [f64; JOINTS_MAX],
    /// Valid after [`Anchor::pose`].
    pub(crate) placements: Placements,
    /// The joints there. Valid with the placements.
    pub(crate) turned: TurnedJoints,
    is_posed: bool,
    axes: Vec<Segment>,
    /// The entries of `axes` that are computed.
    known: u128,
    /// Paths of the bodies so far, by the rows of [`Geometry::add_paths`], m.
    paths: Rows,
    moves: u32,
    /// For each pair, its distance when it was last measured plus the paths of both sides then, m.
    bounds: Vec<f64>,
    /// For each pair the lower bound of its separation at this posture, m. Valid after [`Anchor::place`].
    pub(crate) least: Vec<f64>,
    /// For each pair its separation when it was last measured, m, and the number of that posture.
    separation: Vec<(f64, u64)>,
    posture: u64,
    /// Smallest distance of all pairs, m, and the pair. Valid after [`Anchor::place`].
    pub(crate) clearance_m: f64,
    pub(crate) nearest: usize,
}

impl Anchor {
    pub(crate) fn new(geometry: &Geometry, q: [f64; JOINTS_MAX]) -> Self {
        let nowhere = Segment { a: Vector3::zeros(), b: Vector3::zeros() };
        let mut anchor = Self {
            q,
            placements: [Placement::identity(); BODIES],
            turned: UNTURNED,
            is_posed: false,
            axes: vec![nowhere; geometry.shapes.len()],
            known: 0,
            paths: NO_ROWS,
            moves: 0,
            bounds: vec![f64::NEG_INFINITY; geometry.pairs.len()],
            least: vec![f64::NEG_INFINITY; geometry.pairs.len()],
            separation: vec![(0.0, 0); geometry.pairs.len()],
            posture: 1,
            clearance_m: f64::INFINITY,
            nearest: 0,
        };
        anchor.place(geometry, q);
        anchor
    }

    /// Moves the anchor to posture `q`. Placements and distances are computed when they are asked for.
    pub(crate) fn go(&mut self, geometry: &Geometry, q: [f64; JOINTS_MAX]) {
        if q == self.q {
            return;
        }
        let moved: [f64; JOINTS_MAX] = std::array::from_fn(|j| (q[j] - self.q[j]).abs());
        (self.q, self.is_posed, self.known) = (q, false, 0);
        self.posture += 1;
        self.moves += 1;
        // Written so that NaN forgets too.
        let kept = self.moves < MOVES_MAX && moved.iter().all(|moved| *moved <= MOVE_MAX);
        if kept {
            geometry.add_paths(&moved, &mut self.paths);
        } else {
            self.moves = 0;
            self.paths = NO_ROWS;
            self.bounds.fill(f64::NEG_INFINITY);
        }
    }

    /// Computes the placements.
    pub(crate) fn pose(&mut self, geometry: &Geometry) {
        if !self.is_posed {
            self.is_posed = true;
            let chain = &geometry.chain;
            turn_joints(chain, |j| self.q[j], chain.all(), &mut self.turned);
            chain.place(&self.turned, &mut self.placements);
        }
    }

    /// Moves the anchor to posture `q` with its placements, and finds the nearest pair.
    pub(crate) fn place(&mut self, geometry: &Geometry, q: [f64; JOINTS_MAX]) {
        self.go(geometry, q);
        self.pose(geometry);
        self.clearance_m = f64::INFINITY;
        if self.nearest < geometry.pairs.len() {
            // The pair that was nearest is measured first, so that most others are known to be farther apart.
            self.clearance_m = self.clearance_m.min(self.separation(geometry, self.nearest));
        }
        for pair in 0..geometry.pairs.len() {
            self.least[pair] = self.bound_m(geometry, pair);
            if self.least[pair] > self.clearance_m {
                continue;
            }
            let separation = self.separation(geometry, pair);
            self.least[pair] = self.bound_m(geometry, pair);
            if separation < self.clearance_m || (separation == self.clearance_m && pair < self.nearest) {
                (self.clearance_m, self.nearest) = (separation, pair);
            }
        }
    }

    /// Returns true if a pair is known to be farther apart than `distance_m`.
    #[inline]
    pub(crate) fn is_beyond(&self, geometry: &Geometry, pair: usize, distance_m: f64) -> bool {
        self.bound_m(geometry, pair) > distance_m
    }

    /// A lower bound of a pair's separation, m.
    #[inline]
    pub(crate) fn bound_m(&self, geometry: &Geometry, pair: usize) -> f64 {
        self.bounds[pair] - geometry.change_m(pair, &self.paths)
    }

    /// The separation of a pair, m. It is its distance, except for rounding. Measured once for a posture.
    #[inline]
    pub(crate) fn separation(&mut self, geometry: &Geometry, pair: usize) -> f64 {
        let (separation, posture) = self.separation[pair];
        if posture == self.posture { separation } else { self.measure(geometry, pair) }
    }

    fn measure(&mut self, geometry: &Geometry, index: usize) -> f64 {
        let pair = &geometry.pairs[index];
        let (a, b) = (self.axis_of(geometry, pair.a.capsule), self.axis_of(geometry, pair.b.capsule));
        let separation = geometry.normal(pair, &a, &b).1;
        self.separation[index] = (separation, self.posture);
        if geometry.skips {
            self.bounds[index] = separation - SPARE_M + geometry.change_m(index, &self.paths);
        }
        separation
    }

    /// The axis of a capsule in the base frame.
    #[inline]
    fn axis_of(&mut self, geometry: &Geometry, capsule: usize) -> Segment {
        self.pose(geometry);
        if self.known & 1 << capsule == 0 {
            self.known |= 1 << capsule;
            self.axes[capsule] = geometry.axis(capsule, &self.placements);
        }
        self.axes[capsule]
    }

    /// Axis of joint `j` in the base frame.
    pub(crate) fn axis(&self, geometry: &Geometry, j: usize) -> Vector3<f64> {
        self.placements[j + 1].r * geometry.chain.links()[j].axis
    }

    /// Gradient of a pair's distance by the joint positions, m per rad or m. For each joint between the
    /// bodies it is the velocity of the closest point that it carries, along the direction from B to A.
    pub(crate) fn gradient(&mut self, geometry: &Geometry, pair: usize) -> [f64; JOINTS_MAX] {
        let pair = &geometry.pairs[pair];
        let (a, b) = (&self.axis_of(geometry, pair.a.capsule), &self.axis_of(geometry, pair.b.capsule));
        let (on_a, on_b) = geometry.closest_points(pair, a, b);
        let (n, _) = geometry.normal(pair, a, b);
        let carries_a = geometry.chain.ancestors(geometry.shapes[pair.a.capsule].capsule.body);
        std::array::from_fn(|j| {
            if pair.between & 1 << j == 0 {
                return 0.0;
            }
            // Only joints of the robot are between two bodies.
            let (link, placement) = (&geometry.chain.links()[j], &self.placements[j + 1]);
            let axis = placement.r * link.axis;
            let of_a = carries_a & 1 << j != 0;
            let point = if of_a { on_a } else { on_b };
            let velocity = if link.prismatic { axis } else { axis.cross(&(point - placement.t)) };
            if of_a { n.dot(&velocity) } else { -n.dot(&velocity) }
        })
    }
}
