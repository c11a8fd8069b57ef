//! Inverse dynamics of the joints by the recursive Newton-Euler algorithm.
//!
//! It uses spatial vectors (Featherstone 2008, chapter 5) in the fixed base frame about its origin. So nothing
//! is transformed along the tree. Let S_i be the motion vector of joint i, v_i and a_i spatial velocity and
//! acceleration of body i, and I_i its spatial inertia:
//!
//! v_i = v_parent + S_i qd_i, a_i = a_parent + S_i qdd_i + v_i x S_i qd_i, a_base = (0, -g),
//! f_i = I_i a_i + v_i x* I_i v_i + sum of f of the bodies that hang on i, tau_i = S_i . f_i.

use crate::error::CollisionError;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use robot::{Frames, Model, Pose};

/// Standard gravity, m/s^2 (3rd General Conference on Weights and Measures, 1901).
pub const GRAVITY_M_PER_S2: f64 = 9.806_65;
/// Upper bound on the mass of a link, kg. No link of a suitable robot is heavier.
const MASS_MAX_KG: f64 = 500.0;

/// One value for each joint: rad or m, or N m or N, in the fixed joint order.
pub type PerJoint = [f64; JOINTS_MAX];
/// Mass matrix of the joint space, kg m^2, kg m or kg.
pub type MassMatrix = [[f64; JOINTS_MAX]; JOINTS_MAX];

/// Mass that moves with one joint.
#[derive(Clone, Copy, Debug, Default)]
struct Lump {
    mass_kg: f64,
    /// Centre of mass in the body's frame, m.
    center: Vector3<f64>,
    /// Inertia about the centre of mass in the body's frame, kg m^2.
    inertia: Matrix3<f64>,
}

impl Lump {
    /// Joins both into one rigid body: centres by mass, inertias by the parallel axis theorem.
    fn combined(&self, other: &Self) -> Self {
        let mass_kg = self.mass_kg + other.mass_kg;
        if mass_kg <= 0.0 {
            return Self { inertia: self.inertia + other.inertia, ..*self };
        }
        let center = (self.center * self.mass_kg + other.center * other.mass_kg) / mass_kg;
        let about = |lump: &Self| lump.inertia + point_inertia(lump.mass_kg, &(lump.center - center));
        Self { mass_kg, center, inertia: about(self) + about(other) }
    }
}

/// Returns m (r.r 1 - r r'): the inertia of a point mass about the origin, kg m^2.
fn point_inertia(mass_kg: f64, r: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass_kg
}

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
struct Inertia {
    mass: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl Inertia {
    fn new(lump: &Lump, pose: &Pose) -> Self {
        let center = pose.transform_point(&lump.center);
        let second = pose.r * lump.inertia * pose.r.transpose() + point_inertia(lump.mass_kg, &center);
        Self { mass: lump.mass_kg, first: center * lump.mass_kg, second }
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
    lumps: [Lump; JOINTS_MAX + 1],
    /// Parent body of the body of each joint, and the joint's axis in its own body's frame.
    joints: Vec<(usize, Vector3<f64>)>,
}

#[derive(Clone, Debug)]
pub struct Payload {
    pub link: String,
    /// Where the mass is in the link's frame, m.
    pub center: Vector3<f64>,
    pub mass_kg: f64,
}

impl<'a> Dynamics<'a> {
    /// Lumps the inertials of all links of `urdf` onto the model's bodies. Joints that nothing commands are where
    /// the robot file holds them.
    pub fn new(model: &'a Model, urdf: &urdf_rs::Robot, payloads: &[Payload]) -> Result<Self, CollisionError> {
        let wrong = |cause: String| CollisionError::content(&urdf.name, cause);
        let mut lumps = [Lump::default(); JOINTS_MAX + 1];
        let mut add = |link: &str, lump: Lump| {
            let (body, pose) = model.link_body(link).ok_or_else(|| wrong(format!("the model has no link `{link}`")))?;
            let center = pose.transform_point(&lump.center);
            let placed = Lump { center, inertia: pose.r * lump.inertia * pose.r.transpose(), ..lump };
            lumps[body] = lumps[body].combined(&placed);
            Ok::<(), CollisionError>(())
        };
        for link in &urdf.links {
            let (inertial, i) = (&link.inertial, &link.inertial.inertia);
            let mass_kg = inertial.mass.value;
            let own = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
            if !(0.0..=MASS_MAX_KG).contains(&mass_kg) || !own.iter().all(|x| x.is_finite()) {
                let cause = format!("link `{}`: mass {mass_kg} kg, must be 0 to {MASS_MAX_KG}", link.name);
                return Err(wrong(cause));
            }
            let pose = Pose::from_xyz_rpy(*inertial.origin.xyz, *inertial.origin.rpy);
            add(&link.name, Lump { mass_kg, center: pose.t, inertia: pose.r * own * pose.r.transpose() })?;
        }
        for payload in payloads {
            if !(payload.mass_kg >= 0.0 && payload.mass_kg <= MASS_MAX_KG) {
                return Err(wrong(format!("payload {} kg, must be 0 to {MASS_MAX_KG}", payload.mass_kg)));
            }
            add(&payload.link, Lump { mass_kg: payload.mass_kg, center: payload.center, ..Lump::default() })?;
        }
        let joint = |j: usize| (model.parent_body(j + 1).unwrap_or(0), model.joint_at_zero(j).1);
        let joints = (0..model.count).map(joint).collect();
        Ok(Self { model, lumps, joints })
    }

    /// Mass that moves with joint `j` alone, kg.
    pub fn mass_kg(&self, j: usize) -> f64 {
        self.lumps[j + 1].mass_kg
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
        let inertias = std::array::from_fn(|b| Inertia::new(&self.lumps[b], &frames.base_from_body[b]));
        Posture { joints: &self.joints, axes, inertias }
    }
}

#[derive(Clone, Debug)]
pub struct Posture<'a> {
    joints: &'a [(usize, Vector3<f64>)],
    axes: [Spatial; JOINTS_MAX],
    inertias: [Inertia; JOINTS_MAX + 1],
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

    /// Returns the potential energy, J: gravity times mass times height of all moving bodies.
    pub fn potential_j(&self, gravity: f64) -> f64 {
        self.inertias[1..].iter().map(|inertia| inertia.first.z * gravity).sum()
    }

    /// Returns the kinetic energy at the joint velocities `v`, J: the sum over bodies of v . I v / 2.
    pub fn kinetic_j(&self, v: &PerJoint) -> f64 {
        let mut velocity = [Spatial::default(); JOINTS_MAX + 1];
        let mut energy = 0.0;
        for j in 0..self.joints.len() {
            velocity[j + 1] = velocity[self.joints[j].0].plus(&self.axes[j], v[j]);
            energy += 0.5 * velocity[j + 1].dot(&self.inertias[j + 1].times(&velocity[j + 1]));
        }
        energy
    }
}
