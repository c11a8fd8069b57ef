//! Proof that a planned motion keeps every checked pair, and every pair of a capsule and an obstacle, apart
//! at every instant, not only at samples.
//!
//! # Derivation
//!
//! *Separation.* For a unit vector n, sep_n(t) = min over A of n.x - max over B of n.x - r_A - r_B is at most
//! the distance of the capsules. n is fixed as seen from the deepest body that carries both (the pair's
//! *common* body). So the joints that move both in the same way drop out. Both axes are segments, so min and
//! max are at their ends.
//!
//! *Obstacles.* Planes and boxes are fixed to the base (body 0). Each is paired with every capsule that any
//! joint moves, so the common body is the base. For a box with centre c, rotation R and half lengths h, max over B of
//! n.x = n.c + sum_i |(R^T n)_i| h_i. A half-space n.x <= o has a separation only along its own normal. It is min over
//! A of n.x - o - r_A, which is the distance itself. An obstacle does not move: B_B = 0 and L_B = 0 below.
//!
//! *Chord.* Let x(t) be a point with |x''| <= B on [t0, t1], and dt = t1 - t0. It leaves its chord at t0 + s
//! by at most B s (dt - s) / 2. For x on A's axis and y on B's, n.(x - y) is at least sep_n(t0) + r_A + r_B
//! at t0 and sep_n(t1) + r_A + r_B at t1. Let S0 = sep_n(t0), S1 = sep_n(t1) and B = B_A + B_B. Then the
//! segment is safe if for one n
//!
//! ```text
//! d_min <= min over s in [0, dt] of  S0 + (S1 - S0) s / dt - B s (dt - s) / 2
//!        = S0 or S1, whichever is smaller,               if |S1 - S0| >= B dt^2 / 2,
//!          (S0 + S1) / 2 - c - (S1 - S0)^2 / (16 c)      else, with c = B dt^2 / 8
//! ```
//!
//! This is at least min(S0, S1) - B dt^2 / 8, and it lets a motion begin at d_min if it leads away. Two n are
//! tried, those between the closest points at t0 and at t1. Any n is sound. So it does not matter that near
//! parallel axes these points are ill-conditioned. Their distance is never used, only the separation along n.
//!
//! *B.* Let J_k = dx/dq_k. For a revolute joint J_k = z_k x (x - o_k). Its length is at most the reach R_k,
//! the largest distance of the point from the joint's axis over all configurations (see
//! [`KinematicChain::reach`](crate::chain::KinematicChain::reach)). For a prismatic joint J_k = z_k and R_k = 1. For i before k
//! in the chain, dJ_k/dq_i = dJ_i/dq_k = z_i x J_k if i is revolute, because everything after it, J_k and x,
//! turns with it. It is 0 if i is prismatic. dJ_k/dq_k is z_k x J_k if k is revolute, else 0. Hence, with
//! |q_k''| <= a_k, |q_k'| <= v_k, and w_k = v_k for a revolute, 0 for a prismatic joint,
//!
//! ```text
//! x'' = sum_k J_k q_k'' + sum_i sum_k dJ_k/dq_i q_i' q_k'
//! B   = sum_k R_k a_k + sum_k R_k v_k (w_k + 2 sum_{i<k} w_i)
//! ```
//!
//! So a prismatic joint after revolute ones adds 2 v_p times the sum of their speeds, and one before them adds only
//! a_p. Over the part of the chain that begins at joint s this is a recursion from the tip: W_s = W_{s+1} + R_s v_s,
//! and B_s = B_{s+1} + R_s a_s + w_s (R_s v_s + 2 W_{s+1}). It holds for both ends of an axis. Points between them are
//! convex combinations, so R_k is the larger of the two ends'. Each side takes the s that follows the common body.
//!
//! *v_k, a_k.* Over a segment |q''| is largest at its ends or where the jerk changes, because it is linear in
//! between. |q'| exceeds the larger of its ends' by at most a_k dt / 2 (the nearer end) and by J dt^2 / 8
//! (its chord). The lesser of the two is added. See
//! [`JointTrajectory::swing`](crate::trajectory::JointTrajectory::swing).
//!
//! *Path.* Over a segment in which joint k travels the path L_k, the distance falls by at most sum_k R_k L_k
//! (of both sides). A pair with more to spare needs no further proof. L_k is v_k dt on a segment. For the whole motion
//! it is the sum of |q1 - q0| over pieces in which the velocity keeps its sign, where this is exact. Pieces are split
//! where the acceleration vanishes. A piece in which the velocity changes its sign counts max |v| dt, which is more
//! than its path. (The difference of the positions at the ends of a tick alone could be less than the path, by up to J
//! h^3 / 8, if a reversal lies inside. No such difference is used.) Culling
//! starts from the anchor's separation, or from a lower bound of it (see `clearance`), so from no more than the distance.
//!
//! *Interface.* A robot that executes the command with skewed delays and through splines may come closer than
//! the command. If such an interface is configured, the certificate adds the [`deviation`](crate::interface)
//! to d_min. In each segment it uses v_k and a_k from above, and at the ends the speed and acceleration
//! there. The deviation is a function of the command at that instant alone, so nothing changes below. A
//! recovery is slow and starts below d_min, so it leaves the deviation out.
//!
//! *Rounding.* A separation is a sum of products of numbers below 4 m. Its error is below 1e-14 m. In each tick the plan's
//! positions are computed again from those of the tick before. That adds an error below 1e-15 rad. An hour has 5.4
//! million ticks, so the errors of an hour add up to less than 1e-8 rad. A proof has to bear only those since its own
//! start. Each new decision of a joint is proved from the positions that the plan has then. Commands keep 1 um more than
//! the model's d_min. That is more than all these errors together, and more than the gate's, which computes the clearance
//! with other code.
//!
//! *Induction.* At rest with clearance the constant plan is certified. A motion is accepted if it is proved
//! from now to rest. Then its remainder is proved too, tick by tick, because the proof covers every instant.
//! If a motion is not accepted, the remainder of the last accepted one is played. A pair that no fresh joint
//! moves keeps the proof of that one.
//!
//! Segments are halved until they are safe. The motion is rejected once they would be shorter than 1.5 ms, or
//! after 80 evaluations of the kinematics. This can give fewer proofs, but never false ones.

