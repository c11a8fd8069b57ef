//! Levenberg-Marquardt on the limb residual. It takes few steps, has a fixed size, and the result is never worse
//! than the start.

use crate::arm::{ARM_Q, ArmModel, ArmQ};
use crate::kinematic_chain::KinematicChain;
use nalgebra::Vector3;
use robot::Limbs;

/// Weight of |q - prior|^2 beside S_GR, 1/rad^2. It keeps noise near the gimbal from becoming joint motion. Half a
/// degree of noise there moves TIAGo++'s joints by 1.89 degrees RMS. With 2e-3 it is 1.70, which costs 0.02 degrees
/// of limb error everywhere.
pub const PRIOR_WEIGHT: f64 = 1e-3;
/// Longest step in any joint, rad. A linearisation is not accurate further away.
pub const STEP_MAX_RAD: f64 = 1.0;
/// Damping at the first step. With the prior the normal matrix never falls below 2e-3, so the first step may be
/// nearly Gauss-Newton.
const DAMPING_START: f64 = 1e-4;
/// Smallest damping. Without a prior the matrix is singular at the gimbal.
const DAMPING_MIN: f64 = 1e-9;
/// Factors after an accepted and after a refused step (Marquardt 1963).
const DAMPING_DOWN: f64 = 0.1;
const DAMPING_UP: f64 = 10.0;
/// A joint this close to its limit counts as being at it, rad.
const AT_LIMIT_RAD: f64 = 1e-9;

/// Result of a refinement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Joint positions within the limits, rad.
    pub q: ArmQ,
    /// S_GR there.
    pub s_gr: f64,
    /// Objective there: S_GR + weight |q - prior|^2.
    pub objective: f64,
    /// Steps that were accepted.
    pub accepted: u32,
}

/// A quadratic cost of the hand's distance from a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pull<'a> {
    /// Kinematic chain of the arm.
    pub(crate) chain: &'a KinematicChain,
    /// The place in the torso frame, from the middle between the shoulders, m.
    pub(crate) to: Vector3<f64>,
    /// Weight of |hand - to|^2 beside S_GR, 1/m^2.
    pub(crate) weight: f64,
}

/// Takes at most `steps` Levenberg-Marquardt steps from `start`, which is clamped into the limits. The objective
/// is S_GR(q, human) + prior_weight |q - prior|^2 within the limits. It never rises. Allocates nothing.
pub fn refine(arm: &ArmModel, human: &Limbs, start: &ArmQ, prior: &ArmQ, prior_weight: f64, steps: u32) -> Refined {
    Objective { arm, human, prior, prior_weight, pull: None }.descend(start, steps)
}

/// The objective of a refinement. It is that of [`refine`], and that of the pull.
pub(crate) struct Objective<'a> {
    pub(crate) arm: &'a ArmModel,
    pub(crate) human: &'a Limbs,
    pub(crate) prior: &'a ArmQ,
    pub(crate) prior_weight: f64,
    pub(crate) pull: Option<Pull<'a>>,
}

impl Objective<'_> {
    /// See [`refine`].
    pub(crate) fn descend(&self, start: &ArmQ, steps: u32) -> Refined {
        let arm = self.arm;
        let q = arm.clamp(start);
        let mut best = self.evaluate(q);
        let mut damping = DAMPING_START;
        let mut normal = None;
        for _ in 0..steps {
            let (h, g) = *normal.get_or_insert_with(|| self.normal_equations(&best.q));
            let Some(step) = box_step(arm, &best.q, &h, &g, damping) else {
                break;
            };
            let candidate = self.evaluate(step);
            if candidate.objective < best.objective {
                best = Refined { accepted: best.accepted + 1, ..candidate };
                normal = None;
                damping = (damping * DAMPING_DOWN).max(DAMPING_MIN);
            } else {
                damping *= DAMPING_UP;
            }
        }
        best
    }

    fn evaluate(&self, q: ArmQ) -> Refined {
        let s_gr = self.arm.s_gr(&q, self.human);
        let pulled =
            self.pull.map_or(0.0, |pull| pull.weight * (pull.chain.hand_center(self.arm, &q) - pull.to).norm_squared());
        let objective = s_gr + self.prior_weight * distance(&q, self.prior) + pulled;
        Refined { q, s_gr, objective, accepted: 0 }
    }

    /// H = J^T J + weight I and g = J^T r + weight (q - prior): half the Gauss-Newton Hessian and half the gradient.
    fn normal_equations(&self, q: &ArmQ) -> (Matrix, ArmQ) {
        let at = self.arm.linearize(q, self.human);
        let mut h = [[0.0; ARM_Q]; ARM_Q];
        let mut g = [0.0; ARM_Q];
        add(&mut h, &mut g, &at.jacobian, &at.residual, 1.0);
        if let Some(pull) = &self.pull {
            let (hand, columns) = pull.chain.linearize(self.arm, q);
            add(&mut h, &mut g, &columns, &(hand - pull.to).into(), pull.weight);
        }
        for j in 0..ARM_Q {
            h[j][j] += self.prior_weight;
            g[j] += self.prior_weight * (q[j] - self.prior[j]);
        }
        (h, g)
    }
}

