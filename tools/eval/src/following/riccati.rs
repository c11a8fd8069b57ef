//! The linear-quadratic step: the change of the accelerations that lowers a quadratic model of the cost most.
//! It works along a chain of nodes, each the double integrator of the previous one. It is a backward recursion
//! over blocks of five joints.

use nalgebra::{Cholesky, SMatrix};
use retarget::ARM_Q;

pub use follow::arm::ArmVector as Joints;

pub type Block = SMatrix<f64, ARM_Q, ARM_Q>;

/// The quadratic model of one node: the state to which an acceleration leads, and that acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// Second derivatives by positions.
    pub qq: Block,
    /// Second derivatives by position and speed of the same joint.
    pub qv: Joints,
    /// Second derivatives by speeds, each joint's own.
    pub vv: Joints,
    /// Second derivatives by accelerations, each joint's own. They are above zero.
    pub aa: Joints,
    pub q: Joints,
    pub v: Joints,
    pub a: Joints,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    pub q: Joints,
    pub v: Joints,
    pub a: Joints,
}

#[derive(Clone, Copy, Debug)]
struct Answer {
    by_q: Block,
    by_v: Block,
    alone: Joints,
}

#[derive(Clone, Copy, Debug, Default)]
struct Ahead {
    qq: Block,
    qv: Block,
    vv: Block,
    q: Joints,
    v: Joints,
}

impl Ahead {
    fn add(&mut self, node: &Node) {
        self.qq += node.qq;
        self.qv += Block::from_diagonal(&node.qv);
        self.vv += Block::from_diagonal(&node.vv);
        self.q += node.q;
        self.v += node.v;
    }

    /// Goes one node back, through q' = q + dt v + dt^2/2 a and v' = v + dt a.
    fn back(&self, node: &Node, dt: f64) -> Option<(Self, Answer)> {
        let half = 0.5 * dt * dt;
        let by_q = self.qq * half + self.qv.transpose() * dt;
        let reached = self.qv * half + self.vv * dt;
        let by_v = by_q * dt + reached;
        let curvature = by_q * half + reached * dt + Block::from_diagonal(&node.aa);
        let slope = self.q * half + self.v * dt + node.a;
        let solve = Cholesky::new((curvature + curvature.transpose()) * 0.5)?;
        let answer = Answer { by_q: -solve.solve(&by_q), by_v: -solve.solve(&by_v), alone: -solve.solve(&slope) };
        let qv = self.qq * dt + self.qv;
        let vv = self.qq * (dt * dt) + (self.qv + self.qv.transpose()) * dt + self.vv;
        let ahead = Self {
            qq: self.qq + by_q.transpose() * answer.by_q,
            qv: qv + by_q.transpose() * answer.by_v,
            vv: vv + by_v.transpose() * answer.by_v,
            q: self.q + by_q.transpose() * answer.alone,
            v: self.q * dt + self.v + by_v.transpose() * answer.alone,
        };
        Some((ahead, answer))
    }
}

/// Returns the change of every node that minimises the sum of the models. The state before the first node is
/// fixed. None if the sum has no minimum.
pub fn step(nodes: &[Node], dt: f64) -> Option<Vec<Change>> {
    let mut answers = Vec::with_capacity(nodes.len());
    let mut ahead = Ahead::default();
    for node in nodes.iter().rev() {
        ahead.add(node);
        let (before, answer) = ahead.back(node, dt)?;
        answers.push(answer);
        ahead = before;
    }
    let mut at = Change::default();
    let forward = answers.iter().rev().map(|answer| {
        let a = answer.by_q * at.q + answer.by_v * at.v + answer.alone;
        at = Change { q: at.q + at.v * dt + a * (0.5 * dt * dt), v: at.v + a * dt, a };
        at
    });
    Some(forward.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn riccati_step_minimises_the_sum() {
        let dt = 0.1;
        let node = |k: usize| {
            let number = |i: usize| ((7 * k + 3 * i) % 11) as f64 / 11.0;
            let rows = Block::from_fn(|i, j| number(i) - number(2 * j + 1));
            Node {
                qq: rows * rows.transpose(),
                qv: Joints::from_fn(|i, _| 0.1 * number(i)),
                vv: Joints::from_fn(|i, _| 1.0 + number(i + 1)),
                aa: Joints::from_fn(|i, _| 0.2 + number(i + 2)),
                q: Joints::from_fn(|i, _| number(i + 3) - 0.5),
                v: Joints::from_fn(|i, _| number(i + 4) - 0.5),
                a: Joints::from_fn(|i, _| number(i + 5) - 0.5),
            }
        };
        let nodes: Vec<Node> = (0..6).map(node).collect();
        let sum = |accelerations: &[Joints]| -> f64 {
            let (mut q, mut v, mut sum) = (Joints::zeros(), Joints::zeros(), 0.0);
            for (node, a) in nodes.iter().zip(accelerations) {
                q += v * dt + a * (0.5 * dt * dt);
                v += a * dt;
                sum += node.q.dot(&q) + node.v.dot(&v) + node.a.dot(a) + 0.5 * q.dot(&(node.qq * q));
                sum += (0..ARM_Q)
                    .map(|j| node.qv[j] * q[j] * v[j] + 0.5 * node.vv[j] * v[j] * v[j] + 0.5 * node.aa[j] * a[j] * a[j])
                    .sum::<f64>();
            }
            sum
        };
        let best: Vec<Joints> = step(&nodes, dt).expect("a minimum").iter().map(|change| change.a).collect();
        for k in 0..nodes.len() {
            for j in 0..ARM_Q {
                let moved = |by: f64| {
                    let mut other = best.clone();
                    other[k][j] += by;
                    sum(&other)
                };
                let slope = (moved(1e-4) - moved(-1e-4)) / 2e-4;
                assert!(slope.abs() < 1e-8, "node {k}, joint {j}: {slope}");
                assert!(moved(0.1) > sum(&best), "node {k}, joint {j}");
            }
        }
    }
}
