//! The loss terms and their gradient over one batch, without labels and without pairs.
//!
//! `L = 10 S_GR(x_h, FK(D(Q_h(x_h)))) + 3 angle + 5 overrun + 20 |q - q'|^2 + 1 triplet + 1 |x_r - D(Q_r(x_r))|`
//! `+ 0.2 |Q_h(x_h) - Q_r(D(Q_h(x_h)))|`
//!
//! Here q' is the posture for the same pose under a tracker's noise, and overrun is that of the joint limits by
//! the unclamped output. Every term is a mean. The kinematics see the clamped output and move only outputs
//! inside the limits. Outputs outside are brought back by the overrun alone.

use crate::kinematics::{ARM, Arm, s_gr};
use crate::mlp::Trace;
use crate::networks::{LATENT, Networks, REACH};
use crate::sampling::Batch;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PerTerm<T> {
    /// S_GR of the retargeted pose, summed over the arm's two limbs.
    pub kinematics: T,
    /// Smoothed angle of the retargeted pose, rad, summed over the limbs. S_GR is flat near 0 and near 180
    /// degrees: small errors remain, and large ones are trapped. The angle is not flat there.
    pub angle: T,
    /// Overrun of the joint limits by the unclamped output, rad, mean over joints.
    pub limits: T,
    /// |q - q'|^2 of two poses that differ by a tracker's noise, rad^2, summed over the joints. Near the
    /// shoulder's gimbal an exact answer would turn noise into large turns of joints 1 and 3.
    pub steadiness: T,
    /// Triplet hinge in the latent space.
    pub triplet: T,
    /// |x_r - D(Q_r(x_r))|, rad, mean over joints.
    pub reconstruction: T,
    /// |z - Q_r(D(z))| of human latents, mean over the latent's components.
    pub cycle: T,
}

/// Weights of the loss terms. The default is zero.
pub type Weighting = PerTerm<f32>;
/// The unweighted value of every term, as means over the batch.
pub type Terms = PerTerm<f64>;

impl<T: Copy> PerTerm<T> {
    pub fn zip<U: Copy, V>(&self, other: &PerTerm<U>, combine: impl Fn(T, U) -> V) -> PerTerm<V> {
        PerTerm {
            kinematics: combine(self.kinematics, other.kinematics),
            angle: combine(self.angle, other.angle),
            limits: combine(self.limits, other.limits),
            steadiness: combine(self.steadiness, other.steadiness),
            triplet: combine(self.triplet, other.triplet),
            reconstruction: combine(self.reconstruction, other.reconstruction),
            cycle: combine(self.cycle, other.cycle),
        }
    }
}

impl Weighting {
    /// The best weights in measurements (`weights/EXPERIMENTS.md`). The paper has 10 triplet + 5 reconstruction
    /// + 1 cycle and no kinematics.
    pub const OURS: Self = Self {
        kinematics: 10.0,
        angle: 3.0,
        limits: 5.0,
        steadiness: 20.0,
        triplet: 1.0,
        reconstruction: 1.0,
        cycle: 0.2,
    };
}

impl Terms {
    pub fn total(&self, weighting: &Weighting) -> f64 {
        let of = self.zip(weighting, |value, weight| value * f64::from(weight));
        let human = of.kinematics + of.angle + of.limits + of.steadiness;
        human + of.triplet + of.reconstruction + of.cycle
    }
}

/// Margin of the triplet loss, latent units (ImitationNet, section III).
pub const MARGIN: f32 = 0.05;

/// Data of one thread for one batch: the batch, the buffers of the passes, and the gradient.
#[derive(Clone, Debug)]
pub struct Shard {
    pub batch: Batch,
    /// dL/dparameters of the last `evaluate`.
    pub gradient: Vec<f32>,
    human: Trace,
    robot: Trace,
    decoder: Trace,
    cycle: Trace,
    grad_human: Vec<f32>,
    grad_robot: Vec<f32>,
    grad_cycle: Vec<f32>,
    grad_output: Vec<f32>,
    grad_latent: Vec<f32>,
    grad_cycle_input: Vec<f32>,
}

impl Shard {
    pub fn new(networks: &Networks, rows: usize) -> Self {
        Self {
            batch: Batch::new(rows),
            gradient: vec![0.0; networks.parameters()],
            human: networks.human.trace(rows),
            robot: networks.robot.trace(rows),
            decoder: networks.decoder.trace(2 * rows),
            cycle: networks.robot.trace(rows),
            grad_human: vec![0.0; rows * LATENT],
            grad_robot: vec![0.0; rows * LATENT],
            grad_cycle: vec![0.0; rows * LATENT],
            grad_output: vec![0.0; 2 * rows * ARM],
            grad_latent: vec![0.0; 2 * rows * LATENT],
            grad_cycle_input: vec![0.0; rows * ARM],
        }
    }

