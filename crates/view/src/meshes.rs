//! The folder of the user's own meshes. Finds the file for a robot's link, and limits the files that a page may read.

use crate::look::LookError;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Extensions of files that the page draws.
const DRAWN: [&str; 5] = ["dae", "stl", "glb", "gltf", "obj"];
/// Extensions of files that meshes refer to, with their MIME types.
const REFERRED: [(&str, &str); 8] = [
    ("mtl", "text/plain"),
    ("bin", "application/octet-stream"),
    ("png", "image/png"),
    ("jpg", "image/jpeg"),
    ("jpeg", "image/jpeg"),
    ("webp", "image/webp"),
    ("tga", "image/x-tga"),
    ("bmp", "image/bmp"),
];
/// Largest file that is served, bytes. A robot's largest mesh has a third of it. Assumption.
pub const MESH_BYTES_MAX: u64 = 64 << 20;
/// Largest number of files and folders in a scan, and its depth. A workspace of several robots has a tenth of it.
/// Assumption.
const ENTRIES_MAX: usize = 50_000;
const DEPTH_MAX: usize = 16;

/// The folder of meshes.
#[derive(Debug)]
pub struct MeshFolder {
    root: PathBuf,
    /// Paths of the meshes below `root`, split into their parts, sorted.
    files: Vec<Vec<String>>,
}

/// A file that a page may read.
pub struct MeshFile {
    pub file: File,
    /// Length, bytes.
    pub bytes: u64,
    pub kind: &'static str,
}

impl MeshFolder {
    /// Scans a folder.
    pub fn open(folder: &Path) -> Result<Self, LookError> {
        let failed = |cause: String| LookError::Read { file: folder.display().to_string(), cause };
        let root = folder.canonicalize().map_err(|error| failed(format!("--meshes: {error}")))?;
        let (mut files, mut entries) = (Vec::new(), 0);
        let mut waiting = vec![(root.clone(), Vec::new())];
        while let Some((at, parts)) = waiting.pop() {
            // A subfolder that cannot be read counts as empty.
            let read = match std::fs::read_dir(&at) {
                Ok(read) => read,
                Err(error) if parts.is_empty() => return Err(failed(format!("--meshes: {error}"))),
                Err(_) => continue,
            };
            for entry in read.flatten() {
                entries += 1;
                if entries > ENTRIES_MAX {
                    let cause = format!("--meshes: more than {ENTRIES_MAX} files; give the robot's own folder");
                    return Err(failed(cause));
                }
                let Ok(name) = entry.file_name().into_string() else { continue };
                let mut parts: Vec<String> = parts.clone();
                parts.push(name);
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() && parts.len() < DEPTH_MAX => waiting.push((entry.path(), parts)),
                    Ok(kind) if !kind.is_dir() && DRAWN.contains(&extension(&entry.path()).as_str()) => {
                        files.push(parts);
                    }
                    _ => {}
                }
            }
        }
        files.sort();
        Ok(Self { root, files })
    }

    /// Returns the folder's canonical path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the file for a name from a URDF, as a path below the folder. It is the file that shares the most
    /// path parts at the end of the name. `None` if no file has that name.
    pub fn find(&self, name: &str) -> Option<String> {
        let wanted: Vec<&str> = name.rsplit(['/', '\\']).filter(|part| !part.is_empty()).collect();
        let shared = |parts: &[String]| parts.iter().rev().zip(&wanted).take_while(|(a, b)| a == *b).count();
        let found = self.files.iter().map(|parts| (shared(parts), parts)).filter(|(count, _)| *count > 0);
        // If several files share as many parts, the shortest path wins, then the first in the alphabet.
        let best = found.min_by_key(|(count, parts)| (std::cmp::Reverse(*count), parts.len()))?;
        Some(best.1.join("/"))
    }

    /// Returns the file with the name of a link, as a path below the folder. `None` if there is none.
    pub fn find_link(&self, link: &str) -> Option<String> {
        let named = |parts: &&Vec<String>| parts.last().is_some_and(|name| stem(name) == link);
        self.files.iter().filter(named).min_by_key(|parts| parts.len()).map(|parts| parts.join("/"))
    }

    /// Opens a file for a page, by its path below the folder.
    pub fn read(&self, path: &str) -> Result<MeshFile, &'static str> {
        let refused = |part: &str| part.is_empty() || part == "." || part == ".." || part.contains(['\\', '\0', ':']);
        if path.split('/').any(refused) {
            return Err("this path is not allowed");
        }
        let full = self.root.join(path).canonicalize().map_err(|_| "no such mesh")?;
        // A symbolic link may lead out of the folder.
        if !full.starts_with(&self.root) {
            return Err("the path leads out of the folder of meshes");
        }
        let extension = extension(&full);
        let kind = if DRAWN.contains(&extension.as_str()) {
            "application/octet-stream"
        } else {
            let known = REFERRED.iter().find(|(name, _)| *name == extension);
            known.map(|(_, kind)| *kind).ok_or("only meshes and their textures are served")?
        };
        let file = File::open(&full).map_err(|_| "the mesh cannot be read")?;
        let about = file.metadata().map_err(|_| "the mesh cannot be read")?;
        if !about.is_file() || about.len() > MESH_BYTES_MAX {
            return Err("not a file, or larger than 64 MiB");
        }
        Ok(MeshFile { file, bytes: about.len(), kind })
    }
}

fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |extension| extension.to_string_lossy().to_lowercase())
}
