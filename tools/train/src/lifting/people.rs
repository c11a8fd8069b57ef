//! Reads what `tools/camera/render` writes: people of motion capture, and images with what a landmarker found in them.

use crate::files::unreadable;
use layouts::{ImagePoints, POINTS};
use motion::npy::{Array, Npz};
use nalgebra::Vector3;
use rt::{Exit, Failure};
use std::fmt::Display;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Positions of the points of one person, m.
pub type Body = [Vector3<f64>; POINTS];

/// Landmarks of MediaPipe that are points of `layouts::Point`, in its order.
pub const LANDMARK: [usize; POINTS] = {
    let mut all = [0, 2, 5, 7, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let mut point = 5;
    while point < POINTS {
        all[point] = point + 6;
        point += 1;
    }
    all
};
/// Landmarks of MediaPipe.
const LANDMARKS: usize = 33;

/// People of motion capture, in the world: m, y up.
#[derive(Clone, Debug)]
pub struct People {
    points: Vec<[[f32; 3]; POINTS]>,
    /// Sums of the takes' weights up to each take, with its first frame and its length.
    takes: Vec<(f64, usize, usize)>,
}

impl People {
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let mut arrays = Arrays::open(path)?;
        let points = arrays.take("points", &[LANDMARKS, 3])?;
        let mut column = |key: &str| arrays.take(key, &[]).map(|array| array.values);
        let (first, length, weight) = (column("first")?, column("length")?, column("weight")?);
        let takes = first.iter().zip(length).zip(weight);
        let takes: Vec<_> = takes.map(|((first, length), weight)| (weight, *first as usize, length as usize)).collect();
        let points: Vec<_> = points.values.chunks_exact(3 * LANDMARKS).map(body).collect();
        if takes.iter().any(|(_, first, length)| *length == 0 || first + length > points.len()) || takes.is_empty() {
            return Err(refused(path, "first and length are no takes of points"));
        }
        Ok(Self::new(points, takes))
    }

    /// Takes of these bodies: weight, first frame and length of each.
    pub fn new(bodies: Vec<Body>, takes: Vec<(f64, usize, usize)>) -> Self {
        let mut sum = 0.0;
        let takes = takes.into_iter().map(|(weight, first, length)| {
            sum += weight * length as f64;
            (sum, first, length)
        });
        let takes = takes.collect();
        Self { points: bodies.into_iter().map(|body| body.map(|p| p.map(|x| x as f32).into())).collect(), takes }
    }

    pub fn frames(&self) -> usize {
        self.points.len()
    }

    /// Returns the frame at a share of all weighted frames, from 0 to 1.
    pub fn at(&self, share: f64) -> Body {
        let total = self.takes.last().map_or(0.0, |take| take.0);
        let take = self.takes.partition_point(|take| take.0 <= share * total).min(self.takes.len() - 1);
        let (end, first, length) = self.takes[take];
        let start = take.checked_sub(1).map_or(0.0, |before| self.takes[before].0);
        let within = ((share * total - start) / (end - start) * length as f64) as usize;
        self.points[first + within.min(length - 1)].map(|p| Vector3::from(p.map(f64::from)))
    }
}

/// One image of a person whose joints are known.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Points in the camera's axes, m: x right, y down, z away.
    pub truth: Body,
    /// The same, projected into the image.
    pub projected: [[f64; 2]; POINTS],
    /// The landmarker's points.
    pub found: ImagePoints,
    /// The landmarker's own points in space, m.
    pub world: Body,
}

impl Pair {
    /// An image of a body 3 m before the camera, whose points were found where they are. The body is in the world: m, y up.
    pub fn seen_well(body: &Body) -> Self {
        let truth = body.map(|p| Vector3::new(p.x, 1.0 - p.y, 3.0 - p.z));
        let projected = truth.map(|p| [p.x / p.z, p.y / p.z]);
        let found = ImagePoints { points: projected.map(|p| p.map(|x| x as f32)), seen: [1.0; POINTS] };
        Self { truth, projected, found, world: truth }
    }
}

/// Images of several clips, those without a person left out.
#[derive(Clone, Debug)]
pub struct Pairs {
    pub clips: Vec<(String, Vec<Pair>)>,
}

impl Pairs {
    pub fn read(folder: &Path) -> Result<Self, Failure> {
        let files = Recorded::all(folder)?.into_iter().map(|file| (file.name.clone(), file.pairs()));
        let pairs = Self { clips: files.collect() };
        if pairs.len() == 0 {
            return Err(refused(folder, "no image of a person in its .npz files"));
        }
        Ok(pairs)
    }

    /// Number of images.
    #[allow(clippy::len_without_is_empty, reason = "read refuses a folder without images")]
    pub fn len(&self) -> usize {
        self.clips.iter().map(|(_, pairs)| pairs.len()).sum()
    }
}

/// One file of `tools/camera/render`: a person's joints, and what a landmarker found in each image.
#[derive(Clone, Debug)]
pub struct Recorded {
    pub name: String,
    pub rate_hz: f64,
    focal: f64,
    truth: Array,
    world: Array,
    image: Array,
    seen: Array,
}

/// Rates of a video that can be read.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