    /// Returns all terms of the shard's batch, and sets `gradient` = dL/dparameters.
    pub fn evaluate(&mut self, networks: &Networks, arm: &Arm, parameters: &[f32], weighting: &Weighting) -> Terms {
        let rows = self.batch.rows();
        self.gradient.fill(0.0);
        self.grad_human.fill(0.0);
        self.grad_robot.fill(0.0);
        self.forward(networks, parameters);
        let cycle = self.cycle_term(weighting.cycle);
        let cycle_input = Some(self.grad_cycle_input.as_mut_slice());
        networks.robot.backward(parameters, &mut self.cycle, &self.grad_cycle, &mut self.gradient, cycle_input);
        let (kinematics, angle, limits) = self.human_outputs(arm, weighting);
        let steadiness = self.steadiness_term(arm, weighting.steadiness);
        let reconstruction = self.robot_outputs(arm, weighting.reconstruction);
        let latent = Some(self.grad_latent.as_mut_slice());
        networks.decoder.backward(parameters, &mut self.decoder, &self.grad_output, &mut self.gradient, latent);
        let triplet = self.triplet_term(weighting.triplet);
        let (of_human, of_robot) = self.grad_latent.split_at(rows * LATENT);
        self.grad_human.iter_mut().zip(of_human).for_each(|(g, v)| *g += v);
        self.grad_robot.iter_mut().zip(of_robot).for_each(|(g, v)| *g += v);
        networks.human.backward(parameters, &mut self.human, &self.grad_human, &mut self.gradient, None);
        networks.robot.backward(parameters, &mut self.robot, &self.grad_robot, &mut self.gradient, None);
        Terms { kinematics, angle, limits, steadiness, triplet, reconstruction, cycle }
    }

    /// Runs both encoders, and the decoder on both latents. The decoder's output becomes 1.02 tanh, the
    /// normalised joint positions. Then runs the robot encoder on the decoder's output for the human latents.
    fn forward(&mut self, networks: &Networks, parameters: &[f32]) {
        let latents = self.batch.rows() * LATENT;
        self.human.input.copy_from_slice(&self.batch.features);
        self.robot.input.copy_from_slice(&self.batch.posture);
        networks.human.forward(parameters, &mut self.human);
        networks.robot.forward(parameters, &mut self.robot);
        self.decoder.input[..latents].copy_from_slice(&self.human.output);
        self.decoder.input[latents..].copy_from_slice(&self.robot.output);
        networks.decoder.forward(parameters, &mut self.decoder);
        self.decoder.output.iter_mut().for_each(|y| *y = REACH * y.tanh());
        let positions = &self.decoder.output[..self.cycle.input.len()];
        self.cycle.input.iter_mut().zip(positions).for_each(|(input, n)| *input = n.clamp(-1.0, 1.0));
        networks.robot.forward(parameters, &mut self.cycle);
    }

    /// Returns mean |z - Q_r(D(z))|. Its gradient goes to `grad_human` (through z) and `grad_cycle` (through Q_r).
    fn cycle_term(&mut self, weight: f32) -> f64 {
        let scale = weight / self.grad_cycle.len() as f32;
        let mut sum = 0.0;
        for (i, (z, back)) in self.human.output.iter().zip(&self.cycle.output).enumerate() {
            let difference = z - back;
            sum += f64::from(difference.abs());
            self.grad_human[i] += scale * sign(difference);
            self.grad_cycle[i] = -scale * sign(difference);
        }
        sum / self.grad_cycle.len() as f64
    }

    /// Returns S_GR, angle and overrun of the retargeted poses. Fills the human half of `grad_output`.
    fn human_outputs(&mut self, arm: &Arm, weighting: &Weighting) -> (f64, f64, f64) {
        let (rows, joints) = (self.batch.rows(), self.batch.posture.len());
        let (mut kinematics, mut angle, mut limits) = (0.0, 0.0, 0.0);
        for (index, human) in self.batch.human.iter().enumerate() {
            let at = index * ARM..(index + 1) * ARM;
            let n: [f32; ARM] = std::array::from_fn(|j| self.decoder.output[at.start + j]);
            let q = arm.denormalised(&n.map(|v| v.clamp(-1.0, 1.0)));
            let fit = arm.fit_with_gradient(human, &q, weighting.kinematics, weighting.angle);
            kinematics += f64::from(fit.s_gr);
            angle += f64::from(fit.angle);
            let grads = self.grad_output[at.clone()].iter_mut().zip(&self.grad_cycle_input[at]);
            for (joint, (grad, through_cycle)) in grads.enumerate() {
                let overrun = (n[joint].abs() - 1.0) * arm.half[joint];
                let over_n = if overrun > 0.0 {
                    limits += f64::from(overrun);
                    weighting.limits / joints as f32 * arm.half[joint] * sign(n[joint])
                } else {
                    fit.gradient[joint] / rows as f32 * arm.half[joint] + through_cycle
                };
                *grad = over_n * tanh_slope(n[joint]);
            }
        }
        (kinematics / rows as f64, angle / rows as f64, limits / joints as f64)
    }

