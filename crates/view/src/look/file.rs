//! The look file as written. [`super::check`] checks its values.

use serde::Deserialize;
use std::collections::BTreeMap;

/// The only supported format.
pub const FORMAT: u32 = 1;

/// The whole file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LookFile {
    pub format: u32,
    /// Names for colours, each as `#rrggbb`.
    #[serde(default)]
    pub colours: BTreeMap<String, String>,
    /// Colour of a link: of its meshes, and of its capsules without a colour of their own.
    #[serde(default)]
    pub links: BTreeMap<String, String>,
    /// Colour of a single capsule.
    #[serde(default)]
    pub capsules: BTreeMap<String, String>,
    #[serde(default)]
    pub parts: Vec<PartEntry>,
    #[serde(default)]
    pub meshes: MeshTable,
}

/// Mesh files of the robot's maker, for a URDF that names none.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    #[serde(default)]
    pub files: Vec<MeshEntry>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum ShapeName {
    Box,
    Cylinder,
    Cone,
    Sphere,
    Ellipsoid,
    Capsule,
    Lathe,
}

/// One part. Its shape decides which sizes it must have.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartEntry {
    pub link: String,
    pub shape: ShapeName,
    pub colour: String,
    pub roughness: Option<f64>,
    pub xyz_m: Option<[f64; 3]>,
    pub rpy_rad: Option<[f64; 3]>,
    /// Motions of the part while the hand closes, from the palm outward.
    #[serde(default)]
    pub closing: Vec<ClosingEntry>,
    /// Mirror image of the part on another link.
    pub mirror: Option<MirrorEntry>,
    pub size_m: Option<[f64; 3]>,
    pub edge_m: Option<f64>,
    pub radius_m: Option<f64>,
    pub top_radius_m: Option<f64>,
    pub length_m: Option<f64>,
    pub radii_m: Option<[f64; 3]>,
    pub a_m: Option<[f64; 3]>,
    pub b_m: Option<[f64; 3]>,
    pub profile_m: Option<Vec<[f64; 2]>>,
    pub stretch: Option<[f64; 2]>,
    pub squareness: Option<f64>,
}

/// A finger's motion from the open to the closed hand, in the frame of the link: a slide, or a turn about an axis.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClosingEntry {
    pub slide_m: Option<[f64; 3]>,
    pub pivot_m: Option<[f64; 3]>,
    pub axis: Option<[f64; 3]>,
    pub turn_rad: Option<f64>,
}

/// Link and axes of a mirror image.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorEntry {
    pub link: String,
    /// Axes of the link's frame that change their sign, such as "xz". Use "" for none.
    pub axes: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshEntry {
    pub link: String,
    /// File names. The page draws the first file found.
    pub names: Vec<String>,
    pub xyz_m: Option<[f64; 3]>,
    pub rpy_rad: Option<[f64; 3]>,
    pub scale: Option<[f64; 3]>,
}
