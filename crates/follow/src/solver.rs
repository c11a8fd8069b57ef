//! The best motion of one arm over the horizon, by differential dynamic programming with bounded accelerations.
//!
//! States are positions q and velocities v of the joints that turn limbs. Inputs are their accelerations u,
//! constant over an interval of d seconds:
//!
//! ```text
//! q' = q + d v + d^2 u / 2,   v' = v + d u,   |u| <= A,   |v'| <= V
//!
//! minimise  sum over nodes      d (w rho(angle of upper arm) + w rho(angle of forearm) + W_q (q beyond its range)^2
//!                                  + r_v |v|^2 + r_p |q - prior|^2    [r_p is larger at the last node]
//!                                  + W_g sum over gaps max(0, (5 mm - gap(q)) / 15 mm)^2
//!                                  + w W_h s rho(distance of the hand)  [of a hand that touches, from its place, with the weight s])
//!         + sum over intervals  d r_a |u / A|^2
//!
//! rho(x) = 2 c^2 (sqrt(1 + (x / c)^2) - 1)
//! ```
//!
//! The angle is that of the rotation from the person's limb to the robot's. rho is its square below c and grows in
//! proportion beyond. So a limb that cannot keep up pulls no harder when it falls further behind. With the square
//! alone, weights that smooth a dance would leave a raised arm wrong by degrees. The hand is that of
//! [`Arm::hand_center`]: the errors of all joints add up there.
//!
//! One iteration is a Gauss-Newton sweep backward over the nodes by a Riccati recursion. Inputs at their bounds
//! are held there, as in control-limited DDP (Tassa, Mansard, Todorov 2014). A rollout forward follows with a few
//! step lengths. The best one is taken, or none. The blocks of the dynamics are multiples of the identity, so
//! propagation needs only scaled sums of 5 x 5 blocks.

use crate::arm::{Arm, ArmVector, Limbs, ROWS};
use crate::gap::{GAP_M, Gaps};
use crate::{LIMB_JOINTS, NODES};
use nalgebra::{SMatrix, Vector3};

type Block = SMatrix<f64, LIMB_JOINTS, LIMB_JOINTS>;

/// Distance of a hand above which it counts in proportion and not by its square, m. The surfaces of hands that rest are as
/// near as this.
const HAND_KNEE_M: f64 = 0.02;

/// Step lengths that are tried.
const STEPS: [f64; 3] = [1.0, 0.5, 0.15];

/// Weights of the cost. The mean error over the clips decided them. See the table in the crate's documentation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Weight of accelerations, as a share of the bound.
    pub acceleration: f64,
    /// Angle above which an error counts in proportion and not by its square, rad.
    pub knee: f64,
    /// Weight of velocities, per (rad/s)^2.
    pub velocity: f64,
    /// Weight of the distance from the posture that retargeting proposes, per rad^2.
    pub prior: f64,
    /// Weight of that distance at the last node, per rad^2 and per rad of the limbs' error; see [`Problem::pull`].
    pub pull: f64,
    /// Growth of `pull`, as a share of it, per second in which the limbs come no nearer, 1/s.
    pub patience: f64,
    /// Weight of a position beyond its range, per rad^2.
    pub range: f64,
    /// Weight of a gap that is [`GAP_M`] too narrow.
    pub gap: f64,
    /// Weight of the place of a hand that touches, per m^2. Of 5, 10, 15, 20 and 40, this one left the boxer's hands nearest to
    /// head, chest and each other, and turned the limbs of everyday motion no further.
    pub hand: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            acceleration: 5e-3,
            knee: 0.08,
            velocity: 2e-3,
            prior: 2e-4,
            pull: 0.1,
            patience: 50.0,
            range: 30.0,
            gap: 0.3,
            hand: 20.0,
        }
    }
}

/// Bounds of the joints of one arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lowest positions, rad.
    pub q_min: ArmVector,
    /// Highest positions, rad.
    pub q_max: ArmVector,
    /// Speeds, rad/s.
    pub v_max: ArmVector,
    /// Accelerations, rad/s^2.
    pub a_max: ArmVector,
}

/// A state: positions and velocities, rad and rad/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Positions.
    pub q: ArmVector,
    /// Velocities.
    pub v: ArmVector,
}

