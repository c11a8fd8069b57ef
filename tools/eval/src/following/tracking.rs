//! Improves one arm's motion along one path of a person's limbs. The method is Gauss-Newton on the angles of
//! both limbs, with logarithmic barriers at the limits of position, speed and acceleration. So every iterate is
//! a motion within the limits.

use super::riccati::{Change, Joints, Node, step};
use follow::solver::{Bounds, State};
use retarget::{ARM_Q, ArmModel, ArmQ, Limbs};

/// Time between nodes, s.
pub const NODE_S: f64 = 0.02;
/// Weights of the barriers, one solve after the other. The first keeps a large distance to the limits. The last
/// is a thousandth of the cost of a degree.
const BARRIERS: [f64; 6] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Number of iterations with each barrier except the last, and with the last.
const ITERATIONS: [usize; 2] = [6, 40];
/// The iterations end with a step that lowers the cost by less than this share of it.
const SETTLED_SHARE: f64 = 1e-5;
/// Largest share of the distance to the nearest limit that a step may take.
const WAY_SHARE: f64 = 0.99;
/// Share of the acceleration with which a motion must be able to stop inside its range after the last node.
const BRAKE_SHARE: f64 = 0.8;
/// Smallest speed in the stopping distance, rad/s. It keeps the stopping distance smooth at rest.
const SLOW: f64 = 0.01;
/// An angle below this counts by its square, rad: 0.6 degrees.
const SMALL_RAD: f64 = 0.01;

/// Returns the accelerations over the next node that lead to rest within the limits, at 0.9 of them.
pub fn brake(state: &State, bounds: &Bounds) -> Joints {
    Joints::from_fn(|j, _| (-state.v[j] / NODE_S).clamp(-0.9 * bounds.a_max[j], 0.9 * bounds.a_max[j]))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Half the square of the angle. It is smooth, and converges from far away.
    Square,
    /// The angle itself, of which the mean error consists.
    Angle,
}

impl Loss {
    fn value(self, angle: f64) -> f64 {
        match self {
            Self::Square => 0.5 * angle * angle,
            Self::Angle => angle.hypot(SMALL_RAD) - SMALL_RAD,
        }
    }

    /// Returns the slope over the angle: the weight of the square that touches the loss from above.
    fn weight(self, angle: f64) -> f64 {
        match self {
            Self::Square => 1.0,
            Self::Angle => 1.0 / angle.hypot(SMALL_RAD),
        }
    }
}

/// A path to follow from a state. Node k of the motion belongs to `goal[k]`.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    pub arm: &'a ArmModel,
    pub bounds: &'a Bounds,
    pub goal: &'a [Limbs],
    pub start: State,
}

/// Accelerations between nodes, and the resulting states.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    pub a: Vec<Joints>,
    pub states: Vec<State>,
}

impl Motion {
    pub fn from(start: State, a: Vec<Joints>) -> Self {
        let mut at = start;
        let states = a.iter().map(|a| {
            at = at.after(a, NODE_S);
            at
        });
        Self { states: states.collect(), a }
    }

    /// Returns the state `after_s` after the start. None beyond the motion.
    pub fn at(&self, start: State, after_s: f64) -> Option<State> {
        let node = (after_s / NODE_S) as usize;
        let before = if node == 0 { start } else { *self.states.get(node - 1)? };
        Some(before.after(self.a.get(node)?, after_s - node as f64 * NODE_S))
    }

    fn moved(&self, changes: &[Change], share: f64) -> Self {
        let states = self.states.iter().zip(changes);
        Self {
            a: self.a.iter().zip(changes).map(|(a, change)| a + change.a * share).collect(),
            states: states.map(|(s, c)| State { q: s.q + c.q * share, v: s.v + c.v * share }).collect(),
        }
    }
}

/// Returns cost, slope and curvature of a value that must stay between two limits. The cost is infinite outside.
fn between(low: f64, high: f64, x: f64) -> (f64, f64, f64) {
    let (below, above) = ((x - low) / (high - low), (high - x) / (high - low));
    if !(below > 0.0 && above > 0.0) {
        return (f64::INFINITY, 0.0, 0.0);
    }
    let [below_rate, above_rate] = [x - low, high - x].map(f64::recip);
    let slope = above_rate - below_rate;
    (-below.ln() - above.ln(), slope, below_rate * below_rate + above_rate * above_rate)
}

/// A joint's room to stop towards one end of its range, with its derivatives.
struct Room {
    left: f64,
    by_v: f64,
    by_vv: f64,
}