use crate::chain::{JointSet, Placement, Placements, joints};
use crate::clearance::Anchor;
use crate::geometry::{Geometry, NO_ROWS, Rows, Segment, Side};
use crate::plan::JointState;
use crate::trajectory::{Swing, Trajectory};
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Shorter segments are not tried: at 1.5 ms the chord term of a fast arm (B = 60 m/s^2) is 0.02 mm.
const SHORTEST_S: f64 = 1.5e-3;
/// Evaluations of the kinematics after which a motion is rejected: bounds the tick.
const EVALUATIONS_MAX: u32 = 80;
/// Distance that a pair must have to spare beyond its path to be culled, m. It is far above the rounding of
/// the kinematics.
const CULL_MARGIN_M: f64 = 1e-9;
/// A new decision may bring a pair to rest at d_min plus this, m. If less is left, the pair may not rest closer than it
/// is. On the way there, half of what is left may be used. A motion that starts at its own bound could not be proved
/// even if it leads away. Its chord sags by B dt^2 / 8 (0.0003 mm for the shortest one), and the arm could never leave.
const SLACK_M: f64 = 5e-4;
/// Rounding of a distance that a motion leaves unchanged, m. At 1500 decisions a second it could add up to 5
/// um an hour.
const REST_ROUNDING_M: f64 = 1e-12;
/// Halvings: 1.5 ms * 2^11 = 3 s, longer than any stop.
const DEPTH_MAX: usize = 12;
/// Pairs in flight at all depths. A motion that needs more is rejected. 322 pairs at full depth need far
/// fewer, since each halving keeps only the near ones.
const ENTRIES: usize = 2048;

