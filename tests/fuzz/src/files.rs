//! Motion files: BVH, .npy, .npz and .mcap, as whole files through the function that every tool uses.

use crate::bytes::Bytes;
use motion::{Motion, npy};
use std::io::{Cursor, Write};
use std::sync::LazyLock;

/// Keys that the AMASS reader uses.
const KEYS: [&str; 6] = ["poses", "root_orient", "pose_body", "trans", "mocap_framerate", "mocap_frame_rate"];

/// Folder for the inputs as files.
static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a folder"));

/// Tests a BVH, as text and as a file.
pub(crate) fn bvh(input: &[u8]) {
    if let Ok(motion) = motion::parse_bvh("input", input) {
        check(&motion, input.len());
        let written = motion::write_bvh(&motion);
        assert!(!written.is_empty());
    }
}

/// Tests a .npy, as an array alone, and as HumanML3D's positions or features.
pub(crate) fn npy(input: &[u8]) {
    if let Ok(array) = npy::read_npy(input) {
        assert_eq!(array.shape.iter().product::<usize>(), array.values.len());
    }
    load("npy", input);
}

/// Tests a .npz. An input that begins with an `A` is a sequence of (key, length, bytes). The test packs them into
/// an archive first. Otherwise the archive's checksums would stop every change before it reaches the readers.
pub(crate) fn npz(input: &[u8]) {
    match input.split_first() {
        Some((b'A', parts)) => load("npz", &archive(parts)),
        _ => load("npz", input),
    }
}

/// Tests a .mcap. An input that begins with an `A` holds bytes that overwrite skeletons of a good recording.
/// Otherwise a chunk's checksum would stop every change before it reaches the readers.
pub(crate) fn mcap(input: &[u8]) {
    match input.split_first() {
        Some((b'A', changes)) => load("mcap", &crate::seeds::recording(changes)),
        _ => load("mcap", input),
    }
}

fn archive(parts: &[u8]) -> Vec<u8> {
    let mut bytes = Bytes::new(parts);
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for key in KEYS {
        let length = usize::from(bytes.u16());
        if length > 0 {
            writer.start_file(format!("{key}.npy"), stored).expect("an entry");
            writer.write_all(bytes.take(length)).expect("into memory");
        }
    }
    writer.finish().expect("an archive").into_inner()
}

/// Loads the bytes as a file with this extension, through [`motion::load`].
fn load(extension: &str, bytes: &[u8]) {
    // Each thread uses its own file name.
    let path = FOLDER.path().join(format!("{:?}.{extension}", std::thread::current().id()));
    std::fs::write(&path, bytes).expect("a file in a folder of its own");
    match motion::load(&path) {
        Ok(motion) => check(&motion, usize::MAX),
        Err(error) => assert!(error.to_string().contains(&path.display().to_string()), "names no file: {error}"),
    }
}

/// Invariants of every motion that is read.
fn check(motion: &Motion, bytes: usize) {
    let [low, high] = motion::FRAME_RATE_HZ;
    assert!((low..=high).contains(&motion.frame_rate_hz), "{} Hz", motion.frame_rate_hz);
    assert!(motion.frames.len() <= bytes, "more frames than bytes");
    for frame in motion.frames.iter().chain(&motion.first) {
        assert!(frame.positions.iter().flatten().all(|x| x.is_finite()), "{:?}", frame.positions);
        for rotation in frame.rotations {
            let norm = rotation.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
            assert!((norm - 1.0).abs() < 1e-3, "{rotation:?}");
        }
    }
}