impl Bounds {
    /// Returns the accelerations that a joint may have for `d` seconds at velocity `v`. They are within the limit
    /// and do not lead beyond the speed. A joint that is too fast brakes.
    #[inline]
    fn inputs(&self, j: usize, v: f64, d: f64) -> [f64; 2] {
        let (a, fastest) = (self.a_max[j], self.v_max[j]);
        // Unlike `clamp`, this accepts a velocity that is NaN.
        [(-(fastest + v) / d).max(-a).min(a), ((fastest - v) / d).max(-a).min(a)]
    }

    fn clamp(&self, u: &ArmVector, v: &ArmVector, d: f64) -> ArmVector {
        ArmVector::from_fn(|j, _| {
            let [low, high] = self.inputs(j, v[j], d);
            u[j].max(low).min(high)
        })
    }
}

impl State {
    /// The state after `d` seconds of acceleration `u`.
    #[inline]
    pub fn after(&self, u: &ArmVector, d: f64) -> Self {
        Self { q: self.q + self.v * d + u * (0.5 * d * d), v: self.v + u * d }
    }
}

/// Person to follow, and the start.
#[derive(Clone, Copy, Debug)]
pub struct Problem {
    /// State at the start.
    pub start: State,
    /// Length of each interval, s. Node i is at its end.
    pub interval_s: [f64; NODES],
    /// The person at each node.
    pub person: [Limbs; NODES],
    /// Weight of each node's error.
    pub weight: [f64; NODES],
    /// Posture that retargeting proposes, rad.
    pub prior: ArmVector,
    /// Weight of the distance from `prior` at the last node. If the plan ends far from the person, limbs alone may
    /// give no way there. A hanging arm has its shoulder axes in line, and must turn about itself before it can
    /// rise on the other side. The posture that retargeting proposes does give a way.
    pub pull: f64,
    /// Bounds.
    pub bounds: Bounds,
    /// Distances to the rest of the robot.
    pub gaps: Gaps,
    /// Place of the hand at each node, as in [`Arm::hand_center`], m, and its weight from 0 to 1. `None` for one that touches nothing.
    pub places: [Option<(Vector3<f64>, f64)>; NODES],
}

/// Working memory of the sweep.
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    /// Accelerations of each interval, rad/s^2.
    pub input: [ArmVector; NODES],
    nodes: [State; NODES],
    open: [ArmVector; NODES],
    feedback: [[Block; 2]; NODES],
    value: Value,
    cost: f64,
}

/// Quadratic model of the cost after a node.
#[derive(Clone, Copy, Debug, Default)]
struct Value {
    q: ArmVector,
    v: ArmVector,
    qq: Block,
    qv: Block,
    vv: Block,
}

impl Sweep {
    /// Starts an iteration from the accelerations in `input`.
    pub fn begin(&mut self, arm: &Arm, weights: &Weights, problem: &Problem) {
        let mut state = problem.start;
        self.cost = 0.0;
        for i in 0..NODES {
            self.input[i] = problem.bounds.clamp(&self.input[i], &state.v, problem.interval_s[i]);
            state = state.after(&self.input[i], problem.interval_s[i]);
            self.nodes[i] = state;
            self.cost += cost(arm, weights, problem, i, &state, &self.input[i]);
        }
        self.value = Value::default();
    }

    /// Cost of `input`, after `begin` or `finish`.
    pub fn cost(&self) -> f64 {
        self.cost
    }

    /// States at the nodes.
    pub fn nodes(&self) -> &[State; NODES] {
        &self.nodes
    }

    /// Sweeps node `i`. Each node must be swept once, the last one first.
    pub fn backward(&mut self, arm: &Arm, weights: &Weights, problem: &Problem, i: usize) {
        let d = problem.interval_s[i];
        let value = {
            let mut value = self.value;
            add_node(&mut value, arm, weights, problem, i, &self.nodes[i]);
            value
        };
        let (b, h) = (d, 0.5 * d * d);
        let bounds = &problem.bounds;
        let vq = value.qv.transpose();
        // Rows of B^T V A.
        let to_q = value.qq * h + vq * b;
        let to_v = to_q * d + value.qv * h + value.vv * b;
        let mut quu = value.qq * (h * h) + (value.qv + vq) * (h * b) + value.vv * (b * b);
        let mut qu = value.q * h + value.v * b;
        for j in 0..LIMB_JOINTS {
            let r = d * weights.acceleration / (bounds.a_max[j] * bounds.a_max[j]);
            quu[(j, j)] += r;
            qu[j] += r * self.input[i][j];
        }
        let v = if i == 0 { &problem.start.v } else { &self.nodes[i - 1].v };
        let change: [[f64; 2]; LIMB_JOINTS] =
            std::array::from_fn(|j| bounds.inputs(j, v[j], d).map(|bound| bound - self.input[i][j]));
        let (open, [gain_q, gain_v]) = bounded_step(&quu, &qu, &to_q, &to_v, &change);
        // V = A' V A, minus what the inputs save.
        let a_qv = value.qq * d + value.qv;
        let a_vv = value.qq * (d * d) + (value.qv + vq) * d + value.vv;
        self.value = Value {
            q: value.q + to_q.transpose() * open,
            v: value.q * d + value.v + to_v.transpose() * open,
            qq: symmetric(value.qq + to_q.transpose() * gain_q),
            qv: a_qv + to_q.transpose() * gain_v,
            vv: symmetric(a_vv + to_v.transpose() * gain_v),
        };
        (self.open[i], self.feedback[i]) = (open, [gain_q, gain_v]);
    }

