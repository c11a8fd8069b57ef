//! HumanML3D's two formats: joint positions (N, 22, 3) and feature vectors (N, 263), y up, metres, 20 Hz, no
//! rotations.

use crate::error::ArrayError;
use crate::npy::{self, Array};
use crate::{FRAMES_MAX, LoadOptions};
use messages::SMPL_JOINTS;
use nalgebra::Vector3;
use std::borrow::Cow;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Frame rate of the data set, Hz.
pub(crate) const FRAME_RATE_HZ: f64 = 20.0;
/// Features of a frame: root (4), positions (21 * 3), 6D rotations (21 * 6), velocities (22 * 3), foot contacts (4).
const FEATURES: usize = 263;
/// Index of the first position feature. The positions are those of joints 1 to 21, relative to the root.
const RIC: usize = 4;
/// Index of the first foot contact.
const CONTACTS: usize = 259;
/// Number of folders above the file's own that are searched for Mean.npy and Std.npy. The data set keeps them one
/// above.
const STATISTICS_LEVELS: usize = 2;
/// Largest coordinate, m, and largest feature. No room and no statistic is larger.
const NUMBER_MAX: f64 = 1e5;

type Positions = Vec<[Vector3<f64>; SMPL_JOINTS]>;

/// Accepted shapes, for error texts.
pub(crate) const SHAPES: &str = "(N, 22, 3), (N, 66) or (1, 22, 3, N) global positions, (N, 24, 3), (N, 52, 3) or \
     (N, 55, 3) with hands, or (N, 263) HumanML3D features";
/// Joints of SMPL-22, SMPL, SMPL-H and SMPL-X. All begin with the 22.
const JOINTS: [usize; 4] = [SMPL_JOINTS, 24, 52, 55];
/// Numbers of a frame of SMPL-22.
const FLAT: usize = 3 * SMPL_JOINTS;
/// Parameters of a frame of Motion-X: rotations, face, place and shape of SMPL-X.
const PARAMETERS: usize = 322;

/// Meaning of an array, and its number of frames.
#[derive(Clone, Copy)]
enum Layout {
    Positions(usize),
    /// Positions, with the frames in the last dimension.
    Last(usize),
    Features(usize),
}

/// Returns true for features. They always have y up.
pub(crate) fn are_features(array: &Array) -> bool {
    array.squeezed().last() == Some(&FEATURES)
}

/// Returns positions in the file's frame (x left, y up, z forward), and warnings about missing information.
pub(crate) fn read(path: &Path, array: &Array, options: &LoadOptions) -> Result<(Positions, Vec<String>), ArrayError> {
    if array.shape == [FEATURES] {
        return Err(ArrayError::Statistics);
    }
    // A single frame loses its N, because dimensions of length one are removed.
    let squeezed = array.squeezed();
    if squeezed.last() == Some(&PARAMETERS) {
        return Err(ArrayError::Parameters);
    }
    let layout = match *squeezed.as_slice() {
        [joints, 3] if array.shape.len() > 2 && JOINTS.contains(&joints) => Layout::Positions(1),
        [frames, joints, 3] if JOINTS.contains(&joints) => Layout::Positions(frames),
        [frames, FLAT] => Layout::Positions(frames),
        // As networks return one motion.
        [SMPL_JOINTS, 3, frames] => Layout::Last(frames),
        [FEATURES] => Layout::Features(1),
        [frames, FEATURES] => Layout::Features(frames),
        _ => return Err(ArrayError::Shape { found: array.shape.clone(), expected: SHAPES }),
    };
    let (Layout::Positions(frames) | Layout::Last(frames) | Layout::Features(frames)) = layout;
    if frames == 0 {
        return Err(ArrayError::Empty { shape: array.shape.clone() });
    }
    if frames > FRAMES_MAX {
        return Err(ArrayError::TooManyFrames { frames, bound: FRAMES_MAX });
    }
    let values = match layout {
        Layout::Last(_) => Cow::Owned(npy::row_major(&array.values, &[frames, FLAT])),
        _ => Cow::Borrowed(&array.values),
    };
    let width = values.len() / frames;
    npy::check_numbers(&values, width, NUMBER_MAX)?;
    match layout {
        // SMPL-24, SMPL-H and SMPL-X are SMPL-22 with hands and a face at the end.
        Layout::Positions(_) | Layout::Last(_) => {
            let joint = |place: &[f64]| Vector3::from_column_slice(place);
            let body = |frame: &[f64]| std::array::from_fn(|number| joint(&frame[3 * number..3 * number + 3]));
            Ok((values.chunks_exact(width).map(body).collect(), Vec::new()))
        }
        Layout::Features(_) => {
            let mut warnings = Vec::new();
            let raw = unnormalised(path, &values, options, &mut warnings)?;
            Ok((recover(raw.as_deref().unwrap_or(&values)), warnings))
        }
    }
}

/// Returns global positions from features. The yaw rate is the half angle of a quaternion's step. The heading at
/// frame i is therefore q = (cos a, 0, sin a, 0) (w x y z), where a is the sum of the rates before i. Positions
/// and the root's steps are in the heading's frame, and q^-1 turns them back.
fn recover(values: &[f64]) -> Positions {
    let mut half_yaw = 0.0f64;
    let mut root = Vector3::zeros();
    let mut step = Vector3::zeros();
    let mut out = Vec::with_capacity(values.len() / FEATURES);
    for row in values.chunks_exact(FEATURES) {
        let (sin, cos) = (2.0 * half_yaw).sin_cos();
        // q^-1 turns by minus the yaw about y.
        let back = |v: Vector3<f64>| Vector3::new(cos * v.x - sin * v.z, v.y, sin * v.x + cos * v.z);
        root += back(step);
        root.y = row[3];
        let place = Vector3::new(root.x, 0.0, root.z);
        let joint = |j: usize| {
            let at = RIC + 3 * (j - 1);
            place + back(Vector3::new(row[at], row[at + 1], row[at + 2]))
        };
        out.push(std::array::from_fn(|j| if j == 0 { root } else { joint(j) }));
        half_yaw += row[0];
        step = Vector3::new(row[1], 0.0, row[2]);
    }
    out
}

