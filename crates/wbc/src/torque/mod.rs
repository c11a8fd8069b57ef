//! Proves that a planned motion needs no more than a motor's share of the effort limit, at every instant.
//!
//! # Derivation
//!
//! *Torque.* By d'Alembert's principle the torque of joint j is the sum over all mass dm that it carries
//!
//! ```text
//! tau_j = integral dm J_j . (x'' + g e_z),     x'' = sum_k J_k a_k + sum_i sum_k dJ_k/dq_i v_i v_k
//! ```
//!
//! with J_k = dx/dq_k. At single instants it is computed by Newton and Euler ([`dynamics`](crate::dynamics)).
//! Between two instants, t0 and t1 = t0 + dt, it is bounded.
//!
//! *Chord.* Let b_k be the chord of the acceleration a_k on [t0, t1], and d_k the largest |a_k - b_k|. a_k is
//! piecewise linear, so d_k is found at its kinks. Let F_j be the torque for b in place of a. Then |tau_j - F_j| <=
//! sum_k |M_jk| d_k. F_j equals tau_j at t0 and t1. Its second derivative exists except at the kinks, and F_j' is
//! continuous. So F_j leaves its chord by at most dt^2 / 8 sup |F_j''|. Hence on the whole segment
//!
//! ```text
//! |tau_j| <= max(|tau_j(t0)|, |tau_j(t1)|) + dt^2 / 8 sup |F_j''| + sum_k |M_jk| d_k
//! ```
//!
//! *F''.* Take dm on body b. Seen from the axis of joint k, its position is a sum of vectors. Each vector is
//! turned by the joints from the base to some body at or before b. If |v_m| and |a_m| bound the joints'
//! speeds and accelerations, a product of rotations by those joints has derivatives of norm at most
//!
//! ```text
//! O1 = sum_m |v_m|,     O2 = O1^2 + sum_m |a_m|            (m turns, from the base to b)
//! ```
//!
//! So |J_k| <= R_k, |J_k'| <= R_k O1 and |J_k''| <= R_k O2, with the reach R_k of dm. R_k is the distance of the next
//! joint's origin from axis k, plus the lengths of the later offsets, plus the distance of dm from the origin of b. If
//! k is b's own joint, the last distance is from b's axis. dJ_k/dq_i = z_i x J_k for i <= k has the same bounds. So x''
//! is at most sum_k R_k c_k times a product of rotations by at most all joints to b, with
//!
//! ```text
//! c_k   = |b_k| + |v_k| (|v_k| + 2 V_k)                               V_k, A_k, Y_k: sums of |v|, |a|, |jerk| of the
//! c_k'  = |b_k'| + 2 |v_k a_k| + 2 (|v_k| A_k + |a_k| V_k)            joints that turn before k
//! c_k'' = 2 (|v_k jerk_k| + a_k^2) + 2 (|v_k| Y_k + 2 |a_k| A_k + |jerk_k| V_k)
//! ```
//!
//! A prismatic joint comes before all revolute ones. It turns nothing, and its acceleration adds to gravity,
//! G = g + |b_s|. Let W_jb = integral dm R_j (for which the centre of mass is enough) and N_jkb = integral dm
//! R_j R_k. Then the product rule gives
//!
//! ```text
//! |F_j''| <= sum_b [ W_jb (G O2 + 2 O1 |b_s'|) + sum_k N_jkb (c_k 2 (O2 + O1^2) + 4 O1 c_k' + c_k'') ]      j turns
//! |F_s''| <= sum_b sum_k W_kb (c_k O2 + 2 O1 c_k' + c_k'')                                                  s slides
//! ```
//!
//! and |M_jk| <= sum_b N_jkb, |M_js| <= sum_b W_jb, |M_ss| = all mass. By Cauchy and Schwarz, the integrals
//! need only the body's mass, its second moment about its origin, and the one about its own axis.
//!
//! *Limit.* A joint's limit is [`SHARE`] of its effort limit. A robot that needs more than that to hold its
//! posture takes no decision, because the stop after any motion would need still more. Before the start such
//! a posture is refused, and the joint is named ([`overloaded_at_rest`](crate::overloaded_at_rest)).
//!
//! *Induction* is that of the [`certificate`](crate::certificate). At rest within the limits the constant
//! plan is proved. An accepted motion is proved to rest, and so is its remainder. A motion that is not
//! accepted is not sent. A joint keeps its proof if no fresh joint carries it and it carries no fresh joint.
//!
//! *Rounding.* Torques are sums of some hundred products below 1e4. They err by less than 1e-9 N m, ten
//! orders below the limits. The proof is repeated from the present state whenever a joint takes a decision.
//!
//! *Segments.* They are halved until they are proved. If kinks cause most of the difference, they are cut at
//! the sharpest kink. The motion is rejected once a segment would be shorter than 1.2 ms, or after a fixed
//! number of evaluations. This can give fewer proofs, but never false ones.
//!
//! *Model.* The torque is that of the rigid links of the URDF and of the hands' payload, a point mass in
//! each. The rest of the effort limit is for the motors' rotors and friction.
//!
//! *Payload.* The payload of a hand is a point mass on its body. It may change at rest. If the posture can be
//! held with it, the constant plan is proved and the induction starts again. If not, no decision is taken, as above.