/// Returns the room after braking, for `gap` to the end and speed `v` towards it. It subtracts one whole node
/// more than necessary.
fn room(gap: f64, v: f64, a_max: f64) -> Room {
    let root = v.hypot(SLOW);
    // Speed towards the end. It goes smoothly to zero if the joint moves away.
    let (w, by_v, by_vv) = (0.5 * (v + root), 0.5 * (1.0 + v / root), 0.5 * SLOW * SLOW / root.powi(3));
    let brake = BRAKE_SHARE * a_max;
    let by_w = w / brake + NODE_S;
    Room {
        left: gap - w * w / (2.0 * brake) - w * NODE_S,
        by_v: -by_w * by_v,
        by_vv: -(by_v * by_v / brake + by_w * by_vv),
    }
}

impl Task<'_> {
    /// Returns the bounds, widened to hold `motion` and its stop. Rounding and a start on the limit need this.
    pub fn bounds_around(&self, motion: &Motion) -> Bounds {
        const MARGIN_RAD: f64 = 1e-3;
        let mut bounds = *self.bounds;
        for (k, state) in motion.states.iter().enumerate() {
            let last = k + 1 == motion.states.len();
            for j in 0..ARM_Q {
                let ahead = |gap: f64, v: f64| if last { room(gap, v, bounds.a_max[j]).left } else { gap };
                let over = MARGIN_RAD - ahead(bounds.q_max[j] - state.q[j], state.v[j]);
                let under = MARGIN_RAD - ahead(state.q[j] - bounds.q_min[j], -state.v[j]);
                bounds.q_max[j] += over.max(0.0);
                bounds.q_min[j] -= under.max(0.0);
            }
        }
        bounds
    }

    /// Returns the cost of a motion, without barriers.
    pub fn loss(&self, motion: &Motion, loss: Loss) -> f64 {
        let nodes = motion.states.iter().zip(self.goal);
        let at_node = |(state, goal): (&State, &Limbs)| {
            angles(&self.arm.residual(&state.q.into(), goal)).map(|angle| loss.value(angle)).iter().sum::<f64>()
        };
        nodes.map(at_node).sum()
    }

    fn barrier(&self, motion: &Motion) -> f64 {
        let Bounds { q_min, q_max, v_max, a_max } = self.bounds;
        let mut sum = 0.0;
        for (state, a) in motion.states.iter().zip(&motion.a) {
            for j in 0..ARM_Q {
                sum += between(q_min[j], q_max[j], state.q[j]).0;
                sum += between(-v_max[j], v_max[j], state.v[j]).0 + between(-a_max[j], a_max[j], a[j]).0;
            }
        }
        if let Some(last) = motion.states.last() {
            for j in 0..ARM_Q {
                for (gap, v) in [(q_max[j] - last.q[j], last.v[j]), (last.q[j] - q_min[j], -last.v[j])] {
                    let left = room(gap, v, a_max[j]).left;
                    sum += if left > 0.0 { -left.ln() } else { f64::INFINITY };
                }
            }
        }
        sum
    }

    fn cost(&self, motion: &Motion, loss: Loss, barrier: f64) -> f64 {
        let inside = self.barrier(motion);
        if inside.is_finite() { self.loss(motion, loss) + barrier * inside } else { f64::INFINITY }
    }

    /// Returns the quadratic model about a motion. `damping` is added to the curvature by positions.
    fn model(&self, motion: &Motion, loss: Loss, barrier: f64, damping: f64) -> Vec<Node> {
        let Bounds { q_min, q_max, v_max, a_max } = self.bounds;
        let model = |((state, a), goal): ((&State, &Joints), &Limbs)| {
            let (mut node, q) = (Node::default(), state.q.into());
            add_limbs(&mut node, self.arm, &q, goal, loss);
            for j in 0..ARM_Q {
                let (_, slope, curvature) = between(q_min[j], q_max[j], state.q[j]);
                node.q[j] += barrier * slope;
                node.qq[(j, j)] += barrier * curvature + damping;
                let (_, slope, curvature) = between(-v_max[j], v_max[j], state.v[j]);
                (node.v[j], node.vv[j]) = (barrier * slope, barrier * curvature);
                let (_, slope, curvature) = between(-a_max[j], a_max[j], a[j]);
                (node.a[j], node.aa[j]) = (barrier * slope, barrier * curvature);
            }
            node
        };
        let nodes = motion.states.iter().zip(&motion.a).zip(self.goal);
        let mut nodes: Vec<Node> = nodes.map(model).collect();
        if let (Some(node), Some(last)) = (nodes.last_mut(), motion.states.last()) {
            for j in 0..ARM_Q {
                let ends = [(1.0, q_max[j] - last.q[j]), (-1.0, last.q[j] - q_min[j])];
                for (sign, gap) in ends {
                    let Room { left, by_v, by_vv } = room(gap, sign * last.v[j], a_max[j]);
                    // The gap falls by one where the position moves towards the end.
                    node.q[j] += barrier * sign / left;
                    node.v[j] -= barrier * sign * by_v / left;
                    node.qq[(j, j)] += barrier / (left * left);
                    node.qv[j] -= barrier * by_v / (left * left);
                    node.vv[j] += barrier * (by_v * by_v / (left * left) - by_vv / left);
                }
            }
        }
        nodes
    }

    /// Returns the largest share of a change after which every position, speed and acceleration is still inside.
    fn way(&self, motion: &Motion, changes: &[Change]) -> f64 {
        let Bounds { q_min, q_max, v_max, a_max } = self.bounds;
        let mut way: f64 = 1.0;
        let mut allow = |low: f64, high: f64, x: f64, dx: f64| {
            let gap = if dx > 0.0 { high - x } else { x - low };
            if dx.abs() * way > WAY_SHARE * gap {
                way = WAY_SHARE * gap / dx.abs();
            }
        };
        for ((state, a), change) in motion.states.iter().zip(&motion.a).zip(changes) {
            for j in 0..ARM_Q {
                allow(q_min[j], q_max[j], state.q[j], change.q[j]);
                allow(-v_max[j], v_max[j], state.v[j], change.v[j]);
                allow(-a_max[j], a_max[j], a[j], change.a[j]);
            }
        }
        way
    }

    /// Improves a motion that lies inside all limits until it hardly improves any more.
    pub fn improve(&self, mut motion: Motion, loss: Loss) -> Motion {
        let mut damping = 1e-6;
        for (i, &barrier) in BARRIERS.iter().enumerate() {
            let iterations = ITERATIONS[usize::from(i + 1 == BARRIERS.len())];
            let mut cost = self.cost(&motion, loss, barrier);
            for _ in 0..iterations {
                let Some((better, less)) = self.descend(&motion, loss, barrier, cost, &mut damping) else { break };
                let settled = cost - less < SETTLED_SHARE * cost.abs();
                (motion, cost) = (better, less);
                if settled {
                    break;
                }
            }
        }
        motion
    }

    /// Returns one step that lowers the cost, and the new cost. None if there is none.
    fn descend(
        &self,
        motion: &Motion,
        loss: Loss,
        barrier: f64,
        cost: f64,
        damping: &mut f64,
    ) -> Option<(Motion, f64)> {
        for _ in 0..8 {
            let nodes = self.model(motion, loss, barrier, *damping);
            if let Some(changes) = step(&nodes, NODE_S) {
                let mut share = self.way(motion, &changes);
                for _ in 0..6 {
                    let moved = motion.moved(&changes, share);
                    let less = self.cost(&moved, loss, barrier);
                    if less < cost {
                        *damping = (*damping / 3.0).max(1e-9);
                        return Some((moved, less));
                    }
                    share *= 0.4;
                }
            }
            *damping *= 30.0;
        }
        None
    }
}