/// Evidence for raw features: three signs. Normalised features show at most one.
struct Signs {
    root_height_m: f64,
    contacts_binary: f64,
    leg_m: f64,
    leg_spread: f64,
}

impl Signs {
    fn from_features(values: &[f64]) -> Self {
        let rows = || values.chunks_exact(FEATURES);
        let count = rows().len().max(1) as f64;
        let mut heights: Vec<f64> = rows().map(|row| row[3]).collect();
        heights.sort_by(f64::total_cmp);
        // Contacts are 0 or 1. A network's contacts are near these values.
        let near = |x: &f64| x.abs() < 0.2 || (x - 1.0).abs() < 0.2;
        let binary = rows().flat_map(|row| &row[CONTACTS..]).filter(|x| near(x)).count();
        let at = |row: &[f64], joint: usize| {
            let at = RIC + 3 * (joint - 1);
            Vector3::new(row[at], row[at + 1], row[at + 2])
        };
        // The left leg: hip 1, knee 4, ankle 7.
        let leg = |row: &[f64]| (at(row, 4) - at(row, 1)).norm() + (at(row, 7) - at(row, 4)).norm();
        let mean = rows().map(leg).sum::<f64>() / count;
        let variance = rows().map(|row| (leg(row) - mean).powi(2)).sum::<f64>() / count;
        Self {
            root_height_m: heights.get(heights.len() / 2).copied().unwrap_or(0.0),
            contacts_binary: binary as f64 / (4.0 * count),
            leg_m: mean,
            leg_spread: variance.sqrt() / mean.max(1e-9),
        }
    }

    fn are_raw(&self) -> bool {
        let root = (0.05..1.6).contains(&self.root_height_m);
        let contacts = self.contacts_binary > 0.6;
        // Bones keep their length. Hip to ankle is 0.491 of a stature of 1.2 to 2.2 m.
        let leg = (0.5..1.2).contains(&self.leg_m) && self.leg_spread < 0.1;
        u8::from(root) + u8::from(contacts) + u8::from(leg) >= 2
    }

    fn text(&self) -> String {
        format!(
            "root height {:.2}, {:.0} % of the contacts near 0 or 1, legs {:.2} +- {:.0} %",
            self.root_height_m,
            100.0 * self.contacts_binary,
            self.leg_m,
            100.0 * self.leg_spread
        )
    }
}

/// Undoes Mean and Std if the features look normalised or the options name the statistics. Otherwise returns
/// `None`.
fn unnormalised(
    path: &Path,
    values: &[f64],
    options: &LoadOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<Vec<f64>>, ArrayError> {
    let signs = Signs::from_features(values);
    let (mean_path, std_path) = match (&options.mean, &options.std) {
        (Some(mean), Some(std)) => (mean.clone(), std.clone()),
        (None, None) if signs.are_raw() => return Ok(None),
        (None, None) => beside(path)
            .ok_or_else(|| ArrayError::NeedsStatistics { signs: signs.text(), levels: STATISTICS_LEVELS })?,
        _ => return Err(ArrayError::HalfOfStatistics),
    };
    let mean = statistics(&mean_path)?;
    let std = statistics(&std_path)?;
    let undone = values.iter().enumerate().map(|(i, x)| x * std[i % FEATURES] + mean[i % FEATURES]);
    let undone: Vec<f64> = undone.collect();
    let after = Signs::from_features(&undone);
    if !after.are_raw() {
        let (before, after) = (signs.text(), after.text());
        return Err(ArrayError::WrongStatistics { mean: mean_path.display().to_string(), before, after });
    }
    warnings.push(format!("features are normalised ({}): denormalised with {}", signs.text(), mean_path.display()));
    npy::check_numbers(&undone, FEATURES, NUMBER_MAX)?;
    Ok(Some(undone))
}

/// Finds Mean.npy and Std.npy in the file's folder or above.
fn beside(path: &Path) -> Option<(PathBuf, PathBuf)> {
    path.ancestors().skip(1).take(STATISTICS_LEVELS + 1).find_map(|folder| {
        let pair = (folder.join("Mean.npy"), folder.join("Std.npy"));
        (pair.0.is_file() && pair.1.is_file()).then_some(pair)
    })
}

fn statistics(path: &Path) -> Result<Vec<f64>, ArrayError> {
    let name = path.display().to_string();
    let io = |error: std::io::Error| ArrayError::Damaged { cause: error.to_string() };
    let read = || {
        if !std::fs::metadata(path).map_err(io)?.is_file() {
            return Err(ArrayError::Damaged { cause: "is not a regular file".into() });
        }
        let array = npy::read_npy(BufReader::new(File::open(path).map_err(io)?))?;
        if array.squeezed() != [FEATURES] {
            return Err(ArrayError::Shape { found: array.shape, expected: "(263,) statistics of the features" });
        }
        npy::check_numbers(&array.values, FEATURES, NUMBER_MAX)?;
        Ok(array.values)
    };
    read().map_err(|error| error.in_key(&name))
}
