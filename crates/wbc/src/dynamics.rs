//! Inverse dynamics of any subset of the tree by the recursive Newton-Euler algorithm, and the mass matrix.
//!
//! Source: Featherstone, Rigid Body Dynamics Algorithms (2008), sections 5.3 and 6.2. A body's quantities are
//! in its own frame and about its own origin. R is the rotation from a joint's body to its parent's, r its
//! origin there, and z its axis:
//!
//! ```text
//! w = R^T w_p + z v,   w' = R^T w'_p + z a + w x z v,   x'' = R^T (x''_p + w'_p x r + w_p x (w_p x r))     [turns]
//! w = R^T w_p,         w' = R^T w'_p,                   x'' = the same + z a + 2 w x z v                  [slides]
//! f = m x'' + w' x h + w x (w x h),   n = I w' + w x I w + h x x'',   h = m c
//! ```
//!
//! The base accelerates upwards by g, which represents gravity. A joint's torque is the moment (or force)
//! along its axis of all bodies that it carries.

use crate::chain::{BODIES, JointSet, KinematicChain, Placements, Turned, TurnedJoints, joints};
use crate::plan::JointState;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use robot::Payload;

/// Standard gravity, m/s^2 (3rd General Conference on Weights and Measures, 1901).
pub const GRAVITY_M_PER_S2: f64 = 9.806_65;

/// One number per joint.
pub type PerJoint = [f64; JOINTS_MAX];

/// Mass of everything that moves with one joint, in that joint's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mass {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, m.
    pub center: Vector3<f64>,
    /// Inertia about the centre of mass, kg m^2.
    pub about_center: Matrix3<f64>,
}

/// Mass, first moment and inertia about the body's origin.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    mass: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

/// The masses of a tree.
#[derive(Clone, Debug)]
pub(crate) struct Dynamics {
    bodies: [Moments; BODIES],
    /// The bodies of the left and the right hand.
    hands: [usize; 2],
    /// Moments of the hands without their payload.
    empty: [Moments; 2],
}

/// Motion of a body and the force on it.
#[derive(Clone, Copy, Debug, Default)]
struct Carried {
    w: Vector3<f64>,
    dw: Vector3<f64>,
    ddx: Vector3<f64>,
    f: Vector3<f64>,
    n: Vector3<f64>,
}

fn point_inertia(mass: f64, r: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass
}

impl Dynamics {
    pub(crate) fn new(chain: &KinematicChain, masses: &[Mass; BODIES]) -> Self {
        let moments = |m: &Mass| Moments {
            mass: m.mass_kg,
            first: m.center * m.mass_kg,
            second: m.about_center + point_inertia(m.mass_kg, &m.center),
        };
        let bodies = masses.each_ref().map(moments);
        let hands = chain.hands();
        Self { bodies, hands, empty: hands.map(|hand| bodies[hand]) }
    }

    /// Sets the payload of the hands. Never allocates.
    pub(crate) fn carry(&mut self, payload: &[Payload; 2]) {
        for ((hand, empty), Payload { mass_kg, center }) in self.hands.into_iter().zip(&self.empty).zip(payload) {
            self.bodies[hand] = Moments {
                mass: empty.mass + mass_kg,
                first: empty.first + center * *mass_kg,
                second: empty.second + point_inertia(*mass_kg, center),
            };
        }
    }

    /// Torques (N m, N) of the joints of `set` in the motion `x` through the posture `turned`. For each joint whose
    /// torque is needed, `set` must contain its ancestors and everything that hangs on it. Other entries stay as they are.
    pub(crate) fn torques(
        &self,
        chain: &KinematicChain,
        turned: &TurnedJoints,
        x: &[JointState; JOINTS_MAX],
        set: JointSet,
        out: &mut PerJoint,
    ) {
        let mut carried = [Carried::default(); BODIES];
        carried[0].ddx.z = GRAVITY_M_PER_S2;
        for j in joints(set) {
            let link = &chain.links()[j];
            let Turned { r, t } = &turned[j];
            let above = &carried[link.parent];
            let rt = r.transpose();
            let w_above = rt * above.w;
            let ddx = rt * (above.ddx + above.dw.cross(t) + above.w.cross(&above.w.cross(t)));
            let (spin, push) = (link.axis * x[j].v, link.axis * x[j].a);
            let (w, dw, ddx) = if link.prismatic {
                (w_above, rt * above.dw, ddx + push + w_above.cross(&spin) * 2.0)
            } else {
                (w_above + spin, rt * above.dw + push + w_above.cross(&spin), ddx)
            };
            let body = &self.bodies[j + 1];
            let f = ddx * body.mass + dw.cross(&body.first) + w.cross(&w.cross(&body.first));
            let n = body.second * dw + w.cross(&(body.second * w)) + body.first.cross(&ddx);
            carried[j + 1] = Carried { w, dw, ddx, f, n };
        }
        pass_down(chain, turned, set, &mut carried, out);
    }