impl Recorded {
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let mut arrays = Arrays::open(path)?;
        let one = |array: Array| array.values.first().copied().unwrap_or_default();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let [truth, world] = ["truth", "world"].map(|key| arrays.take(key, &[LANDMARKS, 3]));
        let (truth, world) = (truth?, world?);
        let (image, seen) = (arrays.take("image", &[LANDMARKS, 2])?, arrays.take("seen", &[LANDMARKS])?);
        let (focal, rate_hz) = (one(arrays.take("focal", &[])?), one(arrays.take("rate_hz", &[])?));
        let rows = truth.shape[0];
        if [&world, &image, &seen].iter().any(|array| array.shape[0] != rows)
            || !(focal > 0.0 && RATES_HZ.contains(&rate_hz))
            || rows < 2
        {
            let reason = "needs arrays of one length, 2 images at least, a positive focal, and rate_hz from 1 to 1000";
            return Err(refused(path, reason));
        }
        Ok(Self { name, rate_hz, focal, truth, world, image, seen })
    }

    /// Reads all files of a folder, by name.
    pub fn all(folder: &Path) -> Result<Vec<Self>, Failure> {
        let entries = std::fs::read_dir(folder).map_err(|error| unreadable(folder, &error))?.filter_map(Result::ok);
        let mut files: Vec<_> = entries.map(|entry| entry.path()).collect();
        files.retain(|path| path.extension().is_some_and(|extension| extension == "npz"));
        files.sort();
        if files.is_empty() {
            return Err(refused(folder, "no .npz file there: `tools/camera/render` writes them"));
        }
        files.iter().map(|path| Self::read(path)).collect()
    }

    pub fn images(&self) -> usize {
        self.truth.shape[0]
    }

    fn row<const N: usize>(array: &Array, i: usize) -> Vec<[f32; N]> {
        let row = &array.values[i * LANDMARKS * N..(i + 1) * LANDMARKS * N];
        row.as_chunks::<N>().0.iter().map(|values| values.map(|value| value as f32)).collect()
    }

    /// The landmarks' true places in the camera's axes, m.
    pub fn truth(&self, i: usize) -> Vec<[f32; 3]> {
        Self::row(&self.truth, i)
    }

    /// Landmarks that were found in an image: in the world, in the image, and their visibilities. `None` for nobody.
    #[allow(clippy::type_complexity, reason = "three arrays of a file")]
    pub fn found(&self, i: usize) -> Option<(Vec<[f32; 3]>, Vec<[f32; 2]>, Vec<f32>)> {
        let (world, image) = (Self::row::<3>(&self.world, i), Self::row::<2>(&self.image, i));
        let seen = Self::row::<1>(&self.seen, i).into_iter().map(|[seen]| seen).collect();
        image[0][0].is_finite().then_some((world, image, seen))
    }

    /// The images that show somebody.
    pub fn pairs(&self) -> Vec<Pair> {
        let pair = |i: usize| {
            let (world, image, seen) = self.found(i)?;
            let wide = |rows: &[[f32; 3]]| LANDMARK.map(|n| Vector3::from(rows[n].map(f64::from)));
            let truth = wide(&self.truth(i));
            let projected = truth.map(|p| [self.focal * p.x / p.z, self.focal * p.y / p.z]);
            let found = ImagePoints { points: LANDMARK.map(|n| image[n]), seen: LANDMARK.map(|n| seen[n]) };
            Some(Pair { truth, projected, found, world: wide(&world) })
        };
        (0..self.images()).filter_map(pair).collect()
    }

    /// Mean turn of the shoulders to the camera, degrees.
    pub fn turned_deg(&self) -> f64 {
        let turned = |i: usize| {
            let truth = self.truth(i);
            let [left, right] = [11, 12].map(|n: usize| Vector3::from(truth[n].map(f64::from)));
            let across = left - right;
            across.z.atan2(across.x).abs().to_degrees()
        };
        (0..self.images()).map(turned).sum::<f64>() / self.images().max(1) as f64
    }
}

fn body(row: &[f64]) -> Body {
    LANDMARK.map(|n| Vector3::new(row[3 * n], row[3 * n + 1], row[3 * n + 2]))
}

fn refused(path: &Path, reason: impl Display) -> Failure {
    Failure::new(Exit::DataErr, format!("{}: {reason}", path.display()))
}

/// The arrays of one file.
struct Arrays<'a> {
    path: &'a Path,
    file: Npz<BufReader<File>>,
}

impl<'a> Arrays<'a> {
    fn open(path: &'a Path) -> Result<Self, Failure> {
        let file = BufReader::new(File::open(path).map_err(|error| unreadable(path, &error))?);
        Ok(Self { path, file: Npz::open(file).map_err(|error| refused(path, error))? })
    }

    /// Reads an array whose rows have this shape.
    fn take(&mut self, key: &str, row: &[usize]) -> Result<Array, Failure> {
        let array = self.file.read(key).map_err(|error| refused(self.path, error))?;
        let lacks = || refused(self.path, format!("has no {key}: `tools/camera/render` writes it"));
        let array = array.ok_or_else(lacks)?;
        if array.shape.get(1..).unwrap_or_default() != row {
            let reason = format!("{key} has shape {:?}, its rows must have {row:?}", array.shape);
            return Err(refused(self.path, reason));
        }
        Ok(array)
    }
}
