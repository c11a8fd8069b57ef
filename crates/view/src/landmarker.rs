//! Makes a pose landmarker, a `.task` file, of the networks in npm's package `@mediapipe/pose`. A `.task` file is a zip
//! archive of two networks, a detector and the landmarks. MediaPipe's tasks want a metadata record in each, which says how
//! an image becomes numbers. The package's networks lack it.
//!
//! A network is a FlatBuffer: offsets from each pointer to a table further on. So a new root with a longer list of
//! metadata is written before the old bytes, which stay as they are.

use sha2::{Digest, Sha256};
use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// The package, whose version `tools/camera/package-lock.json` pins.
const PACKAGE: &str = "@mediapipe/pose";
/// The detector. It is all that the package's archive of assets holds.
const DETECTOR: &str = "pose_solution_packed_assets.data";
/// Command that installs the package, and the library of the page, with their hashes checked.
pub(crate) const INSTALL: &str = "npm ci --prefix tools/camera";
/// Multiple at which the networks begin in the archive. From elsewhere the runtime copies them.
const ALIGNMENT: usize = 64;

messages::named! {
    /// The pose landmarkers that the package has networks for.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Landmarker {
        /// Quick, and exchanges left and right in one image of fifty.
        Lite => "lite",
        /// Slower, and exchanges them in none.
        Full => "full",
    }
}

impl Landmarker {
    /// SHA-256 of the file that the pinned package gives.
    const fn expected_sha256(self) -> &'static str {
        match self {
            Self::Lite => "65e65eff9bc2a7b9a0468a6c1007767b9c6001ec11971ec4848d5fdfca58370b",
            Self::Full => "1276360dd269b5633a7a4bb9f884f8d41bc834fcbf70e5f72dc85009028d8716",
        }
    }

    /// Returns the landmarker's file. Makes it in the package's folder below `node_modules`, if it is not there yet.
    ///
    /// # Errors
    /// Returns the file at fault, and the cause with its remedy: a network that is missing or another one, a folder that
    /// cannot be written.
    pub fn file(self, node_modules: &Path) -> Result<PathBuf, (PathBuf, String)> {
        self.made(node_modules)
            .map_err(|(file, why)| (file, format!("{why}; `{INSTALL}` in the repository installs it")))
    }

    fn made(self, node_modules: &Path) -> Result<PathBuf, (PathBuf, String)> {
        let package = node_modules.join(PACKAGE);
        let file = package.join(format!("pose_landmarker_{}.task", self.name()));
        if fs::read(&file).is_ok_and(|bytes| sha256(&bytes) == self.expected_sha256()) {
            return Ok(file);
        }
        let read = |name: &str| {
            let path = package.join(name);
            fs::read(&path).map_err(|error| (path, error.to_string()))
        };
        let landmarks = format!("pose_landmark_{}.tflite", self.name());
        let task = task(&read(DETECTOR)?, &read(&landmarks)?).unwrap_or_default();
        let found = sha256(&task);
        if found != self.expected_sha256() {
            return Err((package, format!("they are not the networks of the pinned version: SHA-256 {found}")));
        }
        // A page of another process may read it at this moment.
        let new = file.with_extension("new");
        let written = fs::write(&new, task).and_then(|()| fs::rename(&new, &file));
        written.map(|()| file.clone()).map_err(|error| (file, error.to_string()))
    }
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The archive. `None` if one of both is no network.
fn task(detector: &[u8], landmarks: &[u8]) -> Option<Vec<u8>> {
    // The detector takes colours from -1 to 1, the landmarks' network from 0 to 1.
    let networks = [
        ("pose_detector.tflite", with_metadata(detector, 127.5, 127.5)?),
        ("pose_landmarks_detector.tflite", with_metadata(landmarks, 0.0, 255.0)?),
    ];
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .with_alignment(ALIGNMENT as u16);
    for (name, network) in networks {
        archive.start_file(name, options).ok()?;
        archive.write_all(&network).ok()?;
    }
    Some(archive.finish().ok()?.into_inner())
}