/// Kinematics at one instant of the motion.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    t: f64,
    x: [JointState; JOINTS_MAX],
    placements: Placements,
    axes: Vec<Segment>,
    /// The entries of `axes` that are computed.
    known: u128,
}

impl Node {
    fn new(capsules: usize) -> Self {
        let nowhere = Segment { a: Vector3::zeros(), b: Vector3::zeros() };
        Self {
            t: 0.0,
            x: [JointState::default(); JOINTS_MAX],
            placements: [Placement::identity(); JOINTS_MAX + 1],
            axes: vec![nowhere; capsules],
            known: 0,
        }
    }

    #[inline]
    fn axis(&mut self, geometry: &Geometry, capsule: usize) -> Segment {
        if self.known & 1 << capsule == 0 {
            self.known |= 1 << capsule;
            self.axes[capsule] = geometry.axis(capsule, &self.placements);
        }
        self.axes[capsule]
    }
}

/// A pair that is not yet proved on a segment. It has the directions at both ends, in the common body's
/// frame, and the separations there.
#[derive(Clone, Copy, Debug)]
struct Entry {
    pair: usize,
    n: [Vector3<f64>; 2],
    sep: [f64; 2],
    /// The distance to keep on the way and at rest, m. See [`floors`].
    floor: f64,
    rest_floor: f64,
}

/// Bounds on the motion of one capsule over a segment, per first joint of the chain's rest.
#[derive(Clone, Copy, Debug, Default)]
struct Reach {
    /// The segment that they belong to.
    segment: u64,
    /// B_s, m/s^2.
    curve: [f64; JOINTS_MAX + 1],
    /// Sum of R L, m.
    path: [f64; JOINTS_MAX + 1],
}

/// Working memory, allocated once.
#[derive(Clone, Debug)]
pub(crate) struct Scratch {
    nodes: Vec<Node>,
    entries: Vec<Entry>,
    top: usize,
    reaches: Vec<Reach>,
    /// Paths of the bodies over the whole motion, by the rows of [`Geometry::add_paths`], m.
    paths: Rows,
    /// Pairs that their bounds do not prove.
    listed: Vec<u16>,
    swings: [Swing; JOINTS_MAX],
    segment: u64,
    evaluations: u32,
    blamed: usize,
}

impl Scratch {
    pub(crate) fn new(geometry: &Geometry) -> Self {
        let capsules = geometry.shapes.len();
        let idle = Entry { pair: 0, n: [Vector3::zeros(); 2], sep: [0.0; 2], floor: 0.0, rest_floor: 0.0 };
        Self {
            nodes: vec![Node::new(capsules); DEPTH_MAX + 2],
            entries: vec![idle; ENTRIES],
            top: 0,
            reaches: vec![Reach::default(); capsules],
            paths: NO_ROWS,
            listed: vec![0; geometry.pairs.len()],
            swings: [Swing::default(); JOINTS_MAX],
            segment: 0,
            evaluations: 0,
            blamed: 0,
        }
    }
}

/// Result of the certificate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// The pair that could not be proved, if any. None means that the motion is safe at every instant.
    pub blamed: Option<usize>,
    /// Evaluations of the kinematics.
    pub evaluations: u32,
}

/// Purpose of the motion to certify.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// A decision like any other.
    Decision,
    /// Recovery of a robot. A pair closer than d_min keeps its present distance, except for
    /// [`RECOVERY_SAG_M`] on the way. The deviation of the robot's interface is left out.
    Recovery,
}

/// Certifies `motion`, whose first posture is that of `anchor`. Pairs whose distance no joint of `fresh`
/// changes are not checked, because they continue a certified plan.
pub(crate) fn certify(
    geometry: &Geometry,
    motion: &Trajectory,
    purpose: Purpose,
    fresh: JointSet,
    anchor: &mut Anchor,
    scratch: &mut Scratch,
) -> Verdict {
    let mut proof = Proof { geometry, motion, purpose, s: scratch };
    let safe = proof.whole(fresh, anchor);
    Verdict { blamed: (!safe).then_some(scratch.blamed), evaluations: scratch.evaluations }
}

