//! Lifts the points of one image to directions: a small network learnt from motion capture, projected into random cameras,
//! with the errors of a real landmarker. A landmarker finds points in the image well and their depth badly.
//!
//! ```text
//! x = [(p - c) / s, visibility - 1/2, 2 c, ln s + 1.2, 10 ln(r / r_0)]
//! (y_0, ..., y_7) = network(x),  d_i = y_i[0..3] / |y_i[0..3]|,  k_i = ln(1 + exp(y_i[3] + 2))
//! k d = (k_i d_i + k'_i d'_i) / 2
//! ```
//!
//! p are the points in heights of the image from its middle, x right, y down. c is the trunk's centre and s its size in the
//! image. r are lengths over the trunk's. d_0 to d_5 are upper arms, forearms and hands, left first, in the trunk's axes
//! (across to the left, up, ahead). d_6 and d_7 are across and up in the camera's axes (x right, y down, z away). k is the
//! concentration of a density of von Mises and Fisher: the expected angle is sqrt(pi / 2 / k). k' and d' are found in the mirror
//! image, and mirrored back: where they disagree, k is smaller.

use messages::named;
use nalgebra::{Matrix3, Unit, Vector3};
use perceptron::{Dense, Perceptron, WeightsError, WriteError, must, must_match, sha256_hex};
use serde::{Deserialize, Serialize};

named! {
    /// The points of an image. Layout files use the names.
    #[allow(missing_docs)]
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum Point {
        Nose = 0 => "nose",
        LeftEye = 1 => "left_eye",
        RightEye = 2 => "right_eye",
        LeftEar = 3 => "left_ear",
        RightEar = 4 => "right_ear",
        LeftShoulder = 5 => "left_shoulder",
        RightShoulder = 6 => "right_shoulder",
        LeftElbow = 7 => "left_elbow",
        RightElbow = 8 => "right_elbow",
        LeftWrist = 9 => "left_wrist",
        RightWrist = 10 => "right_wrist",
        LeftPinky = 11 => "left_pinky",
        RightPinky = 12 => "right_pinky",
        LeftIndex = 13 => "left_index",
        RightIndex = 14 => "right_index",
        LeftThumb = 15 => "left_thumb",
        RightThumb = 16 => "right_thumb",
        LeftHip = 17 => "left_hip",
        RightHip = 18 => "right_hip",
        LeftKnee = 19 => "left_knee",
        RightKnee = 20 => "right_knee",
        LeftAnkle = 21 => "left_ankle",
        RightAnkle = 22 => "right_ankle",
        LeftHeel = 23 => "left_heel",
        RightHeel = 24 => "right_heel",
        LeftToe = 25 => "left_toe",
        RightToe = 26 => "right_toe",
    }
}

/// Number of points.
pub const POINTS: usize = 27;
/// Number of directions.
pub const DIRECTIONS: usize = 8;
/// Lengths that help: upper arm and forearm, over the trunk's.
pub const LENGTHS: usize = 2;
/// Inputs of the network.
pub const LIFTER_INPUTS: usize = 3 * POINTS + 3 + LENGTHS;
/// Outputs of the network: four numbers for each direction.
pub const LIFTER_OUTPUTS: usize = 4 * DIRECTIONS;
/// The only format of the manifest so far.
pub const LIFTER_FORMAT: u32 = 1;
/// Typical lengths, r_0: those of the mesh that the training people have.
pub(crate) const TYPICAL: [f64; LENGTHS] = [0.52, 0.48];
/// Largest distance of a point that counts, in sizes of the trunk.
const FAR: f32 = 5.0;
/// Least size of a trunk in the image, in heights of the image.
const SIZE_MIN: f64 = 0.03;
/// Shoulders' breadth that counts as the trunk's length where the trunk is foreshortened.
const BREADTH: f64 = 1.2;
/// The trunk's across. Before it are left and right in turn.
const ACROSS: usize = 6;
/// Width of the network's layers.
pub const LIFTER_WIDTHS: [usize; 5] = [LIFTER_INPUTS, 200, 200, 200, LIFTER_OUTPUTS];
/// Name of the network in its file.
const NAME: &str = "lifter";

/// Points of one person in one image, as a landmarker sees them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePoints {
    /// Points in heights of the image from its middle, x right, y down.
    pub points: [[f32; 2]; POINTS],
    /// Visibility of each point, from 0 to 1. Zero for one that is not there.
    pub seen: [f32; POINTS],
}

