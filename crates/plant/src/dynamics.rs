//! Forward dynamics of the tree by the articulated-body algorithm, O(n), without allocation.
//!
//! Featherstone, Rigid Body Dynamics Algorithms (2008), section 7.3. All quantities are in base coordinates about
//! the base's origin, so a body's quantities add to its parent's without a transform. Rotors count as inertia on
//! the diagonal (section 9.6). A braked joint has a prescribed acceleration (hybrid dynamics, section 9.2).
//!
//! An engine of contacts such as rapier's multibodies solves constraints by iteration to about 1e-3. This crate needs
//! 1e-9 within 10 us a step and has no contacts, so the algorithm is written out here.

use crate::description::{Body, Inertia, JointKind};
use crate::kinematics::Frames;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Standard gravity, m/s^2 (CGPM 1901).
pub const GRAVITY_M_PER_S2: f64 = 9.80665;

/// The input that moves a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// A torque or force, N m or N, friction included.
    Torque(f64),
    /// A prescribed acceleration, rad/s^2 or m/s^2: a brake.
    Acceleration(f64),
}

/// The constants of the dynamics of one robot.
#[derive(Clone, Debug)]
pub struct Dynamics {
    /// Number of joints. Arrays are longer.
    count: usize,
    parent: [usize; JOINTS_MAX],
    kind: [JointKind; JOINTS_MAX],
    axis: [Vector3<f64>; JOINTS_MAX],
    inertia: [Inertia; JOINTS_MAX + 1],
    /// Reflected inertia of each joint's rotor, kg m^2 or kg.
    armature: [f64; JOINTS_MAX],
}

/// One posture: axes and inertias in base coordinates.
#[derive(Clone, Debug)]
pub struct Posture {
    /// Unit velocity of each joint: angular part, then the velocity of the point at the base's origin.
    subspace: [Vector6<f64>; JOINTS_MAX],
    inertia: [Inertia; JOINTS_MAX + 1],
}

impl Dynamics {
    /// Creates the dynamics of `body` with rotors of these reflected inertias, kg m^2 or kg.
    pub fn new(body: &Body, armature: [f64; JOINTS_MAX]) -> Self {
        Self {
            count: body.joints.len(),
            parent: std::array::from_fn(|j| body.joints.get(j).map_or(0, |joint| joint.parent)),
            kind: std::array::from_fn(|j| body.joints.get(j).map_or(JointKind::Revolute, |joint| joint.kind)),
            axis: std::array::from_fn(|j| body.joints.get(j).map_or_else(Vector3::zeros, |joint| joint.axis)),
            inertia: body.inertias,
            armature,
        }
    }

    /// Returns the posture whose bodies stand at `frames`.
    pub fn at(&self, frames: &Frames) -> Posture {
        let subspace = std::array::from_fn(|j| {
            let pose = &frames.base_from_body[j + 1];
            let axis = pose.r * self.axis[j];
            match self.kind[j] {
                JointKind::Revolute => spatial_vector(&axis, &pose.t.cross(&axis)),
                JointKind::Prismatic => spatial_vector(&Vector3::zeros(), &axis),
            }
        });
        // The base stands still, so its inertia stays zero.
        let mut inertia = [Inertia::default(); JOINTS_MAX + 1];
        for ((out, own), pose) in inertia.iter_mut().zip(&self.inertia).zip(&frames.base_from_body).skip(1) {
            let (t, moment) = (pose.t, pose.r * own.moment);
            let cross = t * moment.transpose();
            let shift = Matrix3::from_diagonal_element(2.0 * t.dot(&moment) + own.mass_kg * t.norm_squared())
                - cross
                - cross.transpose()
                - t * t.transpose() * own.mass_kg;
            *out = Inertia {
                mass_kg: own.mass_kg,
                moment: moment + t * own.mass_kg,
                about_origin: pose.r * own.about_origin * pose.r.transpose() + shift,
            };
        }
        Posture { subspace, inertia }
    }