    /// Rolls out and takes the best step, if one is better than none.
    pub fn finish(&mut self, arm: &Arm, weights: &Weights, problem: &Problem) {
        let mut best = self.cost;
        let (mut inputs, mut nodes) = (self.input, self.nodes);
        for step in STEPS {
            let (mut input, mut states) = (self.input, self.nodes);
            let mut state = problem.start;
            let mut before = problem.start;
            let mut cost_here = 0.0;
            for i in 0..NODES {
                let [gain_q, gain_v] = &self.feedback[i];
                let change = self.open[i] * step + gain_q * (state.q - before.q) + gain_v * (state.v - before.v);
                input[i] = problem.bounds.clamp(&(self.input[i] + change), &state.v, problem.interval_s[i]);
                before = self.nodes[i];
                state = state.after(&input[i], problem.interval_s[i]);
                states[i] = state;
                cost_here += cost(arm, weights, problem, i, &state, &input[i]);
            }
            // A NaN cost is not less.
            if cost_here < best {
                (best, inputs, nodes) = (cost_here, input, states);
            }
        }
        (self.cost, self.input, self.nodes) = (best, inputs, nodes);
    }
}

/// Pseudo-Huber loss: the square below the knee, a straight line beyond. A large error pulls no harder.
fn loss(squared: f64, knee: f64) -> f64 {
    2.0 * knee * knee * ((1.0 + squared / (knee * knee)).sqrt() - 1.0)
}

/// Its derivative by `squared`, which weighs the row of a Gauss-Newton step.
fn loss_slope(squared: f64, knee: f64) -> f64 {
    1.0 / (1.0 + squared / (knee * knee)).sqrt()
}

fn symmetric(m: Block) -> Block {
    (m + m.transpose()) * 0.5
}

/// Weight of the distance from the proposed posture at node `i`.
fn prior_weight(weights: &Weights, problem: &Problem, i: usize) -> f64 {
    weights.prior + if i + 1 == NODES { problem.pull } else { 0.0 }
}

fn cost(arm: &Arm, weights: &Weights, problem: &Problem, i: usize, state: &State, input: &ArmVector) -> f64 {
    let [upper, fore] = arm.angles(&state.q, &problem.person[i]);
    let mut sum = problem.weight[i] * (loss(upper * upper, weights.knee) + loss(fore * fore, weights.knee));
    if let Some((place, weight)) = problem.places[i] {
        let off_m = arm.hand_center(&state.q) - place;
        sum += problem.weight[i] * weights.hand * weight * loss(off_m.norm_squared(), HAND_KNEE_M);
    }
    let bounds = &problem.bounds;
    let prior = prior_weight(weights, problem, i);
    for j in 0..LIMB_JOINTS {
        let (q, v) = (state.q[j], state.v[j]);
        let beyond = (bounds.q_min[j] - q).max(q - bounds.q_max[j]).max(0.0);
        let u = input[j] / bounds.a_max[j];
        sum += weights.range * beyond * beyond
            + weights.velocity * v * v
            + prior * (q - problem.prior[j]).powi(2)
            + weights.acceleration * u * u;
    }
    for gap in problem.gaps.at_node(i) {
        sum += weights.gap * gap.missing(&state.q).powi(2);
    }
    sum * problem.interval_s[i]
}

