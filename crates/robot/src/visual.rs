//! The appearance of the robot, as far as the URDF describes it without other files.

use crate::model::Model;
use crate::pose::Pose;
use urdf_rs::Geometry;

/// Largest plausible dimension of a shape, m. A larger shape is not drawn.
const SIZE_MAX_M: f64 = 10.0;

/// A shape to draw. It is not used for collision checks, which use the capsules.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visual {
    /// The body that it moves with.
    pub body: usize,
    /// Its own frame in the body's.
    pub body_from_shape: Pose,
    /// Its form.
    pub form: Form,
}

/// A form around the origin of its frame, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum Form {
    /// Edge lengths along x, y and z.
    Box([f64; 3]),
    /// A cylinder along z.
    Cylinder { radius_m: f64, length_m: f64 },
    /// A cylinder of this length along z, with a half sphere at each end.
    Capsule { radius_m: f64, length_m: f64 },
    /// A sphere around the origin.
    Sphere { radius_m: f64 },
}

impl Form {
    fn measures(&self) -> [f64; 3] {
        match *self {
            Self::Box(size_m) => size_m,
            Self::Cylinder { radius_m, length_m } => [radius_m, radius_m, length_m],
            Self::Capsule { radius_m, length_m } => [radius_m, radius_m, length_m + 2.0 * radius_m],
            Self::Sphere { radius_m } => [radius_m; 3],
        }
    }
}

/// A mesh file that the URDF gives for a link. This crate never reads the file itself.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshVisual {
    /// Name of the link.
    pub link: String,
    /// The body that it moves with.
    pub body: usize,
    /// The mesh's own frame in the body's.
    pub body_from_mesh: Pose,
    /// File name as written, such as `package://robot/meshes/arm.dae`.
    pub file: String,
    /// Scale along the mesh's x, y and z. Negative values mirror.
    pub scale: [f64; 3],
    /// True if the file is for collision checks, false if it is for drawing.
    pub is_collision: bool,
    /// Red, green and blue of the URDF's material, 0 to 1.
    pub colour: Option<[f64; 3]>,
}

/// Reads the mesh files of a link. Names and bodies are not yet known. `materials` are those of the whole
/// robot.
pub(crate) fn read_meshes(link: &urdf_rs::Link, materials: &[urdf_rs::Material]) -> Vec<MeshVisual> {
    let mesh = |geometry: &Geometry, origin: &urdf_rs::Pose, colour, is_collision| {
        let Geometry::Mesh { filename, scale } = geometry else { return None };
        let body_from_mesh = Pose::from_xyz_rpy(*origin.xyz, *origin.rpy);
        let scale = scale.map_or([1.0; 3], |scale| *scale);
        Some(MeshVisual {
            link: link.name.clone(),
            body: 0,
            body_from_mesh,
            file: filename.clone(),
            scale,
            is_collision,
            colour,
        })
    };
    let colour = |visual: &urdf_rs::Visual| {
        let own = visual.material.as_ref()?;
        // A material without a colour refers to the robot's material of that name.
        let named = || materials.iter().find(|material| material.name == own.name)?.color.as_ref();
        let [r, g, b, _] = *own.color.as_ref().or_else(named)?.rgba;
        Some([r, g, b].map(|channel: f64| channel.clamp(0.0, 1.0))).filter(|rgb| rgb.iter().all(|x| x.is_finite()))
    };
    let visuals = link.visual.iter().filter_map(|visual| mesh(&visual.geometry, &visual.origin, colour(visual), false));
    let collisions =
        link.collision.iter().filter_map(|collision| mesh(&collision.geometry, &collision.origin, None, true));
    let drawn = |mesh: &MeshVisual| {
        let scaled = mesh.scale.iter().all(|scale| scale.is_finite() && *scale != 0.0);
        scaled && mesh.body_from_mesh.t.iter().chain(&mesh.body_from_mesh.r).all(|value| value.is_finite())
    };
    visuals.chain(collisions).filter(drawn).collect()
}

/// Reads the shapes of a link that need no file of their own and can be drawn. Their bodies are not yet
/// known.
pub(crate) fn read(visuals: &[urdf_rs::Visual]) -> Vec<Visual> {
    let shapes = visuals.iter().filter_map(|visual| {
        let form = match visual.geometry {
            Geometry::Box { size } => Form::Box(*size),
            Geometry::Cylinder { radius, length } => Form::Cylinder { radius_m: radius, length_m: length },
            Geometry::Sphere { radius } => Form::Sphere { radius_m: radius },
            Geometry::Capsule { radius, length } => Form::Capsule { radius_m: radius, length_m: length },
            Geometry::Mesh { .. } => return None,
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
    /// The mesh files that the URDF names, for drawing and for collision checks.
    pub fn meshes(&self) -> impl Iterator<Item = MeshVisual> {
        self.links.iter().flat_map(|link| {
            link.meshes.iter().map(|mesh| MeshVisual {
                body: link.body,
                body_from_mesh: link.body_from_link.compose(&mesh.body_from_mesh),
                ..mesh.clone()
            })
        })
    }

    /// The boxes, cylinders, capsules and spheres of the URDF's visuals. Meshes are left out.
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