/// Allowed sag of a recovery's chord, m. A motion from rest begins at its own bound, and B dt^2 / 8 of the shortest
/// segment is 3 um at the accelerations of a recovery. At the ticks themselves nothing may come closer, see `recover`.
const RECOVERY_SAG_M: f64 = 2e-5;

/// The floors of a recovery. They are those of any decision, and below d_min the present distance.
fn recovery_floors(d_min: f64, separation: f64) -> (f64, f64) {
    if separation >= d_min + SLACK_M {
        return floors(d_min, separation);
    }
    (separation.min(d_min + 0.5 * SLACK_M) - RECOVERY_SAG_M, separation - REST_ROUNDING_M)
}

/// The distances that a new decision keeps on its way and at rest, m, for a pair that is now `separation`
/// apart. See [`SLACK_M`].
#[inline]
fn floors(d_min: f64, separation: f64) -> (f64, f64) {
    let slack = (separation - d_min).clamp(0.0, SLACK_M);
    (d_min + 0.5 * slack, d_min + slack - REST_ROUNDING_M)
}

/// The lower bound of the separation between two ends whose chord sags by at most `sag` (B dt^2 / 8) in the middle.
#[inline]
fn lowest(from: f64, to: f64, sag: f64) -> f64 {
    let rise = to - from;
    if rise.abs() >= 4.0 * sag { from.min(to) } else { 0.5 * (from + to) - sag - rise * rise / (16.0 * sag) }
}

#[inline]
fn speed(x: &JointState) -> [f64; 2] {
    [x.v.abs(), x.a.abs()]
}

struct Proof<'a> {
    geometry: &'a Geometry,
    motion: &'a Trajectory,
    purpose: Purpose,
    s: &'a mut Scratch,
}

