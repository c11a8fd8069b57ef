//! Masses of the bodies. The inertials of the URDF's links are merged where joints are fixed or held.

use crate::error::RobotError;
use crate::model::{Model, Source};
use crate::pose::Pose;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};

/// Largest mass of a link, kg. A base that is bolted down may be said to weigh 1,000 (Nextage).
const MASS_MAX_KG: f64 = 2_000.0;
/// Largest inertia of a link, kg m^2: that mass at 2 m.
const INERTIA_MAX_KG_M2: f64 = 8_000.0;
/// Inertia below zero that is rounding. Assumption: far below that of any link, 1 g at 1 mm.
const ROUNDING_KG_M2: f64 = 1e-12;
/// Largest distance of a link's centre, 100 m. No part of one robot reaches farther.
const CENTER_MAX_M: f64 = 100.0;

/// Mass properties of a rigid body, in its own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, m.
    pub center: Vector3<f64>,
    /// Inertia about the centre of mass, kg m^2.
    pub about_center: Matrix3<f64>,
}

impl Inertia {
    /// Creates a point mass, kg and m.
    pub fn point(mass_kg: f64, center: Vector3<f64>) -> Self {
        Self { mass_kg, center, about_center: Matrix3::zeros() }
    }

    /// Combines both into one rigid body. Centres are weighted by mass, and inertias follow the parallel axis
    /// theorem.
    pub fn combined(&self, other: &Self) -> Self {
        let mass_kg = self.mass_kg + other.mass_kg;
        let center = if mass_kg > 0.0 {
            (self.center * self.mass_kg + other.center * other.mass_kg) / mass_kg
        } else {
            Vector3::zeros()
        };
        Self { mass_kg, center, about_center: self.about(&center) + other.about(&center) }
    }

    /// Inertia about a point, kg m^2: I + m (r.r 1 - r r^T), r from the point to the centre.
    pub fn about(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        let r = self.center - point;
        self.about_center + (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * self.mass_kg
    }

    /// Returns the same body in a frame in which its own frame has the pose `pose`.
    pub(crate) fn seen_from(&self, pose: &Pose) -> Self {
        let about_center = pose.r * self.about_center * pose.r.transpose();
        Self { mass_kg: self.mass_kg, center: pose.transform_point(&self.center), about_center }
    }
}

/// Reads the inertial of a link in the link's frame. It is zero if the URDF gives none.
pub(crate) fn read(file: &str, link: &urdf_rs::Link) -> Result<Inertia, RobotError> {
    let (inertial, i) = (&link.inertial, &link.inertial.inertia);
    let refuse = |key: &str, value: f64, bound: String| {
        Err(RobotError::value(file, format!("link `{}`: {key}", link.name), schema::short(value), bound))
    };
    let mass_kg = inertial.mass.value;
    if !(0.0..=MASS_MAX_KG).contains(&mass_kg) {
        return refuse("mass", mass_kg, format!("must be 0 to {MASS_MAX_KG} kg"));
    }
    for value in [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz] {
        if !(value.abs() <= INERTIA_MAX_KG_M2) {
            return refuse("inertia", value, format!("at most {INERTIA_MAX_KG_M2} kg m^2 in magnitude"));
        }
    }
    for value in [i.ixx, i.iyy, i.izz] {
        if value < -ROUNDING_KG_M2 {
            return refuse("inertia about an axis", value, "must not be below 0 kg m^2".into());
        }
    }
    for value in inertial.origin.xyz.iter().chain(inertial.origin.rpy.iter()) {
        if !(value.abs() <= CENTER_MAX_M) {
            return refuse("inertial origin", *value, format!("at most {CENTER_MAX_M} in magnitude"));
        }
    }
    let pose = Pose::from_xyz_rpy(*inertial.origin.xyz, *inertial.origin.rpy);
    let own = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    Ok(Inertia { mass_kg, center: Vector3::zeros(), about_center: own }.seen_from(&pose))
}

impl Model {
    /// Masses of the bodies, each in its own frame: the sums of the links that they carry. Body 0 is the base.
    pub fn inertias(&self) -> [Inertia; JOINTS_MAX + 1] {
        let mut bodies = [Inertia::default(); JOINTS_MAX + 1];
        for link in &self.links {
            bodies[link.body] = bodies[link.body].combined(&link.inertia.seen_from(&link.body_from_link));
        }
        bodies
    }
}

impl Source<'_> {
    /// Refuses arms without mass: their torques would all be zero.
    pub(crate) fn check_masses(&self, model: &Model) -> Result<(), RobotError> {
        let inertias = model.inertias();
        for (side, arm) in ["left", "right"].into_iter().zip(&model.arms) {
            let mass_kg: f64 = arm.range().map(|j| inertias[j + 1].mass_kg).sum();
            if mass_kg <= 0.0 {
                let key = format!("mass of the {side} arm in kg");
                let links = model.massless_links().join("`, `");
                let bound = format!("must be above 0: torques need the <inertial> of `{links}`");
                return Err(RobotError::value(self.urdf, key, schema::short(mass_kg), bound));
            }
        }
        Ok(())
    }
}
