//! What the robot looks like, as far as the URDF says it without files of its own.

use crate::model::Model;
use crate::pose::Pose;
use urdf_rs::Geometry;

/// Largest believable measure of a shape, m; a larger one is not drawn.
const SIZE_MAX_M: f64 = 10.0;

/// A shape to be drawn. Nothing is checked for collision with it: that is what capsules are for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visual {
    /// The body it moves with.
    pub body: usize,
    /// Its own frame in the body's.
    pub body_from_shape: Pose,
    /// Its form.
    pub form: Form,
}

/// A form about the origin of its frame, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Edge lengths along x, y and z.
    Box([f64; 3]),
    /// Along z.
    Cylinder {
        /// Radius, m.
        radius_m: f64,
        /// Length, m.
        length_m: f64,
    },
    /// About the origin.
    Sphere {
        /// Radius, m.
        radius_m: f64,
    },
}

impl Form {
    fn measures(&self) -> [f64; 3] {
        match *self {
            Self::Box(size_m) => size_m,
            Self::Cylinder { radius_m, length_m } => [radius_m, radius_m, length_m],
            Self::Sphere { radius_m } => [radius_m; 3],
        }
    }
}

/// The shapes of a link that need no file of their own and can be drawn; their bodies are not known yet.
pub(crate) fn read(visuals: &[urdf_rs::Visual]) -> Vec<Visual> {
    let shapes = visuals.iter().filter_map(|visual| {
        let form = match visual.geometry {
            Geometry::Box { size } => Form::Box(*size),
            Geometry::Cylinder { radius, length } => Form::Cylinder { radius_m: radius, length_m: length },
            Geometry::Sphere { radius } => Form::Sphere { radius_m: radius },
            Geometry::Capsule { .. } | Geometry::Mesh { .. } => return None,
        };
        let body_from_shape = Pose::from_xyz_rpy(*visual.origin.xyz, *visual.origin.rpy);
        Some(Visual { body: 0, body_from_shape, form })
    });
    let drawn = |visual: &Visual| {
        let measured = visual.form.measures().iter().all(|&size| size > 0.0 && size <= SIZE_MAX_M);
        measured && visual.body_from_shape.t.iter().chain(&visual.body_from_shape.r).all(|value| value.is_finite())
    };
    shapes.filter(drawn).collect()
}

impl Model {
    /// The boxes, cylinders and spheres of the URDF's visuals; meshes are left out.
    pub fn visuals(&self) -> impl Iterator<Item = Visual> {
        self.links.iter().flat_map(|link| {
            let in_body = |visual: &Visual| Visual {
                body: link.body,
                body_from_shape: link.body_from_link.compose(&visual.body_from_shape),
                form: visual.form,
            };
            link.visuals.iter().map(in_body)
        })
    }
}