impl Proof<'_> {
    /// Proves the whole motion. It first culls by path, then proves the other pairs from the anchor to rest.
    fn whole(&mut self, fresh: JointSet, anchor: &mut Anchor) -> bool {
        self.s.evaluations = 0;
        self.s.top = 0;
        self.begin_segment();
        let mut paths = [0.0; JOINTS_MAX];
        for j in 0..self.geometry.chain.count() {
            paths[j] = self.motion.joints[j].path();
            self.s.swings[j] = Swing { path: paths[j], ..Swing::default() };
        }
        self.s.paths = NO_ROWS;
        self.geometry.add_paths(&paths, &mut self.s.paths);
        let farthest = self.geometry.d_min_m + SLACK_M + CULL_MARGIN_M;
        let mut needed = 0;
        // No floor is higher than the farthest. So what follows would drop the pairs too that these bounds drop.
        let mut listed = std::mem::take(&mut self.s.listed);
        let nearest = |pair| farthest + self.largest_deviation(pair);
        let count = self.geometry.list_reachable(fresh, &anchor.least, &self.s.paths, nearest, &mut listed);
        let mut full = None;
        for &i in &listed[..count] {
            let i = usize::from(i);
            let (pair, separation) = (&self.geometry.pairs[i], anchor.separation(self.geometry, i));
            let path = self.reach(pair.a).1 + self.reach(pair.b).1;
            let left = separation - self.deviation(i, |j| speed(&self.motion.joints[j].at(0.0)));
            let (floor, rest_floor) = match self.purpose {
                Purpose::Decision => floors(self.geometry.d_min_m, left),
                Purpose::Recovery => recovery_floors(self.geometry.d_min_m, left),
            };
            if separation - path - self.largest_deviation(i) >= rest_floor + CULL_MARGIN_M {
                continue;
            }
            if self.s.top == ENTRIES {
                full = full.or(Some(i));
                break;
            }
            self.s.entries[self.s.top] = Entry { pair: i, n: [Vector3::zeros(); 2], sep: [0.0; 2], floor, rest_floor };
            self.s.top += 1;
            needed |= pair.needed;
        }
        self.s.listed = listed;
        if let Some(pair) = full {
            return self.blame(pair);
        }
        if self.s.top == 0 {
            return true;
        }
        self.evaluate(0, 0.0, needed, Some(anchor));
        self.evaluate(1, self.motion.end_s(), needed, None);
        for e in 0..self.s.top {
            for side in [1, 0] {
                let Entry { pair, floor, rest_floor, .. } = self.s.entries[e];
                let (n, sep) = self.direction(side, pair);
                if sep - self.deviation_at(side, pair) < if side == 1 { rest_floor } else { floor } {
                    return self.blame(pair);
                }
                self.s.entries[e].n[side] = n;
                self.s.entries[e].sep[side] = sep;
            }
        }
        self.prove(0, 1, 0, 0)
    }

    /// Proves the pairs `first..top` between two nodes. On return they are consumed.
    fn prove(&mut self, from: usize, to: usize, depth: usize, first: usize) -> bool {
        let (needed, kept) = self.keep_unproved(from, to, first);
        self.s.top = kept;
        if kept == first {
            return true;
        }
        let (t0, t1) = (self.s.nodes[from].t, self.s.nodes[to].t);
        let too_many = self.s.evaluations >= EVALUATIONS_MAX || 2 * kept - first > ENTRIES || depth == DEPTH_MAX;
        if too_many || (t1 - t0) / 2.0 < SHORTEST_S {
            return self.blame(self.s.entries[first].pair);
        }
        let middle = depth + 2;
        self.evaluate(middle, 0.5 * (t0 + t1), needed, None);
        for e in first..kept {
            let entry = self.s.entries[e];
            let (n, sep) = self.direction(middle, entry.pair);
            if sep - self.deviation_at(middle, entry.pair) < entry.floor {
                return self.blame(entry.pair);
            }
            // The right half waits in place while the left half is proved on top of it.
            self.s.entries[e] = Entry { n: [n, entry.n[1]], sep: [sep, entry.sep[1]], ..entry };
            self.s.entries[kept + e - first] = Entry { n: [entry.n[0], n], sep: [entry.sep[0], sep], ..entry };
        }
        self.s.top = 2 * kept - first;
        if !self.prove(from, middle, depth + 1, kept) {
            return false;
        }
        self.s.top = kept;
        self.prove(middle, to, depth + 1, first)
    }

    /// Drops the pairs of `first..top` that are proved between two nodes. Returns the joints that the others
    /// need, and the end of their range.
    fn keep_unproved(&mut self, from: usize, to: usize, first: usize) -> (JointSet, usize) {
        self.begin_segment();
        let (t0, t1) = (self.s.nodes[from].t, self.s.nodes[to].t);
        let mut moving = 0;
        for entry in &self.s.entries[first..self.s.top] {
            moving |= self.geometry.pairs[entry.pair].between;
        }
        for j in joints(moving) {
            let (x0, x1) = (self.s.nodes[from].x[j], self.s.nodes[to].x[j]);
            self.s.swings[j] = self.motion.joints[j].swing(t0, t1, x0, x1);
        }
        let dt = t1 - t0;
        let (mut needed, mut kept) = (0, first);
        for e in first..self.s.top {
            let entry = self.s.entries[e];
            if !self.is_proved(&entry, from, to, dt) {
                needed |= self.geometry.pairs[entry.pair].needed;
                self.s.entries[kept] = entry;
                kept += 1;
            }
        }
        (needed, kept)
    }

    /// The criterion of the module's text, for the direction of either end.
    #[inline]
    fn is_proved(&mut self, entry: &Entry, from: usize, to: usize, dt: f64) -> bool {
        let pair = &self.geometry.pairs[entry.pair];
        let (curve_a, path_a) = self.reach(pair.a);
        let (curve_b, path_b) = self.reach(pair.b);
        let floor = entry.floor + self.deviation(entry.pair, |j| [self.s.swings[j].v, self.s.swings[j].a]);
        if entry.sep[0].max(entry.sep[1]) - (path_a + path_b) >= floor + CULL_MARGIN_M {
            return true;
        }
        let sag = (curve_a + curve_b) * dt * dt / 8.0;
        let other = self.separation_along(to, entry.pair, &entry.n[0]);
        if lowest(entry.sep[0], other, sag) >= floor {
            return true;
        }
        let other = self.separation_along(from, entry.pair, &entry.n[1]);
        lowest(other, entry.sep[1], sag) >= floor
    }

    /// Largest distance that the robot's interface may take from a pair while `speed` bounds the joints, m.
    #[inline]
    fn deviation(&self, pair: usize, speed: impl Fn(usize) -> [f64; 2]) -> f64 {
        match &self.geometry.deviation {
            Some(deviation) if self.purpose == Purpose::Decision => {
                deviation.loss_m(self.geometry, &self.geometry.pairs[pair], speed)
            }
            _ => 0.0,
        }
    }

    #[inline]
    fn deviation_at(&self, node: usize, pair: usize) -> f64 {
        self.deviation(pair, |j| speed(&self.s.nodes[node].x[j]))
    }

    #[inline]
    fn largest_deviation(&self, pair: usize) -> f64 {
        match &self.geometry.deviation {
            Some(deviation) if self.purpose == Purpose::Decision => deviation.largest[pair],
            _ => 0.0,
        }
    }

    fn begin_segment(&mut self) {
        self.s.segment += 1;
    }

    /// B_s (m/s^2) and the path (m) of one side of a pair over the current segment.
    #[inline]
    fn reach(&mut self, side: Side) -> (f64, f64) {
        let known = &mut self.s.reaches[side.capsule];
        if known.segment != self.s.segment {
            known.segment = self.s.segment;
            let shape = &self.geometry.shapes[side.capsule];
            shape.curves(&self.geometry.chain, &self.s.swings, &mut known.curve, &mut known.path);
        }
        (known.curve[side.from], known.path[side.from])
    }

    /// Kinematics of the joints `needed` at `t`.
    fn evaluate(&mut self, node: usize, t: f64, needed: JointSet, known: Option<&Anchor>) {
        let node = &mut self.s.nodes[node];
        node.t = t;
        node.known = 0;
        let mut q = [0.0; JOINTS_MAX];
        for j in joints(needed) {
            node.x[j] = self.motion.joints[j].at(t);
            q[j] = node.x[j].q;
        }
        if let Some(anchor) = known {
            node.placements = anchor.placements;
        } else {
            self.s.evaluations += 1;
            self.geometry.chain.forward(&q, needed, &mut node.placements);
        }
    }

    /// The direction between the pair's closest points at a node, in the common body's frame, and the separation.
    #[inline]
    fn direction(&mut self, node: usize, pair: usize) -> (Vector3<f64>, f64) {
        let pair = &self.geometry.pairs[pair];
        let node = &mut self.s.nodes[node];
        let (a, b) = (node.axis(self.geometry, pair.a.capsule), node.axis(self.geometry, pair.b.capsule));
        let (n, sep) = self.geometry.normal(pair, &a, &b);
        let n = if pair.turns { node.placements[pair.common].r.tr_mul(&n) } else { n };
        (n, sep)
    }

    /// Separation of a pair at a node along a direction of the common body's frame.
    #[inline]
    fn separation_along(&mut self, node: usize, pair: usize, n: &Vector3<f64>) -> f64 {
        let pair = &self.geometry.pairs[pair];
        let node = &mut self.s.nodes[node];
        let (a, b) = (node.axis(self.geometry, pair.a.capsule), node.axis(self.geometry, pair.b.capsule));
        let n = if pair.turns { node.placements[pair.common].r * n } else { *n };
        self.geometry.separation(pair, &n, &a, &b)
    }

    fn blame(&mut self, pair: usize) -> bool {
        self.s.blamed = pair;
        false
    }
}