/// Slots of the tables that are read or written, by the schemas of TensorFlow Lite (`Model`, `Metadata`, `Buffer`) and of
/// its metadata (`ModelMetadata`, `SubGraphMetadata`, `TensorMetadata`, `Content`, `ProcessUnit`).
mod slot {
    pub(super) const MODEL_VERSION: usize = 0;
    pub(super) const MODEL_BUFFERS: usize = 4;
    pub(super) const MODEL_METADATA: usize = 6;
    /// Operator codes, graphs, description, buffer of metadata, signatures.
    pub(super) const MODEL_KEPT: [usize; 5] = [1, 2, 3, 5, 7];
    pub(super) const METADATA_NAME: usize = 0;
    pub(super) const METADATA_BUFFER: usize = 1;
    pub(super) const BUFFER_DATA: usize = 0;
    pub(super) const RECORD_GRAPHS: usize = 3;
    pub(super) const GRAPH_INPUTS: usize = 2;
    pub(super) const TENSOR_NAME: usize = 0;
    pub(super) const TENSOR_CONTENT: usize = 3;
    pub(super) const TENSOR_STEPS: usize = 4;
    /// In a union, the slot of the kind. The next one holds the table.
    pub(super) const CONTENT_KIND: usize = 0;
    pub(super) const STEP_KIND: usize = 0;
    pub(super) const IMAGE_COLOURS: usize = 0;
    pub(super) const SCALE_MEAN: usize = 0;
    pub(super) const SCALE_DEVIATION: usize = 1;
}

/// Kind of content of an image.
const IMAGE: u8 = 2;
/// Colours red, green, blue.
const RGB: u8 = 1;
/// Kind of a step that scales: (colour - mean) / deviation.
const SCALE: u8 = 1;

/// The metadata record of a network with one image as its input.
fn record(mean: f32, deviation: f32) -> Vec<u8> {
    use Field::{Byte, To};
    use Node::{Floats, List, Table, Text};
    let content = Table(vec![
        (slot::CONTENT_KIND, Byte(IMAGE)),
        (slot::CONTENT_KIND + 1, To(Table(vec![(slot::IMAGE_COLOURS, Byte(RGB))]))),
    ]);
    let scale = Table(vec![(slot::SCALE_MEAN, To(Floats(mean))), (slot::SCALE_DEVIATION, To(Floats(deviation)))]);
    let step = Table(vec![(slot::STEP_KIND, Byte(SCALE)), (slot::STEP_KIND + 1, To(scale))]);
    let image = Table(vec![
        (slot::TENSOR_NAME, To(Text("image"))),
        (slot::TENSOR_CONTENT, To(content)),
        (slot::TENSOR_STEPS, To(List(vec![step]))),
    ]);
    let graph = Table(vec![(slot::GRAPH_INPUTS, To(List(vec![image])))]);
    written(*b"M001", &Table(vec![(slot::RECORD_GRAPHS, To(List(vec![graph])))]), &[])
}

/// The network with one more metadata record. `None` if it is no network.
fn with_metadata(network: &[u8], mean: f32, deviation: f32) -> Option<Vec<u8>> {
    use Field::{To, Word};
    use Node::{Bytes, List, Old, Table, Text};
    if network.get(4..8)? != b"TFL3" {
        return None;
    }
    let root = target(network, 0)?;
    let record = record(mean, deviation);
    let tables = |slot| field(network, root, slot).map_or(Some(Vec::new()), |at| list(network, target(network, at)?));
    let (mut buffers, mut metadata) = (tables(slot::MODEL_BUFFERS)?, tables(slot::MODEL_METADATA)?);
    metadata.push(Table(vec![
        (slot::METADATA_NAME, To(Text("TFLITE_METADATA"))),
        (slot::METADATA_BUFFER, Word(buffers.len() as u32)),
    ]));
    buffers.push(Table(vec![(slot::BUFFER_DATA, To(Bytes(&record)))]));
    let mut fields = vec![
        (slot::MODEL_VERSION, Word(word(network, field(network, root, slot::MODEL_VERSION)?)?)),
        (slot::MODEL_BUFFERS, To(List(buffers))),
        (slot::MODEL_METADATA, To(List(metadata))),
    ];
    for slot in slot::MODEL_KEPT {
        if let Some(at) = field(network, root, slot) {
            fields.push((slot, To(Old(target(network, at)?))));
        }
    }
    Some(written(*b"TFL3", &Table(fields), network))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// Place that the pointer at this place points at.
fn target(bytes: &[u8], pointer: usize) -> Option<usize> {
    pointer.checked_add(word(bytes, pointer)? as usize)
}

/// Place of a table's field. `None` if the table lacks it.
fn field(bytes: &[u8], table: usize, slot: usize) -> Option<usize> {
    let vtable = table.checked_add_signed(-(word(bytes, table)? as i32 as isize))?;
    let half = |at: usize| Some(usize::from(u16::from_le_bytes(bytes.get(at..at.checked_add(2)?)?.try_into().ok()?)));
    let offset = if 4 + 2 * slot < half(vtable)? { half(vtable + 4 + 2 * slot)? } else { 0 };
    (offset > 0).then_some(table + offset)
}

/// The tables of the list at this place.
fn list(bytes: &[u8], at: usize) -> Option<Vec<Node<'static>>> {
    (1..=word(bytes, at)? as usize).map(|n| Some(Node::Old(target(bytes, at + 4 * n)?))).collect()
}

