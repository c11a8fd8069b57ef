//! NumPy arrays: the .npy format (NEP 1) and the .npz archive. The reader checks every claim of a file against a
//! bound.
//!
//! It reads only plain numbers. Object arrays are pickles, which can run code when loaded, so it rejects them.

use crate::error::ArrayError;
use half::f16;
use std::io::{Read, Seek, SeekFrom, Write};

/// Most numbers in one array: the largest frame count, with frames as wide as those of SMPL-X. Each number
/// becomes 8 bytes, whatever its type in the file. This bounds the size of an unpacked file.
pub const ARRAY_VALUES_MAX: usize = crate::FRAMES_MAX * 165;
/// Numbers that an array of an archive may have, and those for each byte of the archive in addition. Compression shortens
/// zeros to a thousandth, and a measured number to a few bytes. Assumption: it shortens a number of a still person to a tenth of that.
const PACKED_VALUES: [usize; 2] = [1_500_000, 3];
/// Bytes per read, a multiple of every number's length.
const CHUNK_BYTES: usize = 1 << 16;
/// Longest header. NumPy's own readers accept 10,000 characters, and arrays of plain numbers need about 100.
const HEADER_BYTES_MAX: usize = 10_000;
/// Most dimensions. This is NumPy's own bound.
const DIMENSIONS_MAX: usize = 64;

/// An array of numbers. It is row-major, whatever the order in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each dimension. Empty for a single number.
    pub shape: Vec<usize>,
    /// Values, with the last dimension fastest.
    pub values: Vec<f64>,
}

impl Array {
    /// Returns the shape without dimensions of length one.
    pub fn squeezed(&self) -> Vec<usize> {
        self.shape.iter().copied().filter(|&n| n != 1).collect()
    }
}

/// Contents of a header.
struct Header {
    number: Number,
    big_endian: bool,
    fortran_order: bool,
    shape: Vec<usize>,
}

/// Supported number types.
#[derive(Clone, Copy)]
enum Number {
    Float(usize),
    Signed(usize),
    Unsigned(usize),
}

impl Number {
    fn bytes(self) -> usize {
        match self {
            Self::Float(bytes) | Self::Signed(bytes) | Self::Unsigned(bytes) => bytes,
        }
    }

    /// Returns the value of little-endian bytes, at most 8 of them.
    fn value(self, bytes: &[u8]) -> f64 {
        let mut wide = [0; 8];
        wide[..bytes.len()].copy_from_slice(bytes);
        let unsigned = u64::from_le_bytes(wide);
        match self {
            Self::Float(2) => f16::from_bits(unsigned as u16).to_f64(),
            Self::Float(4) => f64::from(f32::from_bits(unsigned as u32)),
            Self::Float(_) => f64::from_bits(unsigned),
            Self::Signed(bytes) => {
                let shift = 64 - 8 * bytes;
                ((unsigned << shift) as i64 >> shift) as f64
            }
            Self::Unsigned(_) => unsigned as f64,
        }
    }
}

/// Reads a .npy of f16, f32, f64 or integers, either byte order, row- or column-major. Reserves memory only for data
/// that the source delivers. Bytes after the array stay unread.
pub fn read_npy(source: impl Read) -> Result<Array, ArrayError> {
    read_bounded(source, None)
}