    /// Returns the torques (N m, N) that hold the posture against gravity, and the diagonal of the mass matrix
    /// with rotors (kg m^2, kg).
    pub fn gravity_and_diagonal(&self, posture: &Posture) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
        let mut composite = posture.inertia;
        let (mut gravity, mut diagonal) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        for j in (0..self.count).rev() {
            let carried = composite[j + 1];
            let (w, v) = split(&posture.subspace[j]);
            // S . I a with the acceleration a = (0, g) of a base that holds against gravity.
            let lift = Vector3::new(0.0, 0.0, GRAVITY_M_PER_S2);
            gravity[j] = w.dot(&carried.moment.cross(&lift)) + v.dot(&lift) * carried.mass_kg;
            let momentum =
                (carried.about_origin * w + carried.moment.cross(&v), v * carried.mass_kg - carried.moment.cross(&w));
            diagonal[j] = w.dot(&momentum.0) + v.dot(&momentum.1) + self.armature[j];
            composite[self.parent[j]].add(&carried);
        }
        (gravity, diagonal)
    }

    /// Returns the mass matrix of the links alone, kg m^2, kg m or kg, by composite bodies (section 6.2):
    /// M_jk = S_k . (inertia of all that j carries) S_j for k at or above j.
    pub fn mass_matrix(&self, posture: &Posture) -> [[f64; JOINTS_MAX]; JOINTS_MAX] {
        let mut composite = posture.inertia;
        let mut matrix = [[0.0; JOINTS_MAX]; JOINTS_MAX];
        for j in (0..self.count).rev() {
            let carried = composite[j + 1];
            let force = spatial_inertia(&carried) * posture.subspace[j];
            let mut body = j + 1;
            while body > 0 {
                let k = body - 1;
                matrix[j][k] = posture.subspace[k].dot(&force);
                matrix[k][j] = matrix[j][k];
                body = self.parent[k];
            }
            composite[self.parent[j]].add(&carried);
        }
        matrix
    }

    /// Returns the accelerations of all joints (rad/s^2, m/s^2) at the joint speeds `v` with these drives.
    pub fn accelerations(
        &self,
        posture: &Posture,
        v: &[f64; JOINTS_MAX],
        drives: &[Drive; JOINTS_MAX],
    ) -> [f64; JOINTS_MAX] {
        let mut velocity = [Vector6::zeros(); JOINTS_MAX + 1];
        let mut coriolis = [Vector6::zeros(); JOINTS_MAX];
        let mut articulated = [Matrix6::zeros(); JOINTS_MAX + 1];
        let mut bias = [Vector6::zeros(); JOINTS_MAX + 1];
        for j in 0..self.count {
            let moved = posture.subspace[j] * v[j];
            velocity[j + 1] = velocity[self.parent[j]] + moved;
            coriolis[j] = cross_motion(&velocity[j + 1], &moved);
            articulated[j + 1] = spatial_inertia(&posture.inertia[j + 1]);
            let momentum = articulated[j + 1] * velocity[j + 1];
            bias[j + 1] = cross_force(&velocity[j + 1], &momentum);
        }
        // For each joint: I_A S, S . I_A S, and the torque that is left for it.
        let mut felt = [Vector6::zeros(); JOINTS_MAX];
        let (mut inertia, mut rest) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        for j in (0..self.count).rev() {
            let (s, ia, p) = (&posture.subspace[j], articulated[j + 1], bias[j + 1]);
            let (to_parent, push) = match drives[j] {
                Drive::Torque(torque) => {
                    felt[j] = ia * s;
                    inertia[j] = s.dot(&felt[j]) + self.armature[j];
                    rest[j] = torque - s.dot(&p);
                    let scaled = felt[j] / inertia[j];
                    let reduced = ia - scaled * felt[j].transpose();
                    (reduced, p + reduced * coriolis[j] + scaled * rest[j])
                }
                Drive::Acceleration(a) => (ia, p + ia * (coriolis[j] + s * a)),
            };
            articulated[self.parent[j]] += to_parent;
            bias[self.parent[j]] += push;
        }
        let mut acceleration = [Vector6::zeros(); JOINTS_MAX + 1];
        acceleration[0][5] = GRAVITY_M_PER_S2;
        let mut result = [0.0; JOINTS_MAX];
        for j in 0..self.count {
            let carried = acceleration[self.parent[j]] + coriolis[j];
            result[j] = match drives[j] {
                Drive::Torque(_) => (rest[j] - felt[j].dot(&carried)) / inertia[j],
                Drive::Acceleration(a) => a,
            };
            acceleration[j + 1] = carried + posture.subspace[j] * result[j];
        }
        result
    }

    /// Returns the torques (N m, N) of the links alone, without rotors and friction, in the motion with these joint
    /// speeds and accelerations (rad/s, rad/s^2; m/s, m/s^2). It is the recursion of Newton and Euler, section 5.3.
    pub fn torques(&self, posture: &Posture, v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut velocity = [Vector6::zeros(); JOINTS_MAX + 1];
        let mut acceleration = [Vector6::zeros(); JOINTS_MAX + 1];
        let mut force = [Vector6::zeros(); JOINTS_MAX + 1];
        acceleration[0][5] = GRAVITY_M_PER_S2;
        for j in 0..self.count {
            let (s, parent) = (&posture.subspace[j], self.parent[j]);
            velocity[j + 1] = velocity[parent] + s * v[j];
            acceleration[j + 1] = acceleration[parent] + s * a[j] + cross_motion(&velocity[j + 1], &(s * v[j]));
            let inertia = spatial_inertia(&posture.inertia[j + 1]);
            force[j + 1] = inertia * acceleration[j + 1] + cross_force(&velocity[j + 1], &(inertia * velocity[j + 1]));
        }
        let mut torques = [0.0; JOINTS_MAX];
        for j in (0..self.count).rev() {
            torques[j] = posture.subspace[j].dot(&force[j + 1]);
            let passed = force[j + 1];
            force[self.parent[j]] += passed;
        }
        torques
    }
}

