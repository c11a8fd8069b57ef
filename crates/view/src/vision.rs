//! The files with which a page finds a person in a webcam's image: the library of MediaPipe, and the model.
//! None of them is part of this repository. A page may read these files and no other ones.

use crate::landmarker::{INSTALL, Landmarker};
use crate::look::LookError;
use crate::meshes::{MESH_BYTES_MAX, MeshFile};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Folder in which npm places the library, below the repository.
pub const VISION_FOLDER: &str = "tools/camera/node_modules/@mediapipe/tasks-vision";
/// Files of the library, and their MIME types.
const LIBRARY: [(&str, &str); 3] = [
    ("vision_bundle.mjs", "text/javascript; charset=utf-8"),
    ("wasm/vision_wasm_module_internal.js", "text/javascript; charset=utf-8"),
    ("wasm/vision_wasm_module_internal.wasm", "application/wasm"),
];
/// Name of the model in the page's address.
const MODEL: &str = "model.task";
/// First bytes of a model. A `.task` file is a zip archive.
const ARCHIVE: &[u8] = b"PK";
/// Files in a pose landmarker, which the library names where one is missing. Their names stand in the zip archive's
/// directory, at its end.
const IN_MODEL: [&str; 2] = ["pose_detector.tflite", "pose_landmarks_detector.tflite"];
/// Bytes at the end of a zip archive that hold its directory: twice the longest comment after it, 64 KiB.
const DIRECTORY_BYTES: u64 = 128 << 10;
/// How to name another folder than npm's.
const ELSEWHERE: &str = "--vision names another folder";
/// How to get a model.
const MAKE: &str = "--camera full makes one of the networks that npm installed, and --camera lite a quicker one";

/// The library and the model.
#[derive(Debug)]
pub struct VisionFiles {
    folder: PathBuf,
    model: PathBuf,
}

impl VisionFiles {
    /// Checks that every file is there. The error names the first missing one, and says how to get it. The model is the
    /// name of a [`Landmarker`], whose networks lie beside the library, or a file.
    pub fn open(folder: &Path, model: &Path) -> Result<Self, LookError> {
        let failed = |file: &Path, cause: String| LookError::Read { file: file.display().to_string(), cause };
        let named = Landmarker::ALL.into_iter().find(|landmarker| model == Path::new(landmarker.name()));
        let model = match named {
            // The library's folder lies two folders below `node_modules`.
            Some(landmarker) => landmarker
                .file(&folder.join("../.."))
                .map_err(|(file, why)| failed(&file, format!("--camera {}: {why}; {ELSEWHERE}", landmarker.name())))?,
            None => model.to_path_buf(),
        };
        check_model(&model).map_err(|why| failed(&model, format!("--camera: {why}; {MAKE}")))?;
        for (name, _) in LIBRARY {
            let file = folder.join(name);
            let get = || format!("`{INSTALL}` in the repository installs it; {ELSEWHERE}");
            opened(&file).map_err(|why| failed(&file, format!("--vision: {why}; {}", get())))?;
        }
        Ok(Self { folder: folder.to_path_buf(), model })
    }

    /// Opens a file for a page, by its name in the address.
    pub fn read(&self, name: &str) -> Result<MeshFile, &'static str> {
        if name == MODEL {
            return opened(&self.model);
        }
        let (name, kind) = *LIBRARY.iter().find(|(own, _)| *own == name).ok_or("no such file of the camera")?;
        Ok(MeshFile { kind, ..opened(&self.folder.join(name))? })
    }
}

/// Refuses a model that the library would refuse in the page.
fn check_model(model: &Path) -> Result<(), String> {
    let MeshFile { mut file, bytes, .. } = opened(model)?;
    let (mut start, mut end) = (Vec::new(), Vec::new());
    let read = file.by_ref().take(ARCHIVE.len() as u64).read_to_end(&mut start);
    let read = read.and_then(|_| file.seek(SeekFrom::Start(bytes.saturating_sub(DIRECTORY_BYTES))));
    let read = read.and_then(|_| file.take(DIRECTORY_BYTES).read_to_end(&mut end));
    read.map_err(|error| error.to_string())?;
    if start != ARCHIVE {
        return Err("it is no .task file, which is a zip archive".into());
    }
    let holds = |name: &&str| end.windows(name.len()).any(|bytes| bytes == name.as_bytes());
    match IN_MODEL.iter().find(|name| !holds(name)) {
        Some(name) => Err(format!("it holds no {name}, so it is no pose landmarker, or only a part of one")),
        None => Ok(()),
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