/// Returns |a - b|^2, rad^2.
pub(crate) fn distance(a: &ArmQ, b: &ArmQ) -> f64 {
    (0..ARM_Q).map(|j| (a[j] - b[j]) * (a[j] - b[j])).sum()
}

type Matrix = [[f64; ARM_Q]; ARM_Q];

/// Adds weight J^T J to `h` and weight J^T r to `g`.
fn add<const N: usize>(h: &mut Matrix, g: &mut ArmQ, jacobian: &[[f64; N]; ARM_Q], residual: &[f64; N], weight: f64) {
    let dot = |a: &[f64; N], b: &[f64; N]| weight * (0..N).map(|i| a[i] * b[i]).sum::<f64>();
    for i in 0..ARM_Q {
        for j in 0..ARM_Q {
            h[i][j] += dot(&jacobian[i], &jacobian[j]);
        }
        g[i] += dot(&jacobian[i], residual);
    }
}

/// Returns the posture after one damped step within the limits. A joint is fixed at its limit if it is there and
/// pushed against it, or if the step would carry it over. The others are then solved again, at most once per
/// joint. `None` if the matrix is not positive definite, or not finite.
fn box_step(arm: &ArmModel, q: &ArmQ, h: &Matrix, g: &ArmQ, damping: f64) -> Option<ArmQ> {
    let mut fixed: [Option<f64>; ARM_Q] = std::array::from_fn(|j| {
        let below = q[j] <= arm.q_min[j] + AT_LIMIT_RAD && g[j] > 0.0;
        let above = q[j] >= arm.q_max[j] - AT_LIMIT_RAD && g[j] < 0.0;
        (below || above).then_some(0.0)
    });
    let mut step = [0.0; ARM_Q];
    for _ in 0..=ARM_Q {
        step = solve(h, g, damping, &fixed)?;
        let longest = step.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
        if longest > STEP_MAX_RAD {
            step = step.map(|d| d * (STEP_MAX_RAD / longest));
        }
        let mut over = false;
        for j in 0..ARM_Q {
            let to = (q[j] + step[j]).max(arm.q_min[j]).min(arm.q_max[j]);
            if fixed[j].is_none() && to != q[j] + step[j] {
                fixed[j] = Some(to - q[j]);
                over = true;
            }
        }
        if !over {
            break;
        }
    }
    let next = arm.clamp(&std::array::from_fn(|j| q[j] + step[j]));
    next.iter().all(|x| x.is_finite()).then_some(next)
}

/// Minimises d^T (H + damping I) d / 2 + g^T d with the fixed components of d given. It uses Cholesky with the
/// fixed rows replaced by the identity.
#[expect(clippy::needless_range_loop, reason = "a matrix is clearer by its indices")]
fn solve(h: &Matrix, g: &ArmQ, damping: f64, fixed: &[Option<f64>; ARM_Q]) -> Option<ArmQ> {
    let mut l = *h;
    let mut x: ArmQ = std::array::from_fn(|j| -g[j]);
    for j in 0..ARM_Q {
        l[j][j] += damping;
    }
    for (j, value) in fixed.iter().enumerate() {
        let Some(value) = *value else { continue };
        for i in 0..ARM_Q {
            if fixed[i].is_none() {
                x[i] -= h[i][j] * value;
            }
            l[i][j] = 0.0;
            l[j][i] = 0.0;
        }
        l[j][j] = 1.0;
        x[j] = value;
    }
    for j in 0..ARM_Q {
        for k in 0..j {
            l[j][j] -= l[j][k] * l[j][k];
        }
        if l[j][j].is_nan() || l[j][j] <= 0.0 {
            return None;
        }
        l[j][j] = l[j][j].sqrt();
        for i in j + 1..ARM_Q {
            for k in 0..j {
                l[i][j] -= l[i][k] * l[j][k];
            }
            l[i][j] /= l[j][j];
        }
    }
    for i in 0..ARM_Q {
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
        x[i] /= l[i][i];
    }
    for i in (0..ARM_Q).rev() {
        for k in i + 1..ARM_Q {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    Some(x)
}
