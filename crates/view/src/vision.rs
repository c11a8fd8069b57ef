//! The files with which a page finds a person in a webcam's image: the library of MediaPipe, and the user's model.
//! None of them is part of this repository. A page may read these files and no other ones.

use crate::look::LookError;
use crate::meshes::{MESH_BYTES_MAX, MeshFile};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Folder in which npm places the library, below the repository.
pub const VISION_FOLDER: &str = "tools/camera/node_modules/@mediapipe/tasks-vision";
/// Command that installs the library, with its hash checked.
const INSTALL: &str = "npm ci --prefix tools/camera";
/// Files of the library, and their MIME types.
const LIBRARY: [(&str, &str); 3] = [
    ("vision_bundle.mjs", "text/javascript; charset=utf-8"),
    ("wasm/vision_wasm_module_internal.js", "text/javascript; charset=utf-8"),
    ("wasm/vision_wasm_module_internal.wasm", "application/wasm"),
];
/// Name of the model in the page's address.
const MODEL: &str = "model.task";
/// First bytes of a model. A `.task` file is a zip archive.
const ARCHIVE: [u8; 2] = *b"PK";

/// The library and the model.
#[derive(Debug)]
pub struct VisionFiles {
    folder: PathBuf,
    model: PathBuf,
}

impl VisionFiles {
    /// Checks that every file is there.
    ///
    /// # Errors
    /// Returns an error that names the first missing file, and says how to get it.
    pub fn open(folder: &Path, model: &Path) -> Result<Self, LookError> {
        let failed = |file: &Path, cause: String| LookError::Read { file: file.display().to_string(), cause };
        let mut start = [0; ARCHIVE.len()];
        let read = opened(model).and_then(|mut found| found.file.read_exact(&mut start).map_err(|_| "it is empty"));
        read.map_err(|why| {
            let get = "download a pose landmarker (pose_landmarker_lite.task or pose_landmarker_full.task) from MediaPipe's makers";
            failed(model, format!("--camera: {why}; {get}"))
        })?;
        if start != ARCHIVE {
            return Err(failed(model, "--camera: not a .task file; it must be a pose landmarker of MediaPipe".into()));
        }
        for (name, _) in LIBRARY {
            let file = folder.join(name);
            let get = || format!("`{INSTALL}` in the repository installs it; --vision names another folder");
            opened(&file).map_err(|why| failed(&file, format!("--vision: {why}; {}", get())))?;
        }
        Ok(Self { folder: folder.to_path_buf(), model: model.to_path_buf() })
    }

    /// Opens a file for a page, by its name in the address.
    ///
    /// # Errors
    /// Returns the reason if no file of this name is served, or if the file is gone.
    pub fn read(&self, name: &str) -> Result<MeshFile, &'static str> {
        if name == MODEL {
            return opened(&self.model);
        }
        let (name, kind) = *LIBRARY.iter().find(|(own, _)| *own == name).ok_or("no such file of the camera")?;
        Ok(MeshFile { kind, ..opened(&self.folder.join(name))? })
    }
}

fn opened(path: &Path) -> Result<MeshFile, &'static str> {
    // Asked before it is opened, because a pipe would block.
    if !path.metadata().map_err(|_| "no such file")?.is_file() {
        return Err("it is no file");
    }
    let file = File::open(path).map_err(|_| "the file cannot be read")?;
    let bytes = file.metadata().map_err(|_| "the file cannot be read")?.len();
    if bytes > MESH_BYTES_MAX {
        return Err("larger than 64 MiB");
    }
    Ok(MeshFile { file, bytes, kind: "application/octet-stream" })
}