/// Like [`read_npy`], for an array of an archive of so many bytes.
fn read_bounded(mut source: impl Read, packed: Option<u64>) -> Result<Array, ArrayError> {
    let header = parse_header(&read_header(&mut source)?)?;
    let bytes = header.number.bytes();
    let too_large = || ArrayError::TooLarge { shape: header.shape.clone(), bound: ARRAY_VALUES_MAX };
    let count = header.shape.iter().try_fold(1usize, |product, &n| product.checked_mul(n)).ok_or_else(too_large)?;
    let count = Some(count).filter(|&count| count <= ARRAY_VALUES_MAX).ok_or_else(too_large)?;
    if let Some(bytes) = packed {
        let bound = PACKED_VALUES[0] + PACKED_VALUES[1] * bytes.min(1 << 40) as usize;
        if count > bound {
            return Err(ArrayError::Packed { shape: header.shape, bound, bytes });
        }
    }
    let claimed = count * bytes;
    let mut values: Vec<f64> = Vec::new();
    let mut raw = Vec::with_capacity(CHUNK_BYTES);
    for at in (0..claimed).step_by(CHUNK_BYTES) {
        let wanted = CHUNK_BYTES.min(claimed - at);
        raw.clear();
        let mut part = source.by_ref().take(wanted as u64);
        part.read_to_end(&mut raw).map_err(|error| ArrayError::Damaged { cause: error.to_string() })?;
        if raw.len() < wanted {
            let found = (at + raw.len()) as u64;
            return Err(ArrayError::Short { shape: header.shape, found, claimed: claimed as u64 });
        }
        if header.big_endian {
            raw.chunks_exact_mut(bytes).for_each(<[u8]>::reverse);
        }
        // Reserves at most as much again as was already read. At most half of the memory is therefore empty.
        values.reserve_exact(if at == 0 { 0 } else { values.len().min(count - values.len()) });
        values.extend(raw.chunks_exact(bytes).map(|chunk| header.number.value(chunk)));
    }
    if header.fortran_order && header.shape.iter().filter(|&&n| n != 1).count() > 1 {
        values = row_major(&values, &header.shape);
    }
    Ok(Array { shape: header.shape, values })
}

fn read_header(source: &mut impl Read) -> Result<Vec<u8>, ArrayError> {
    let mut start = [0; 10];
    source.read_exact(&mut start).map_err(|_| ArrayError::NotNpy)?;
    let [magic @ .., major, _, low, high] = start;
    if &magic != b"\x93NUMPY" {
        return Err(ArrayError::NotNpy);
    }
    let mut length = usize::from(low) | usize::from(high) << 8;
    if major > 1 {
        let mut rest = [0; 2];
        source.read_exact(&mut rest).map_err(|_| ArrayError::NotNpy)?;
        length |= usize::from(rest[0]) << 16 | usize::from(rest[1]) << 24;
    }
    if length > HEADER_BYTES_MAX || !(1..=3).contains(&major) {
        let cause = format!("version {major} with a header of {length} bytes, at most {HEADER_BYTES_MAX} are allowed");
        return Err(ArrayError::Header { cause });
    }
    let mut header = vec![0; length];
    source.read_exact(&mut header).map_err(|_| ArrayError::Header { cause: "the file ends within it".into() })?;
    Ok(header)
}

/// Parses the three keys of the dictionary that NumPy writes, `{'descr': '<f4', 'fortran_order': False, 'shape':
/// (2, 3), }`.
fn parse_header(text: &[u8]) -> Result<Header, ArrayError> {
    let text = String::from_utf8_lossy(text);
    let value = |key: &'static str| {
        let after = [format!("'{key}':"), format!("\"{key}\":")].iter().find_map(|k| text.split_once(k.as_str()));
        after.map(|(_, rest)| rest.trim_start()).ok_or_else(|| ArrayError::Header { cause: format!("no {key}") })
    };
    let (number, big_endian) = parse_type(value("descr")?)?;
    let fortran_order = value("fortran_order")?.starts_with("True");
    let shape = value("shape")?;
    let bad = || ArrayError::Header { cause: "shape is not a tuple of lengths".into() };
    let inside = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or_else(bad)?.0;
    let lengths = inside.split(',').map(str::trim).filter(|length| !length.is_empty());
    let shape = lengths.map(|n| n.trim_end_matches('L').parse::<usize>().map_err(|_| bad()));
    let shape = shape.take(DIMENSIONS_MAX + 1).collect::<Result<Vec<_>, _>>()?;
    if shape.len() > DIMENSIONS_MAX {
        return Err(bad());
    }
    Ok(Header { number, big_endian, fortran_order, shape })
}

