//! Inverse dynamics of the joints by the recursive Newton-Euler algorithm.
//!
//! It uses spatial vectors (Featherstone 2008, chapter 5) in the fixed base frame about its origin. So nothing
//! is transformed along the tree. Let S_i be the motion vector of joint i, v_i and a_i spatial velocity and
//! acceleration of body i, and I_i its spatial inertia:
//!
//! v_i = v_parent + S_i qd_i, a_i = a_parent + S_i qdd_i + v_i x S_i qd_i, a_base = (0, -g),
//! f_i = I_i a_i + v_i x* I_i v_i + sum of f of the bodies that hang on i, tau_i = S_i . f_i.

use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use robot::{Frames, Inertia, Model, Pose};

/// Standard gravity, m/s^2 (3rd General Conference on Weights and Measures, 1901).
pub const GRAVITY_M_PER_S2: f64 = 9.806_65;
/// One value for each joint: rad or m, or N m or N, in the fixed joint order.
pub type PerJoint = [f64; JOINTS_MAX];
/// Mass matrix of the joint space, kg m^2, kg m or kg.
pub type MassMatrix = [[f64; JOINTS_MAX]; JOINTS_MAX];

/// Motion (angular, linear) or force (moment, force) vector about the origin.
#[derive(Clone, Copy, Debug, Default)]
struct Spatial {
    angular: Vector3<f64>,
    linear: Vector3<f64>,
}

impl Spatial {
    fn plus(&self, other: &Self, times: f64) -> Self {
        Self { angular: self.angular + other.angular * times, linear: self.linear + other.linear * times }
    }

    fn dot(&self, other: &Self) -> f64 {
        self.angular.dot(&other.angular) + self.linear.dot(&other.linear)
    }

    /// Returns the rate of a motion vector that moves along with this motion.
    fn cross_motion(&self, m: &Self) -> Self {
        let linear = self.angular.cross(&m.linear) + self.linear.cross(&m.angular);
        Self { angular: self.angular.cross(&m.angular), linear }
    }

    /// Returns the rate of a force vector that moves along with this motion.
    fn cross_force(&self, f: &Self) -> Self {
        let angular = self.angular.cross(&f.angular) + self.linear.cross(&f.linear);
        Self { angular, linear: self.angular.cross(&f.linear) }
    }
}

/// Spatial inertia about the origin: mass, mass times centre, inertia about the origin.
#[derive(Clone, Copy, Debug, Default)]
struct SpatialInertia {
    mass: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl SpatialInertia {
    fn new(body: &Inertia, pose: &Pose) -> Self {
        let about_center = pose.r * body.about_center * pose.r.transpose();
        let placed = Inertia { center: pose.transform_point(&body.center), about_center, ..*body };
        let first = placed.center * placed.mass_kg;
        Self { mass: placed.mass_kg, first, second: placed.about(&Vector3::zeros()) }
    }

    fn times(&self, m: &Spatial) -> Spatial {
        Spatial {
            angular: self.second * m.angular + self.first.cross(&m.linear),
            linear: m.linear * self.mass - self.first.cross(&m.angular),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Dynamics<'a> {
    model: &'a Model,
    bodies: [Inertia; JOINTS_MAX + 1],
    /// Parent body of the body of each joint, and the joint's axis in its own body's frame.
    joints: Vec<(usize, Vector3<f64>)>,
}

impl<'a> Dynamics<'a> {
    /// Takes the masses of the robot's bodies, and of loads that bodies carry. Joints that nothing commands are where the
    /// robot file holds them.
    pub fn new(model: &'a Model, loads: impl IntoIterator<Item = (usize, Inertia)>) -> Self {
        let mut bodies = model.inertias();
        loads.into_iter().for_each(|(body, load)| bodies[body] = bodies[body].combined(&load));
        let joint = |j: usize| (model.parent_body(j + 1).unwrap_or(0), model.joint_at_zero(j).1);
        Self { model, bodies, joints: (0..model.count).map(joint).collect() }
    }

    pub fn at(&self, q: &PerJoint) -> Posture<'_> {
        let mut frames = Frames::default();
        self.model.forward(q, &mut frames);
        let axes = std::array::from_fn(|j| {
            let pose = &frames.base_from_body[j + 1];
            let axis = self.joints.get(j).map_or_else(Vector3::zeros, |joint| pose.r * joint.1);
            if self.model.prismatic[j] {
                Spatial { angular: Vector3::zeros(), linear: axis }
            } else {
                Spatial { angular: axis, linear: pose.t.cross(&axis) }
            }
        });
        let inertias = std::array::from_fn(|b| SpatialInertia::new(&self.bodies[b], &frames.base_from_body[b]));
        Posture { joints: &self.joints, axes, inertias }
    }
}

#[derive(Clone, Debug)]
pub struct Posture<'a> {
    joints: &'a [(usize, Vector3<f64>)],
    axes: [Spatial; JOINTS_MAX],
    inertias: [SpatialInertia; JOINTS_MAX + 1],
}

impl Posture<'_> {
    /// Returns the torques (N m) and forces (N) for the joint velocities `v` and accelerations `a`. Gravity is
    /// in m/s^2, down.
    pub fn torques(&self, v: &PerJoint, a: &PerJoint, gravity: f64) -> PerJoint {
        let mut velocity = [Spatial::default(); JOINTS_MAX + 1];
        let mut acceleration = [Spatial::default(); JOINTS_MAX + 1];
        // A base that accelerates upwards is equivalent to a base at rest under gravity.
        acceleration[0].linear.z = gravity;
        let mut force = [Spatial::default(); JOINTS_MAX + 1];
        for j in 0..self.joints.len() {
            let (parent, axis) = (self.joints[j].0, &self.axes[j]);
            velocity[j + 1] = velocity[parent].plus(axis, v[j]);
            let carried = velocity[j + 1].cross_motion(axis);
            acceleration[j + 1] = acceleration[parent].plus(axis, a[j]).plus(&carried, v[j]);
            let inertia = &self.inertias[j + 1];
            let momentum = inertia.times(&velocity[j + 1]);
            force[j + 1] = inertia.times(&acceleration[j + 1]).plus(&velocity[j + 1].cross_force(&momentum), 1.0);
        }
        let mut torques = [0.0; JOINTS_MAX];
        for j in (0..self.joints.len()).rev() {
            torques[j] = self.axes[j].dot(&force[j + 1]);
            let parent = self.joints[j].0;
            force[parent] = force[parent].plus(&force[j + 1], 1.0);
        }
        torques
    }

    /// Returns the mass matrix by composite bodies: M_jk = S_k . (inertia of all that j carries) S_j for k at
    /// or above j.
    pub fn mass_matrix(&self) -> MassMatrix {
        let mut composite = self.inertias;
        let mut matrix = [[0.0; JOINTS_MAX]; JOINTS_MAX];
        for j in (0..self.joints.len()).rev() {
            let force = composite[j + 1].times(&self.axes[j]);
            let mut body = j + 1;
            while body > 0 {
                let k = body - 1;
                matrix[j][k] = self.axes[k].dot(&force);
                matrix[k][j] = matrix[j][k];
                body = self.joints[k].0;
            }
            let (parent, own) = (self.joints[j].0, composite[j + 1]);
            composite[parent].mass += own.mass;
            composite[parent].first += own.first;
            composite[parent].second += own.second;
        }
        matrix
    }
}
