//! What a robot looks like: shapes and colours by link, from a file beside the robot file. The page alone draws them. Nothing
//! is checked for collision with them, and they are no part of the robot's hash.

mod check;
mod error;
mod file;

pub use error::LookError;

use robot::{Model, Pose};
use std::path::{Path, PathBuf};

/// A colour, red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub [u8; 3]);

impl Colour {
    /// As `#rrggbb`.
    pub fn text(self) -> String {
        let [r, g, b] = self.0;
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

/// A shape about the origin of its frame, in metres. Round shapes stand along z.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Edge lengths along x, y and z, and the radius of the rounded edges.
    Box {
        /// Lengths of the edges.
        size_m: [f64; 3],
        /// Radius of the rounding.
        edge_m: f64,
    },
    /// From `radius_m` at the bottom to `top_radius_m` at the top, with rounded edges.
    Cone {
        /// At the bottom.
        radius_m: f64,
        /// At the top.
        top_radius_m: f64,
        /// Height.
        length_m: f64,
        /// Radius of the rounding.
        edge_m: f64,
    },
    /// Half its extent along x, y and z.
    Ellipsoid {
        /// The three radii.
        radii_m: [f64; 3],
    },
    /// Two spheres and what lies between them.
    Capsule {
        /// Centre of the first sphere.
        a_m: [f64; 3],
        /// Centre of the second.
        b_m: [f64; 3],
        /// Radius of the first.
        radius_m: f64,
        /// Radius of the second.
        top_radius_m: f64,
    },
    /// A profile of radius and height that is turned about z.
    Lathe {
        /// Radius and height, from one end to the other.
        profile_m: Vec<[f64; 2]>,
        /// Factors along x and y: what is round becomes oval.
        stretch: [f64; 2],
        /// Exponent of the superellipse that is its outline: 2 is round, 8 nearly a rectangle.
        squareness: f64,
    },
}

/// A part of the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of its link.
    pub link: String,
    /// The body it moves with.
    pub body: usize,
    /// Shape's frame to body's frame: rows of a 3 x 4 matrix. It may mirror.
    pub body_from_shape: [[f64; 4]; 3],
    /// The shape.
    pub shape: Shape,
    /// The colour.
    pub colour: Colour,
    /// From 0, which shines, to 1, which is dull.
    pub roughness: f64,
}

/// A mesh file that the look names for a link.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMesh {
    /// Name of its link.
    pub link: String,
    /// The body it moves with.
    pub body: usize,
    /// Mesh's frame to body's frame, with the mesh's scale.
    pub body_from_mesh: [[f64; 4]; 3],
    /// Names of the files; the first one that is found is drawn.
    pub files: Vec<String>,
    /// Its colour, if it has none of its own.
    pub colour: Option<Colour>,
}

/// What a robot looks like.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Parts, in the file's order.
    pub parts: Vec<Part>,
    /// Colours of links.
    pub links: Vec<(String, Colour)>,
    /// Colour of each of the model's capsules: its own, or its link's; none where the page chooses one. Empty without a file.
    pub capsules: Vec<Option<Colour>>,
    /// Mesh files of links.
    pub meshes: Vec<NamedMesh>,
}

impl Look {
    /// The look file that belongs to a robot file: `robot.toml` has `robot.look.toml` beside it.
    pub fn file_of(robot_file: &Path) -> PathBuf {
        robot_file.with_extension("look.toml")
    }

    /// Reads the look file beside a robot file. Without one, the look is empty and the page draws capsules.
    ///
    /// # Errors
    /// The file cannot be read, or it is not a look of this robot.
    pub fn read(robot_file: &Path, model: &Model) -> Result<Self, LookError> {
        let path = Self::file_of(robot_file);
        if !path.exists() {
            return Ok(Self::default());
        }
        let name = path.display().to_string();
        let text = pipeline::read_text(&path).map_err(|error| match error {
            pipeline::ConfigError::Read { file, cause } => LookError::Read { file, cause },
            error => LookError::Read { file: name.clone(), cause: error.to_string() },
        })?;
        Self::parse(&name, &text, model)
    }

    /// Reads the text of a look file; `name` is for error messages.
    ///
    /// # Errors
    /// It is not a look of this robot.
    pub fn parse(name: &str, text: &str, model: &Model) -> Result<Self, LookError> {
        check::Checker::new(name, model).look(text)
    }

    /// The colour of a link.
    pub fn colour_of(&self, link: &str) -> Option<Colour> {
        self.links.iter().find(|(name, _)| name == link).map(|(_, colour)| *colour)
    }
}

/// Rows of the 3 x 4 matrix of `outer * scale * inner`.
pub(crate) fn rows(outer: &Pose, scale: [f64; 3], inner: &Pose) -> [[f64; 4]; 3] {
    let turn = outer.r * nalgebra::Matrix3::from_diagonal(&scale.into());
    let (r, t) = (turn * inner.r, turn * inner.t + outer.t);
    std::array::from_fn(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]])
}