/// Parses a type such as `'<f4'`: byte order, kind, bytes.
fn parse_type(descr: &str) -> Result<(Number, bool), ArrayError> {
    let quoted = descr.chars().next().filter(|&quote| quote == '\'' || quote == '"');
    let inside = quoted.and_then(|quote| descr[1..].split_once(quote)).map(|(inside, _)| inside);
    let refuse = || ArrayError::Type { found: inside.unwrap_or(descr).chars().take(40).collect() };
    let inside = inside.ok_or_else(refuse)?;
    let order = inside.chars().next().filter(|order| "<>=|".contains(*order));
    let number = match &inside[usize::from(order.is_some())..] {
        "f2" => Number::Float(2),
        "f4" => Number::Float(4),
        "f8" => Number::Float(8),
        "i1" => Number::Signed(1),
        "i2" => Number::Signed(2),
        "i4" => Number::Signed(4),
        "i8" => Number::Signed(8),
        "u1" => Number::Unsigned(1),
        "u2" => Number::Unsigned(2),
        "u4" => Number::Unsigned(4),
        "u8" => Number::Unsigned(8),
        _ => return Err(refuse()),
    };
    Ok((number, order == Some('>')))
}

/// Reorders column-major values (the first dimension fastest) to row-major.
pub(crate) fn row_major(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let strides: Vec<usize> = shape.iter().scan(1, |next, &n| Some(std::mem::replace(next, *next * n))).collect();
    let mut index = vec![0; shape.len()];
    let mut out = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        out.push(values[index.iter().zip(&strides).map(|(i, stride)| i * stride).sum::<usize>()]);
        for d in (0..shape.len()).rev() {
            index[d] += 1;
            if index[d] < shape[d] {
                break;
            }
            index[d] = 0;
        }
    }
    out
}

/// Rejects numbers of rows of this width that are not finite, or larger than `bound`.
pub(crate) fn check_numbers(values: &[f64], width: usize, bound: f64) -> Result<(), ArrayError> {
    let width = width.max(1);
    match values.iter().position(|x| !x.is_finite() || x.abs() > bound) {
        Some(i) => Err(ArrayError::Number { frame: i / width, column: i % width, value: values[i], bound }),
        None => Ok(()),
    }
}

/// An open .npz: a zip archive with one .npy per key.
pub struct Npz<R: Read + Seek> {
    archive: zip::ZipArchive<R>,
    bytes: u64,
}

impl<R: Read + Seek> Npz<R> {
    /// Reads the archive's directory, but no array.
    pub fn open(mut source: R) -> Result<Self, ArrayError> {
        let bytes = source.seek(SeekFrom::End(0)).map_err(|error| ArrayError::Damaged { cause: error.to_string() })?;
        let archive = zip::ZipArchive::new(source).map_err(|error| ArrayError::NotZip { cause: error.to_string() })?;
        Ok(Self { archive, bytes })
    }

    /// Returns the keys in the archive's order, shortened, at most 40.
    pub fn keys(&self) -> Vec<String> {
        let key = |name: &str| name.strip_suffix(".npy").unwrap_or(name).chars().take(40).collect();
        self.archive.file_names().take(40).flatten().map(|name| key(&name)).collect()
    }

    /// Returns the array of this key. `None` if there is no such key.
    pub fn read(&mut self, key: &str) -> Result<Option<Array>, ArrayError> {
        let damaged = |cause: String| ArrayError::Damaged { cause }.in_key(key);
        let packed = Some(self.bytes);
        let mut file = match self.archive.by_name(&format!("{key}.npy")) {
            Ok(file) => file,
            Err(zip::result::ZipError::FileNotFound) => return Ok(None),
            Err(error) => return Err(damaged(error.to_string())),
        };
        let array = read_bounded(&mut file, packed).map_err(|error| error.in_key(key))?;
        // The end of the entry is reached here, so the library compares the archive's checksum.
        match file.read(&mut [0]) {
            Ok(0) => Ok(Some(array)),
            Ok(_) => Err(damaged("more bytes than its shape needs".into())),
            Err(error) => Err(damaged(error.to_string())),
        }
    }
}

/// Writes a .npy header of version 1 for little-endian, row-major numbers. `descr` is `<f8`, `<f4` or `<U12`.
pub fn write_npy_header(mut out: impl Write, descr: &str, shape: &[usize]) -> std::io::Result<()> {
    let lengths: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma. A longer one needs no comma at the end.
    let lengths = if shape.len() == 1 { lengths.trim_end() } else { lengths.trim_end_matches(", ") };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({lengths}), }}");
    // The data begin at a multiple of 64 bytes, after 10 bytes of prefix, the text and the line feed.
    while (text.len() + 11) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let length = u16::try_from(text.len()).map_err(std::io::Error::other)?;
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(text.as_bytes())
}