fn spatial_vector(angular: &Vector3<f64>, linear: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(angular.x, angular.y, angular.z, linear.x, linear.y, linear.z)
}

fn split(x: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]))
}

/// Returns the spatial inertia [J, h x; (h x)^T, m 1] about the base's origin.
fn spatial_inertia(inertia: &Inertia) -> Matrix6<f64> {
    let (j, h, m) = (&inertia.about_origin, &inertia.moment, inertia.mass_kg);
    let mut out = Matrix6::zeros();
    for row in 0..3 {
        for column in 0..3 {
            out[(row, column)] = j[(row, column)];
        }
        out[(row + 3, row + 3)] = m;
    }
    let [x, y, z] = [h.x, h.y, h.z];
    for (row, column, value) in [(0, 4, -z), (0, 5, y), (1, 3, z), (1, 5, -x), (2, 3, -y), (2, 4, x)] {
        (out[(row, column)], out[(column, row)]) = (value, value);
    }
    out
}

/// Returns v x m for motions: (w x m_w, w x m_v + v x m_w).
fn cross_motion(v: &Vector6<f64>, m: &Vector6<f64>) -> Vector6<f64> {
    let ((w, v), (mw, mv)) = (split(v), split(m));
    spatial_vector(&w.cross(&mw), &(w.cross(&mv) + v.cross(&mw)))
}

/// Returns v x* f for forces: (w x n + v x f, w x f).
fn cross_force(v: &Vector6<f64>, f: &Vector6<f64>) -> Vector6<f64> {
    let ((w, v), (n, f)) = (split(v), split(f));
    spatial_vector(&(w.cross(&n) + v.cross(&f)), &w.cross(&f))
}