/// The target of a pointer in a FlatBuffer.
enum Node<'a> {
    /// Slots and their contents.
    Table(Vec<(usize, Field<'a>)>),
    List(Vec<Node<'a>>),
    /// A list of one number.
    Floats(f32),
    Text(&'a str),
    Bytes(&'a [u8]),
    /// Something of the old bytes, at this place there.
    Old(usize),
}

enum Field<'a> {
    Byte(u8),
    Word(u32),
    To(Node<'a>),
}

/// The FlatBuffer of this root, and the old bytes after it.
fn written(kind: [u8; 4], root: &Node<'_>, old: &[u8]) -> Vec<u8> {
    let mut out = vec![0; 4];
    out.extend(kind);
    let mut into_old = Vec::new();
    write(&mut out, 0, root, &mut into_old);
    // The weights of the old network stay at their multiples.
    pad(&mut out, 0, ALIGNMENT);
    let moved = out.len();
    for (pointer, at) in into_old {
        point(&mut out, pointer, moved + at);
    }
    out.extend(old);
    out
}

fn pad(out: &mut Vec<u8>, ahead: usize, multiple: usize) {
    let length = (out.len() + ahead).next_multiple_of(multiple) - ahead;
    out.resize(length, 0);
}

fn point(out: &mut [u8], pointer: usize, at: usize) {
    out[pointer..pointer + 4].copy_from_slice(&((at - pointer) as u32).to_le_bytes());
}

/// Writes a node and everything that it points at, and lets the pointer point at it.
fn write(out: &mut Vec<u8>, pointer: usize, node: &Node<'_>, into_old: &mut Vec<(usize, usize)>) {
    let begin = |out: &mut Vec<u8>, length: usize, multiple: usize| {
        pad(out, 4, multiple);
        let at = out.len();
        point(out, pointer, at);
        out.extend((length as u32).to_le_bytes());
    };
    match node {
        Node::Old(at) => into_old.push((pointer, *at)),
        Node::Floats(number) => {
            begin(out, 1, 4);
            out.extend(number.to_le_bytes());
        }
        Node::Text(text) => {
            begin(out, text.len(), 4);
            out.extend(text.bytes().chain([0]));
        }
        Node::Bytes(bytes) => {
            begin(out, bytes.len(), 16);
            out.extend(*bytes);
        }
        Node::List(nodes) => {
            begin(out, nodes.len(), 4);
            let first = out.len();
            out.resize(first + 4 * nodes.len(), 0);
            for (n, node) in nodes.iter().enumerate() {
                write(out, first + 4 * n, node, into_old);
            }
        }
        Node::Table(fields) => {
            let slots = fields.iter().map(|(slot, _)| slot + 1).max().unwrap_or(0);
            pad(out, 4 + 2 * slots, 4);
            let (vtable, table) = (out.len(), out.len() + 4 + 2 * slots);
            out.resize(table, 0);
            point(out, pointer, table);
            out.extend(((table - vtable) as u32).to_le_bytes());
            for (slot, field) in fields {
                let half = ((out.len() - table) as u16).to_le_bytes();
                out[vtable + 4 + 2 * slot..][..2].copy_from_slice(&half);
                // A byte takes a word's room, so every word stays at a multiple of four.
                out.extend(match field {
                    Field::Byte(byte) => u32::from(*byte).to_le_bytes(),
                    Field::Word(word) => word.to_le_bytes(),
                    Field::To(_) => [0; 4],
                });
            }
            let lengths = [4 + 2 * slots, out.len() - table].map(|length| (length as u16).to_le_bytes());
            out[vtable..vtable + 4].copy_from_slice(lengths.as_flattened());
            for (n, (_, field)) in fields.iter().enumerate() {
                if let Field::To(node) = field {
                    write(out, table + 4 + 4 * n, node, into_old);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Field::{To, Word};
    use Node::{Bytes, List, Table, Text};

    /// The tables of a list in this slot.
    fn tables(bytes: &[u8], table: usize, slot: usize) -> Vec<usize> {
        let at = target(bytes, field(bytes, table, slot).expect("the slot")).expect("a list");
        (1..=word(bytes, at).expect("a length") as usize).map(|n| target(bytes, at + 4 * n).expect("a table")).collect()
    }

    /// The content of the list of bytes, or of the text, in this slot.
    fn content(bytes: &[u8], table: usize, slot: usize) -> &[u8] {
        let at = target(bytes, field(bytes, table, slot).expect("the slot")).expect("a list");
        &bytes[at + 4..][..word(bytes, at).expect("a length") as usize]
    }

    #[test]
    fn network_keeps_what_it_has_and_gets_a_record() {
        let buffer = |bytes| Table(vec![(slot::BUFFER_DATA, To(Bytes(bytes)))]);
        let model = Table(vec![
            (slot::MODEL_VERSION, Word(3)),
            (3, To(Text("a network"))),
            (slot::MODEL_BUFFERS, To(List(vec![buffer(b"weights"), buffer(b"more")]))),
        ]);
        let network = written(*b"TFL3", &model, &[]);
        let made = with_metadata(&network, 0.0, 255.0).expect("a network");
        assert!(made.ends_with(&network) && (made.len() - network.len()).is_multiple_of(ALIGNMENT));
        let root = target(&made, 0).expect("a root");
        assert_eq!(word(&made, field(&made, root, slot::MODEL_VERSION).expect("a version")), Some(3));
        assert_eq!(content(&made, root, 3), b"a network");
        let buffers = tables(&made, root, slot::MODEL_BUFFERS);
        let [weights, more, record] = buffers[..] else { panic!("{buffers:?}") };
        assert_eq!([weights, more].map(|at| content(&made, at, slot::BUFFER_DATA)), [&b"weights"[..], b"more"]);
        let [entry] = tables(&made, root, slot::MODEL_METADATA)[..] else { panic!("one entry") };
        assert_eq!(content(&made, entry, slot::METADATA_NAME), b"TFLITE_METADATA");
        assert_eq!(word(&made, field(&made, entry, slot::METADATA_BUFFER).expect("a buffer")), Some(2));
        let record = content(&made, record, slot::BUFFER_DATA);
        let graph = tables(record, target(record, 0).expect("a root"), slot::RECORD_GRAPHS)[0];
        let image = tables(record, graph, slot::GRAPH_INPUTS)[0];
        let step = tables(record, image, slot::TENSOR_STEPS)[0];
        let scale = target(record, field(record, step, slot::STEP_KIND + 1).expect("a scale")).expect("a table");
        let number = |slot| word(record, target(record, field(record, scale, slot).expect("a list")).expect("one") + 4);
        assert_eq!([slot::SCALE_MEAN, slot::SCALE_DEVIATION].map(number), [0.0, 255.0f32].map(|x| Some(x.to_bits())));
    }

    #[test]
    fn cut_network_is_refused_without_panic() {
        let model =
            Table(vec![(slot::MODEL_VERSION, Word(3)), (slot::MODEL_BUFFERS, To(List(vec![Table(Vec::new())])))]);
        let network = written(*b"TFL3", &model, &[]);
        assert!(with_metadata(&network, 0.0, 1.0).is_some() && with_metadata(b"PK", 0.0, 1.0).is_none());
        let root = target(&network, 0).expect("a root");
        for length in 0..network.len() {
            let made = with_metadata(&network[..length], 0.0, 1.0);
            assert!(made.is_none() || length > root, "{length} bytes");
        }
    }
}