    /// The same at rest, where only gravity is left of each sum.
    pub(crate) fn torques_at_rest(
        &self,
        chain: &KinematicChain,
        turned: &TurnedJoints,
        set: JointSet,
        out: &mut PerJoint,
    ) {
        let mut carried = [Carried::default(); BODIES];
        carried[0].ddx.z = GRAVITY_M_PER_S2;
        for j in joints(set) {
            let ddx = turned[j].r.tr_mul(&carried[chain.links()[j].parent].ddx);
            let body = &self.bodies[j + 1];
            let own = &mut carried[j + 1];
            (own.ddx, own.f, own.n) = (ddx, ddx * body.mass, body.first.cross(&ddx));
        }
        pass_down(chain, turned, set, &mut carried, out);
    }

    /// The mass matrix (kg m^2, kg m, kg) of the joints of `set` at `places`, by composite bodies in the base
    /// frame. Other entries are zero. `set` must contain everything that hangs on each of its joints.
    pub(crate) fn mass_matrix(
        &self,
        chain: &KinematicChain,
        places: &Placements,
        set: JointSet,
    ) -> [PerJoint; JOINTS_MAX] {
        let mut composite = [Moments::default(); BODIES];
        let mut matrix = [[0.0; JOINTS_MAX]; JOINTS_MAX];
        let mut left = set;
        while left != 0 {
            let j = (JointSet::BITS - 1 - left.leading_zeros()) as usize;
            left &= !(1 << j);
            let (place, own) = (&places[j + 1], &self.bodies[j + 1]);
            let t = place.t;
            let first = place.r * own.first;
            // The inertia about the base's origin is I + 2 (t.h) - h t^T - t h^T + m (t.t - t t^T), with h
            // about the body's own origin.
            let mixed = t * first.transpose();
            let second = place.r * own.second * place.r.transpose()
                + Matrix3::from_diagonal_element(2.0 * t.dot(&first))
                - mixed
                - mixed.transpose()
                + point_inertia(own.mass, &t);
            let all = &mut composite[j + 1];
            all.mass += own.mass;
            all.first += first + t * own.mass;
            all.second += second;
            let all = *all;
            let (w, v) = unit_motion(chain, places, j);
            let moment = all.second * w + all.first.cross(&v);
            let force = v * all.mass - all.first.cross(&w);
            for k in joints(chain.ancestors(j + 1) & set) {
                let (w, v) = unit_motion(chain, places, k);
                matrix[j][k] = w.dot(&moment) + v.dot(&force);
                matrix[k][j] = matrix[j][k];
            }
            let parent = &mut composite[chain.links()[j].parent];
            parent.mass += all.mass;
            parent.first += all.first;
            parent.second += all.second;
        }
        matrix
    }
}

/// Sums the forces from the tips to the base, and takes each joint's part along its axis.
fn pass_down(
    chain: &KinematicChain,
    turned: &TurnedJoints,
    set: JointSet,
    carried: &mut [Carried; BODIES],
    out: &mut PerJoint,
) {
    let mut left = set;
    while left != 0 {
        let j = (JointSet::BITS - 1 - left.leading_zeros()) as usize;
        left &= !(1 << j);
        let link = &chain.links()[j];
        let Carried { f, n, .. } = carried[j + 1];
        out[j] = link.axis.dot(if link.prismatic { &f } else { &n });
        let Turned { r, t } = &turned[j];
        let f = r * f;
        let above = &mut carried[link.parent];
        above.n += r * n + t.cross(&f);
        above.f += f;
    }
}

/// Angular velocity, and velocity of the point at the base's origin, per unit speed of joint `j`.
fn unit_motion(chain: &KinematicChain, places: &Placements, j: usize) -> (Vector3<f64>, Vector3<f64>) {
    let (link, place) = (&chain.links()[j], &places[j + 1]);
    let axis = place.r * link.axis;
    if link.prismatic { (Vector3::zeros(), axis) } else { (axis, place.t.cross(&axis)) }
}