/// Adds half the gradient and half the Hessian (Gauss-Newton) of a node's cost.
fn add_node(value: &mut Value, arm: &Arm, weights: &Weights, problem: &Problem, i: usize, state: &State) {
    let d = problem.interval_s[i];
    let error = arm.error(&state.q, &problem.person[i]);
    let w = d * problem.weight[i];
    let slopes = [0, 1].map(|limb| {
        let squared = error.rotation[3 * limb..3 * limb + 3].iter().map(|x| x * x).sum();
        loss_slope(squared, weights.knee)
    });
    for j in 0..LIMB_JOINTS {
        let column = &error.jacobian[j];
        let dot = |other: &[f64; ROWS]| (0..ROWS).map(|r| slopes[r / 3] * column[r] * other[r]).sum::<f64>();
        value.q[j] += w * dot(&error.rotation);
        for k in 0..=j {
            let entry = w * dot(&error.jacobian[k]);
            value.qq[(j, k)] += entry;
            if k < j {
                value.qq[(k, j)] += entry;
            }
        }
    }
    if let Some((place, weight)) = problem.places[i] {
        let (hand, jacobian) = arm.hand_jacobian(&state.q);
        let off_m = hand - place;
        let w = w * weights.hand * weight * loss_slope(off_m.norm_squared(), HAND_KNEE_M);
        for j in 0..LIMB_JOINTS {
            value.q[j] += w * jacobian[j].dot(&off_m);
            for k in 0..LIMB_JOINTS {
                value.qq[(j, k)] += w * jacobian[j].dot(&jacobian[k]);
            }
        }
    }
    let bounds = &problem.bounds;
    let prior = prior_weight(weights, problem, i);
    for j in 0..LIMB_JOINTS {
        let (q, v) = (state.q[j], state.v[j]);
        let beyond = q - q.clamp(bounds.q_min[j], bounds.q_max[j]);
        value.v[j] += d * weights.velocity * v;
        value.vv[(j, j)] += d * weights.velocity;
        value.q[j] += d * (weights.range * beyond + prior * (q - problem.prior[j]));
        value.qq[(j, j)] += d * (prior + if beyond == 0.0 { 0.0 } else { weights.range });
    }
    for gap in problem.gaps.at_node(i) {
        let missing = gap.missing(&state.q);
        if missing > 0.0 {
            let slope = gap.slope() / GAP_M;
            value.q -= slope * (d * weights.gap * missing);
            value.qq += slope * slope.transpose() * (d * weights.gap);
        }
    }
}

/// Returns the best change of the inputs within their bounds, and its feedback gains. Inputs that end at a bound
/// are held there, in at most one round for each.
fn bounded_step(
    quu: &Block,
    qu: &ArmVector,
    to_q: &Block,
    to_v: &Block,
    change: &[[f64; 2]; LIMB_JOINTS],
) -> (ArmVector, [Block; 2]) {
    let mut held = [false; LIMB_JOINTS];
    let mut open = ArmVector::zeros();
    for _ in 0..=LIMB_JOINTS {
        let free = reduced(quu, &held);
        let Some(factor) = free.cholesky() else {
            return (ArmVector::zeros(), [Block::zeros(); 2]);
        };
        let mut rest = -qu;
        for j in (0..LIMB_JOINTS).filter(|&j| held[j]) {
            for k in 0..LIMB_JOINTS {
                rest[k] -= quu[(k, j)] * open[j];
            }
        }
        for j in (0..LIMB_JOINTS).filter(|&j| held[j]) {
            rest[j] = open[j];
        }
        let step = factor.solve(&rest);
        let mut more = false;
        for j in 0..LIMB_JOINTS {
            let [low, high] = change[j];
            if !held[j] && !(low..=high).contains(&step[j]) {
                (held[j], more) = (true, true);
                open[j] = if step[j] < low { low } else { high };
            }
        }
        if !more {
            for j in (0..LIMB_JOINTS).filter(|&j| !held[j]) {
                open[j] = step[j];
            }
            let rows = |m: &Block| {
                let mut m = -*m;
                for j in (0..LIMB_JOINTS).filter(|&j| held[j]) {
                    m.row_mut(j).fill(0.0);
                }
                factor.solve(&m)
            };
            return (open, [rows(to_q), rows(to_v)]);
        }
    }
    (open, [Block::zeros(); 2])
}

/// Replaces the rows and columns of held inputs by the identity.
fn reduced(quu: &Block, held: &[bool; LIMB_JOINTS]) -> Block {
    let mut m = *quu;
    for j in (0..LIMB_JOINTS).filter(|&j| held[j]) {
        m.row_mut(j).fill(0.0);
        m.column_mut(j).fill(0.0);
        m[(j, j)] = 1.0;
    }
    m
}