mod curve;
#[cfg(test)]
mod tests;

use crate::chain::{BODIES, JointSet, KinematicChain, TurnedJoints, UNTURNED, joints, turn_joints};
use crate::config::WbcError;
use crate::dynamics::{Dynamics, Mass, PerJoint};
use crate::plan::{JointState, PlannedMotion};
use crate::trajectory::{Arc, Trajectory};
use curve::Curves;
use messages::{JOINTS_MAX, JointMotion};
use robot::Payload;

/// Share of each effort limit that a motion may need. The rest is for rotors, friction, and the servo's corrections.
pub const SHARE: f64 = 0.85;
/// Shorter segments are not cut, s.
const SHORTEST_S: f64 = 2.4e-3;
/// Largest depth of cuts. 2.4 ms * 2^8 = 0.6 s is longer than any stop, and the others are for kinks.
const DEPTH_MAX: usize = 20;
/// Evaluations of the dynamics after which one motion is rejected, and the number for all attempts of a tick.
const EVALUATIONS_MAX: u32 = 64;
const EVALUATIONS_OF_TICK: u32 = 120;
/// A torque may exceed its limit by this rounding, N m or N. See the module's text.
const ROUNDING: f64 = 1e-9;

/// The masses and motors of a robot.
#[derive(Clone, Debug)]
pub(crate) struct Load {
    pub(crate) dynamics: Dynamics,
    curves: Curves,
    /// [`SHARE`] of the effort limits, N m or N.
    pub(crate) limit: PerJoint,
    /// Payload of the hands.
    payload: [Payload; 2],
    /// Joints that the torque of each depends on: those that carry it, itself, and those that it carries.
    related: [JointSet; JOINTS_MAX],
}

impl Load {
    pub(crate) fn new(
        chain: &KinematicChain,
        masses: &[Mass; BODIES],
        effort_max: &PerJoint,
    ) -> Result<Self, WbcError> {
        let related = std::array::from_fn(|j| {
            let below = (0..chain.count()).filter(|&k| chain.ancestors(k + 1) & 1 << j != 0);
            below.fold(chain.ancestors(j + 1), |set, k| set | 1 << k)
        });
        let (dynamics, curves) = (Dynamics::new(chain, masses), Curves::new(chain, masses)?);
        Ok(Self {
            dynamics,
            curves,
            limit: effort_max.map(|effort| SHARE * effort),
            payload: [Payload::EMPTY; 2],
            related,
        })
    }

    /// Sets the payload of the hands. Never allocates.
    pub(crate) fn carry(&mut self, payload: &[Payload; 2]) {
        self.payload = *payload;
        self.dynamics.carry(payload);
        self.curves.carry(payload);
    }