    /// Returns mean |q - q'|^2 over the noisy copies of the batch, within the limits. Adds to the human half of
    /// `grad_output`.
    fn steadiness_term(&mut self, arm: &Arm, weight: f32) -> f64 {
        if weight == 0.0 {
            return 0.0;
        }
        let rows = self.batch.rows();
        let noisy_copies = (0..rows).filter(|row| Batch::is_noisy_copy(*row));
        let scale = weight / noisy_copies.clone().count() as f32;
        let mut sum = 0.0;
        for (row, joint) in noisy_copies.flat_map(|row| (0..ARM).map(move |joint| (row, joint))) {
            let at = [(row - 1) * ARM + joint, row * ARM + joint];
            let n = at.map(|i| self.decoder.output[i]);
            let half = arm.half[joint];
            let difference = half * (n[1].clamp(-1.0, 1.0) - n[0].clamp(-1.0, 1.0));
            sum += f64::from(difference * difference);
            for ((at, n), side) in at.into_iter().zip(n).zip([-1.0, 1.0]) {
                if n.abs() <= 1.0 {
                    self.grad_output[at] += side * 2.0 * scale * difference * half * tanh_slope(n);
                }
            }
        }
        sum * f64::from(scale / weight)
    }

    /// Returns mean |x_r - D(Q_r(x_r))| in rad. Fills the robot half of `grad_output`.
    fn robot_outputs(&mut self, arm: &Arm, weight: f32) -> f64 {
        let count = self.batch.posture.len();
        let mut sum = 0.0;
        for (i, want) in self.batch.posture.iter().enumerate() {
            let n = self.decoder.output[count + i];
            let half = arm.half[i % ARM];
            sum += f64::from((n - want).abs() * half);
            self.grad_output[count + i] = weight / count as f32 * half * sign(n - want) * tanh_slope(n);
        }
        sum / count as f64
    }

    /// Returns mean max(|z_a - z_+| - |z_a - z_-| + margin, 0) over triplets of two humans and one robot,
    /// ordered by S_GR to the anchor. Adds to `grad_human` and `grad_robot`.
    fn triplet_term(&mut self, weight: f32) -> f64 {
        if weight == 0.0 {
            return 0.0;
        }
        let rows = self.batch.rows();
        let scale = weight / rows as f32;
        let mut sum = 0.0;
        for row in 0..rows {
            let other = (row + self.batch.shift) % rows;
            // The three members: a human's or a robot's, its row, and its limbs.
            let members = [
                (true, row, &self.batch.human[row]),
                (true, other, &self.batch.human[other]),
                (false, row, &self.batch.robot[row]),
            ];
            let anchor = usize::from(self.batch.anchor[row]);
            let (mut near, mut far) = ((anchor + 1) % 3, (anchor + 2) % 3);
            let apart = |a: usize, b: usize| s_gr(members[a].2, members[b].2);
            if apart(anchor, near) > apart(anchor, far) {
                std::mem::swap(&mut near, &mut far);
            }
            let latent = |member: usize| -> [f32; LATENT] {
                let (is_human, index, _) = members[member];
                let of = if is_human { &self.human.output } else { &self.robot.output };
                std::array::from_fn(|i| of[index * LATENT + i])
            };
            let (to_near, near_distance) = direction(&latent(anchor), &latent(near));
            let (to_far, far_distance) = direction(&latent(anchor), &latent(far));
            let hinge = near_distance - far_distance + MARGIN;
            if hinge <= 0.0 {
                continue;
            }
            sum += f64::from(hinge);
            let mut add = |member: usize, i: usize, value: f32| {
                let (is_human, index, _) = members[member];
                let of = if is_human { &mut self.grad_human } else { &mut self.grad_robot };
                of[index * LATENT + i] += scale * value;
            };
            for i in 0..LATENT {
                add(anchor, i, to_near[i] - to_far[i]);
                add(near, i, -to_near[i]);
                add(far, i, to_far[i]);
            }
        }
        sum / rows as f64
    }
}

/// Returns d(1.02 tanh y)/dy for n = 1.02 tanh y.
#[inline]
fn tanh_slope(n: f32) -> f32 {
    REACH * (1.0 - (n / REACH).powi(2))
}

/// Returns -1, 0 or 1: the subgradient of |x| that is 0 at 0.
#[inline]
fn sign(x: f32) -> f32 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

/// Returns (a - b) / |a - b| and |a - b|. The root is kept away from zero, where it has no slope.
#[inline]
fn direction(a: &[f32; LATENT], b: &[f32; LATENT]) -> ([f32; LATENT], f32) {
    let difference: [f32; LATENT] = std::array::from_fn(|i| a[i] - b[i]);
    let distance = (difference.iter().map(|v| v * v).sum::<f32>() + 1e-12).sqrt();
    (difference.map(|v| v / distance), distance)
}
