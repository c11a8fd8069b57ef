//! Finds the motion files of a folder.

use crate::MotionError;
use std::path::{Path, PathBuf};

/// Extensions that have a reader, in lower case.
pub const EXTENSIONS: [&str; 4] = ["bvh", "mcap", "npy", "npz"];
/// Largest depth of folders below the listed one. The deepest public data set has 4.
const DEPTH_MAX: usize = 32;

/// Contents of a folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Motion files by extension, sorted by path.
    pub files: Vec<PathBuf>,
    /// Files with a readable extension that are known to hold no motion, each with the reason.
    pub skipped: Vec<(PathBuf, &'static str)>,
}

/// Returns the files of `folder` with a readable extension, sorted by name. Skips subfolders. Also skips
/// `Mean.npy`, `Std.npy` and files of body shapes, which hold no motion (see [`list`] for those).
pub fn motion_files(folder: &Path) -> Result<Vec<PathBuf>, MotionError> {
    Ok(list(folder, false)?.files)
}

/// Lists the motion files of a folder, and the skipped files with the reason. With `recursive` it lists everything
/// below, but does not follow links to folders.
pub fn list(folder: &Path, recursive: bool) -> Result<Listing, MotionError> {
    let mut listing = Listing::default();
    walk(folder, recursive.then_some(DEPTH_MAX), &mut listing)?;
    listing.files.sort();
    listing.skipped.sort();
    Ok(listing)
}

fn walk(folder: &Path, depth: Option<usize>, listing: &mut Listing) -> Result<(), MotionError> {
    let refuse = |source| MotionError::Io { file: folder.display().to_string(), source };
    for entry in std::fs::read_dir(folder).map_err(refuse)? {
        let entry = entry.map_err(refuse)?;
        let path = entry.path();
        // The entry's own type. A link to a folder therefore does not count as a folder, and the walk cannot
        // loop.
        let is_folder = entry.file_type().map_err(refuse)?.is_dir();
        match depth {
            Some(0) if is_folder => return Err(refuse(std::io::Error::other("folders are nested too deeply"))),
            Some(depth) if is_folder => walk(&path, Some(depth - 1), listing)?,
            _ if is_folder || !is_motion_file(&path) => {}
            _ => match holds_no_motion(&path) {
                Some(reason) => listing.skipped.push((path, reason)),
                None => listing.files.push(path),
            },
        }
    }
    Ok(())
}

fn is_motion_file(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Recognises files that the data sets store beside their motions.
fn holds_no_motion(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    match name.as_str() {
        "mean.npy" | "std.npy" => Some("statistics for normalised features, not motion"),
        "shape.npz" => Some("the shape of a body, not motion"),
        _ if name.ends_with("_stagei.npz") => Some("the shape of a body, not motion"),
        _ => None,
    }
}
