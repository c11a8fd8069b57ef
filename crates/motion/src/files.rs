//! Which files of a folder are motion files.

use crate::MotionError;
use std::path::{Path, PathBuf};

/// Extensions that have a reader, in lower case.
pub const EXTENSIONS: [&str; 4] = ["bvh", "mcap", "npy", "npz"];
/// Deepest folder below the one that is listed; the deepest public data set has 4.
const DEPTH_MAX: usize = 32;

/// What a folder holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Motion files by extension, sorted by path.
    pub files: Vec<PathBuf>,
    /// Files of a readable extension that are known to hold no motion, and why.
    pub skipped: Vec<(PathBuf, &'static str)>,
}

/// The files of `folder` that have a readable extension, sorted by name. Folders inside are left out; so are
/// `Mean.npy`, `Std.npy` and files of body shapes, which hold no motion (see [`list`] for those).
///
/// # Errors
/// Names the folder if it cannot be listed.
pub fn motion_files(folder: &Path) -> Result<Vec<PathBuf>, MotionError> {
    Ok(list(folder, false)?.files)
}

/// As [`motion_files`], with everything below `folder`; links to folders are not followed.
///
/// # Errors
/// Names the folder that cannot be listed.
pub fn motion_files_recursive(folder: &Path) -> Result<Vec<PathBuf>, MotionError> {
    Ok(list(folder, true)?.files)
}

/// Motion files of a folder, and what was left out with the reason.
///
/// # Errors
/// Names the folder that cannot be listed, or lies more than 32 levels deep.
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
        // The entry's own type, so that a link to a folder is not one and no circle is walked.
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

/// Files that the data sets put beside their motions.
fn holds_no_motion(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_str()?.to_ascii_lowercase();
    match name.as_str() {
        "mean.npy" | "std.npy" => Some("statistics for normalised features, not motion"),
        "shape.npz" => Some("the shape of a body, not motion"),
        _ if name.ends_with("_stagei.npz") => Some("the shape of a body, not motion"),
        _ => None,
    }
}
