//! Appearance of a robot: shapes and colours by link, from a file beside the robot file. Only the page draws
//! them. They are not checked for collisions, and they are no part of the robot's hash.

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
    /// Returns the colour as `#rrggbb`.
    pub fn text(self) -> String {
        let [r, g, b] = self.0;
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

/// A shape around the origin of its frame, in metres. Round shapes stand along z.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum Shape {
    /// A box with edges of the lengths `size_m` that are rounded with the radius `edge_m`, aligned with x, y and z.
    Box { size_m: [f64; 3], edge_m: f64 },
    /// A cone from `radius_m` at the bottom to `top_radius_m` at the top. `edge_m` is the radius of its rounded edges.
    Cone { radius_m: f64, top_radius_m: f64, length_m: f64, edge_m: f64 },
    /// An ellipsoid, aligned with x, y and z. `radii_m` are half its extents.
    Ellipsoid { radii_m: [f64; 3] },
    /// A sphere of `radius_m` around `a_m`, one of `top_radius_m` around `b_m`, and the cone that joins them.
    Capsule { a_m: [f64; 3], b_m: [f64; 3], radius_m: f64, top_radius_m: f64 },
    /// A profile of radius and height that is turned about z.
    Lathe {
        /// Radius and height of each point, from one end to the other.
        profile_m: Vec<[f64; 2]>,
        /// Factors along x and y. They make a round shape oval.
        stretch: [f64; 2],
        /// Exponent of the superellipse that is its outline. 2 is round, 8 is nearly a rectangle.
        squareness: f64,
    },
}

/// Motion of a finger's part while its hand closes.
#[derive(Clone, Debug, PartialEq)]
pub struct Closing {
    /// 0 for the left hand, 1 for the right one.
    pub hand: usize,
    /// Transform from the link's frame to the body's frame. It may mirror.
    pub body_from_link: [[f64; 4]; 3],
    /// Transform from the shape's frame to the link's frame.
    pub link_from_shape: [[f64; 4]; 3],
    /// Motions in the link's frame, from the palm outward.
    pub motions: Vec<FingerMotion>,
}

/// Motion of a part from the open to the closed hand.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum FingerMotion {
    /// By `offset_m`.
    Slide { offset_m: [f64; 3] },
    /// By `turn_rad` about the unit vector `axis` through `pivot_m`.
    Turn { pivot_m: [f64; 3], axis: [f64; 3], turn_rad: f64 },
}

/// A part of the robot.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Part {
    pub link: String,
    pub body: usize,
    /// Transform from the shape's frame to the body's frame: rows of a 3 x 4 matrix. It may mirror.
    pub body_from_shape: [[f64; 4]; 3],
    /// The hand that moves it while it closes, 0 for the left one, and its motions. The part's transform then is the product
    /// of `body_from_link`, the motions from the palm outward, and `link_from_shape`. `None` for a part that does not move.
    pub closing: Option<Closing>,
    pub shape: Shape,
    pub colour: Colour,
    /// Roughness, from 0 (glossy) to 1 (matt).
    pub roughness: f64,
}

/// A mesh file that the look names for a link.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMesh {
    /// Name of its link.
    pub link: String,
    /// The body it moves with.
    pub body: usize,
    /// Transform from the mesh's frame to the body's frame, with the mesh's scale.
    pub body_from_mesh: [[f64; 4]; 3],
    /// Names of the files. The page draws the first file found.
    pub files: Vec<String>,
    /// Colour, if the mesh has none of its own.
    pub colour: Option<Colour>,
}

/// Appearance of a robot.
#[derive(Clone, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct Look {
    pub parts: Vec<Part>,
    pub links: Vec<(String, Colour)>,
    /// Colour of each capsule of the model: its own, or its link's. `None` if the page chooses one. Empty without
    /// a look file.
    pub capsules: Vec<Option<Colour>>,
    pub meshes: Vec<NamedMesh>,
}

impl Look {
    /// Returns the path of the look file of a robot file: `robot.look.toml` beside `robot.toml`.
    pub fn file_of(robot_file: &Path) -> PathBuf {
        robot_file.with_extension("look.toml")
    }

    /// Reads the look file beside a robot file. Without one, the look is empty and the page draws capsules.
    pub fn read(robot_file: &Path, model: &Model) -> Result<Self, LookError> {
        let path = Self::file_of(robot_file);
        if !path.exists() {
            return Ok(Self::default());
        }
        let name = path.display().to_string();
        let text = config::read_text(&path).map_err(|error| match error {
            config::ConfigError::Read { file, cause } => LookError::Read { file, cause },
            error => LookError::Read { file: name.clone(), cause: error.to_string() },
        })?;
        Self::parse(&name, &text, model)
    }

    /// Reads the text of a look file. `name` appears in error messages.
    pub fn parse(name: &str, text: &str, model: &Model) -> Result<Self, LookError> {
        check::Checker::new(name, model).look(text)
    }

    /// Returns the colour of a link.
    pub fn colour_of(&self, link: &str) -> Option<Colour> {
        self.links.iter().find(|(name, _)| name == link).map(|(_, colour)| *colour)
    }
}

/// Returns the rows of the 3 x 4 matrix of `outer * scale * inner`.
pub(crate) fn rows(outer: &Pose, scale: [f64; 3], inner: &Pose) -> [[f64; 4]; 3] {
    let turn = outer.r * nalgebra::Matrix3::from_diagonal(&scale.into());
    let (r, t) = (turn * inner.r, turn * inner.t + outer.t);
    std::array::from_fn(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]])
}