impl ImagePoints {
    /// Nothing is seen.
    pub const NONE: Self = Self { points: [[0.0; 2]; POINTS], seen: [0.0; POINTS] };

    /// Returns the other side's name for each point, and x with the other sign: what the mirror image shows.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let mut out = *self;
        for point in 0..POINTS {
            let other = if point == 0 { 0 } else { ((point - 1) ^ 1) + 1 };
            let [x, y] = self.points[other];
            (out.points[point], out.seen[point]) = ([-x, y], self.seen[other]);
        }
        out
    }

    /// The trunk's centre, and its size, in heights of the image. `None` without shoulders and hips.
    pub(crate) fn trunk(&self) -> Option<([f64; 2], f64)> {
        let corners = [Point::LeftShoulder, Point::RightShoulder, Point::LeftHip, Point::RightHip];
        let [a, b, c, d] = corners.map(|corner| self.points[corner as usize].map(f64::from));
        if corners.iter().any(|corner| self.seen[*corner as usize].max(0.0) == 0.0) {
            return None;
        }
        let along = [0, 1].map(|axis| (a[axis] + b[axis] - c[axis] - d[axis]) / 2.0);
        let across = (a[0] - b[0]).hypot(a[1] - b[1]);
        let size = along[0].hypot(along[1]).max(BREADTH * across).max(SIZE_MIN);
        let centre = [0, 1].map(|axis| (a[axis] + b[axis] + c[axis] + d[axis]) / 4.0);
        size.is_finite().then_some((centre, size))
    }

    /// Returns the inputs of the network. `lengths` are over the trunk's, if the session knows them. `None` without
    /// shoulders and hips.
    pub fn inputs(&self, lengths: Option<[f64; LENGTHS]>) -> Option<[f32; LIFTER_INPUTS]> {
        let (centre, size) = self.trunk()?;
        let mut out = [0.0_f32; LIFTER_INPUTS];
        for point in 0..POINTS {
            let [x, y] = [0, 1].map(|axis| ((f64::from(self.points[point][axis]) - centre[axis]) / size) as f32);
            let seen = self.seen[point].clamp(0.0, 1.0);
            if seen > 0.0 && x.is_finite() && y.is_finite() {
                (out[2 * point], out[2 * point + 1]) = (x.clamp(-FAR, FAR), y.clamp(-FAR, FAR));
                out[2 * POINTS + point] = seen - 0.5;
            } else {
                out[2 * POINTS + point] = -0.5;
            }
        }
        let rest = &mut out[3 * POINTS..];
        (rest[0], rest[1]) = ((2.0 * centre[0]) as f32, (2.0 * centre[1]) as f32);
        rest[2] = (size.ln() + 1.2) as f32;
        for (length, (own, typical)) in lengths.iter().flatten().zip(TYPICAL).enumerate() {
            rest[3 + length] = (10.0 * (own / typical).ln()).clamp(-3.0, 3.0) as f32;
        }
        Some(out)
    }
}

/// Directions of a person, and how sure they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lifted {
    /// Unit vectors: upper arms, forearms, hands in the trunk's axes; the trunk's across and up in the camera's.
    pub directions: [Vector3<f64>; DIRECTIONS],
    /// Concentration of each.
    pub concentrations: [f64; DIRECTIONS],
}

impl Lifted {
    /// Reads the network's outputs. `None` if they are not finite, or a direction has no length.
    pub fn new(outputs: &[f32; LIFTER_OUTPUTS]) -> Option<Self> {
        let (rows, _) = outputs.as_chunks::<4>();
        let mut lifted = Self { directions: [Vector3::zeros(); DIRECTIONS], concentrations: [0.0; DIRECTIONS] };
        for (i, &[x, y, z, k]) in rows.iter().enumerate() {
            let direction = Vector3::new(x, y, z).map(f64::from).try_normalize(1e-6)?;
            let concentration = (f64::from(k) + 2.0).min(300.0).exp().ln_1p();
            if !direction.iter().chain([&concentration]).all(|value| value.is_finite()) {
                return None;
            }
            (lifted.directions[i], lifted.concentrations[i]) = (direction, concentration);
        }
        Some(lifted)
    }