    /// Payload of the hands.
    pub(crate) fn payload(&self) -> &[Payload; 2] {
        &self.payload
    }

    /// The first joint that needs more than its limit to hold `q` at rest, with its torque and the limit, N m or N.
    pub(crate) fn overloaded_at_rest(&self, chain: &KinematicChain, q: &PerJoint) -> Option<(usize, f64, f64)> {
        let still = JointMotion::rest(*q);
        let torques = self.torques(chain, &std::array::from_fn(|j| still.joint(j)));
        let over = (0..chain.count()).find(|&j| {
            let kept = torques[j].abs() <= self.limit[j];
            !kept
        })?;
        Some((over, torques[over], self.limit[over]))
    }

    /// Joints whose torque depends on one of `fresh`.
    pub(crate) fn affected(&self, fresh: JointSet) -> JointSet {
        (0..JOINTS_MAX)
            .filter(|&j| self.related[j] & fresh != 0 && self.limit[j].is_finite())
            .fold(0, |set, j| set | 1 << j)
    }

    /// Joints on which the torque of `joint` depends.
    pub(crate) fn related(&self, joint: usize) -> JointSet {
        self.related[joint]
    }

    /// Joints on which a torque of `open` depends.
    pub(crate) fn needed(&self, open: JointSet) -> JointSet {
        joints(open).fold(0, |set, j| set | self.related[j])
    }

    /// Torques of all joints, N m or N.
    pub(crate) fn torques(&self, chain: &KinematicChain, x: &[JointState; JOINTS_MAX]) -> PerJoint {
        let (mut torques, mut turned) = ([0.0; JOINTS_MAX], UNTURNED);
        turn_joints(chain, |j| x[j].q, chain.all(), &mut turned);
        self.dynamics.torques(chain, &turned, x, chain.all(), &mut torques);
        torques
    }
}

/// The motion at one instant.
#[derive(Clone, Copy, Debug)]
struct Node {
    t: f64,
    x: [JointState; JOINTS_MAX],
    torque: PerJoint,
}

/// Working memory.
#[derive(Clone, Debug)]
pub(crate) struct TorqueScratch {
    nodes: [Node; DEPTH_MAX + 3],
    /// The joints at the node that was evaluated last.
    turned: TurnedJoints,
    evaluations: u32,
    /// Number of evaluations that the tick may still make.
    left: u32,
    blamed: usize,
}

impl TorqueScratch {
    pub(crate) fn new() -> Self {
        let node = Node { t: 0.0, x: [JointState::default(); JOINTS_MAX], torque: [0.0; JOINTS_MAX] };
        let left = EVALUATIONS_OF_TICK;
        Self { nodes: [node; DEPTH_MAX + 3], turned: UNTURNED, evaluations: 0, left, blamed: 0 }
    }

    /// Begins a new tick, in which no evaluation has been made.
    pub(crate) fn begin_tick(&mut self) {
        self.left = EVALUATIONS_OF_TICK;
    }
}

/// Result of the proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueVerdict {
    /// The joint whose torque could not be proved, if any. None means that all keep their limits at every instant.
    pub blamed: Option<usize>,
    /// Evaluations of the dynamics.
    pub evaluations: u32,
}

/// Proves `motion`, in which the joints `fresh` take new decisions, from the posture `now`. Joints whose torque does not
/// depend on these are not checked, because they continue a proved plan.
pub(crate) fn prove(
    load: &Load,
    chain: &KinematicChain,
    (motion, now): (&Trajectory, &TurnedJoints),
    fresh: JointSet,
    scratch: &mut TorqueScratch,
) -> TorqueVerdict {
    let before = scratch.left;
    scratch.evaluations = 0;
    let mut proof = Proof { load, chain, motion, now, s: scratch };
    let proved = proof.whole(load.affected(fresh));
    let evaluations = scratch.evaluations;
    scratch.left = before.saturating_sub(evaluations);
    TorqueVerdict { blamed: (!proved).then_some(scratch.blamed), evaluations }
}