/// Returns the rotation angles of both limbs, rad, from the vector parts of their quaternions' differences.
fn angles(residual: &[f64; 6]) -> [f64; 2] {
    let angle = |x: f64, y: f64, z: f64| 2.0 * (x * x + y * y + z * z).sqrt().min(1.0).asin();
    [angle(residual[0], residual[1], residual[2]), angle(residual[3], residual[4], residual[5])]
}

/// Adds the terms of both limbs. Let p = sin(angle / 2) axis be the vector part of a difference. The rotation
/// vector is e = g p with g = 2 asin(s) / s and s = |p|. Its derivative is de = g dp + (dg/ds) / s p (p . dp).
fn add_limbs(node: &mut Node, arm: &ArmModel, q: &ArmQ, goal: &Limbs, loss: Loss) {
    let linear = arm.linearize(q, goal);
    for limb in 0..2 {
        let p: [f64; 3] = std::array::from_fn(|i| linear.residual[3 * limb + i]);
        let s = p.iter().map(|x| x * x).sum::<f64>().sqrt().min(1.0);
        let (g, bend) = if s < 1e-4 {
            (2.0, 2.0 / 3.0)
        } else {
            let g = 2.0 * s.asin() / s;
            // Opposite to the goal there is no direction. A thousandth before it there is one.
            (g, (2.0 / (1.0 - s * s).max(1e-6).sqrt() - g) / (s * s))
        };
        let e = p.map(|x| g * x);
        let by: [[f64; 3]; ARM_Q] = std::array::from_fn(|j| {
            let dp: [f64; 3] = std::array::from_fn(|i| linear.jacobian[j][3 * limb + i]);
            let along: f64 = (0..3).map(|i| p[i] * dp[i]).sum();
            std::array::from_fn(|i| g * dp[i] + bend * p[i] * along)
        });
        let weight = loss.weight(g * s);
        let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for j in 0..ARM_Q {
            node.q[j] += weight * dot(&by[j], &e);
            for i in 0..ARM_Q {
                node.qq[(i, j)] += weight * dot(&by[i], &by[j]);
            }
        }
    }
}