    /// The same of the mirror image.
    pub fn mirrored(&self) -> Self {
        let other = |i: usize| if i < ACROSS { i ^ 1 } else { i };
        // The trunk's across points to the left of the person in the mirror, too.
        let signs = |i: usize| if i == ACROSS { Vector3::new(1.0, -1.0, -1.0) } else { Vector3::new(-1.0, 1.0, 1.0) };
        let directions = std::array::from_fn(|i| self.directions[other(i)].component_mul(&signs(i)));
        Self { directions, concentrations: std::array::from_fn(|i| self.concentrations[other(i)]) }
    }

    /// Mean of two estimates of one person, weighted by their concentrations. `None` if two directions are opposite.
    fn mixed(mut self, other: &Self) -> Option<Self> {
        for i in 0..DIRECTIONS {
            let sum = self.directions[i] * self.concentrations[i] + other.directions[i] * other.concentrations[i];
            let (direction, long) = Unit::try_new_and_get(sum, 1e-9)?;
            (self.directions[i], self.concentrations[i]) = (direction.into_inner(), long / 2.0);
        }
        Some(self)
    }

    /// Expected angle between direction i and the truth, rad: sqrt(pi / 2 / k).
    pub fn expected_rad(&self, i: usize) -> f64 {
        (std::f64::consts::FRAC_PI_2 / self.concentrations[i].max(1e-3)).sqrt()
    }

    /// The trunk's axes in those of the camera: columns across, up, ahead. `None` if across and up are parallel.
    pub fn trunk(&self) -> Option<Matrix3<f64>> {
        let [across, up] = [self.directions[6], self.directions[7]];
        let across = (across - up * across.dot(&up)).try_normalize(1e-3)?;
        Some(Matrix3::from_columns(&[across, up, across.cross(&up)]))
    }
}

/// The manifest beside the tensors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LifterManifest {
    /// `LIFTER_FORMAT`.
    pub format: u32,
    /// SHA-256 of the safetensors file, lower-case hex.
    pub sha256: String,
    /// `LIFTER_WIDTHS`.
    pub widths: Vec<usize>,
    /// Seed of the training.
    pub seed: u64,
    /// Steps of the training.
    pub steps: u64,
    /// Description of the training data.
    pub trained_on: String,
    /// Figures of the validation, for the reader.
    #[serde(default)]
    pub validation: toml::Table,
}

/// The network, ready to run.
#[derive(Clone, Debug)]
pub struct Lifter {
    network: Perceptron,
}

impl Lifter {
    /// Packs the layers, whose widths are `LIFTER_WIDTHS`.
    pub fn new(layers: &[Dense]) -> Self {
        Self { network: Perceptron::new(layers) }
    }

    /// Reads the manifest and the safetensors file that it describes.
    ///
    /// # Errors
    /// Returns an error that names the mismatch.
    pub fn read(manifest_text: &str, bytes: &[u8]) -> Result<Self, WeightsError> {
        let manifest: LifterManifest = toml::from_str(manifest_text)?;
        must("format", manifest.format, LIFTER_FORMAT)?;
        must("widths", &manifest.widths[..], &LIFTER_WIDTHS[..])?;
        must_match(bytes, &manifest.sha256)?;
        let [layers] = perceptron::read_networks(bytes, [(NAME, &LIFTER_WIDTHS)])?;
        Ok(Self::new(&layers))
    }

    /// Writes the two files of a weights folder: safetensors bytes and manifest text.
    ///
    /// # Errors
    /// Returns an error if the manifest holds a value that TOML cannot.
    pub fn write(layers: &[Dense], manifest: &LifterManifest) -> Result<(Vec<u8>, String), WriteError> {
        let bytes = perceptron::write_layers(&[(NAME, layers)])?;
        let (format, widths, sha256) = (LIFTER_FORMAT, LIFTER_WIDTHS.to_vec(), sha256_hex(&bytes));
        let manifest = LifterManifest { format, widths, sha256, ..manifest.clone() };
        Ok((bytes, toml::to_string(&manifest)?))
    }

    /// Lifts one image. `None` without shoulders and hips, or if a number is not finite. Never allocates or panics.
    pub fn lift(&self, image: &ImagePoints, lengths: Option<[f64; LENGTHS]>) -> Option<Lifted> {
        let inputs = [image.inputs(lengths)?, image.mirrored().inputs(lengths)?];
        let [own, other] = self.network.forward::<LIFTER_INPUTS, LIFTER_OUTPUTS, 2>(&inputs);
        Lifted::new(&own)?.mixed(&Lifted::new(&other)?.mirrored())
    }
}