struct Proof<'a> {
    load: &'a Load,
    chain: &'a KinematicChain,
    motion: &'a Trajectory,
    now: &'a TurnedJoints,
    s: &'a mut TorqueScratch,
}

impl Proof<'_> {
    fn whole(&mut self, open: JointSet) -> bool {
        if open == 0 {
            return true;
        }
        let needed = self.load.needed(open);
        self.evaluate(0, 0.0, needed);
        let end_s = self.motion.end_s();
        if end_s <= 0.0 {
            return self.keeps(0, open);
        }
        self.evaluate(1, end_s, needed);
        self.keeps(0, open) && self.keeps(1, open) && self.between(0, 1, 0, open)
    }

    /// Proves the joints `open` between two nodes.
    fn between(&mut self, from: usize, to: usize, depth: usize, open: JointSet) -> bool {
        let (open, cut) = self.unproved(from, to, open);
        if open == 0 {
            return true;
        }
        let dt = self.s.nodes[to].t - self.s.nodes[from].t;
        let spent = self.s.evaluations >= EVALUATIONS_MAX.min(self.s.left);
        if spent || depth == DEPTH_MAX || dt < SHORTEST_S {
            return self.blame(open.trailing_zeros() as usize);
        }
        let middle = depth + 2;
        self.evaluate(middle, cut, self.load.needed(open));
        self.keeps(middle, open)
            && self.between(from, middle, depth + 1, open)
            && self.between(middle, to, depth + 1, open)
    }

    /// Returns the joints of `open` that the bound does not prove between two nodes, and where to cut for the
    /// first of them.
    fn unproved(&mut self, from: usize, to: usize, open: JointSet) -> (JointSet, f64) {
        let set = self.load.needed(open);
        let (from, to) = (&self.s.nodes[from], &self.s.nodes[to]);
        let mut arcs = [Arc::default(); JOINTS_MAX];
        for j in joints(set) {
            arcs[j] = self.motion.joints[j].arc(from.t, to.t, from.x[j], to.x[j]);
        }
        let [curve, kink] = self.load.curves.slack(&arcs, open, set, to.t - from.t);
        let unproved = joints(open).filter(|&j| {
            let most = from.torque[j].abs().max(to.torque[j].abs()) + curve[j] + kink[j];
            let proved = most <= self.load.limit[j] + ROUNDING;
            !proved
        });
        let open: JointSet = unproved.fold(0, |set, j| set | 1 << j);
        let first = open.trailing_zeros() as usize;
        if open != 0 && kink[first] > curve[first] {
            (open, self.load.curves.sharpest(&arcs, first))
        } else {
            (open, 0.5 * (from.t + to.t))
        }
    }

    fn evaluate(&mut self, node: usize, t: f64, needed: JointSet) {
        let TorqueScratch { nodes, turned, evaluations, .. } = &mut *self.s;
        let node = &mut nodes[node];
        node.t = t;
        let mut at_rest = true;
        for j in joints(needed) {
            node.x[j] = self.motion.joints[j].at(t);
            at_rest &= node.x[j].is_at_rest();
        }
        if t > 0.0 {
            turn_joints(self.chain, |j| node.x[j].q, needed, turned);
        }
        let turned = if t > 0.0 { turned } else { self.now };
        if at_rest {
            self.load.dynamics.torques_at_rest(self.chain, turned, needed, &mut node.torque);
        } else {
            self.load.dynamics.torques(self.chain, turned, &node.x, needed, &mut node.torque);
        }
        *evaluations += 1;
    }

    /// Returns true if the torques of `open` are within their limits at a node.
    fn keeps(&mut self, node: usize, open: JointSet) -> bool {
        let (s, limit) = (&*self.s, &self.load.limit);
        let broken = joints(open).find(|&j| {
            let kept = s.nodes[node].torque[j].abs() <= limit[j] + ROUNDING;
            !kept
        });
        broken.is_none_or(|j| self.blame(j))
    }

    fn blame(&mut self, joint: usize) -> bool {
        self.s.blamed = joint;
        false
    }
}
