//! Trajectory files. They are written next to their place and then renamed, so that a partial file never appears.

use super::failed;
use super::manifest::sha256_file;
use clap::ValueEnum;
use messages::JOINTS_MAX;
use motion::npy::write_npy_header;
use rt::Failure;
use std::fs::File;
use std::io::{BufWriter, ErrorKind, Seek, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;

messages::named! {
    /// File formats. Their names are the files' extensions.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
    pub enum Format {
        /// `time_s` and a column for each joint. The numbers read back to the same bits.
        #[default]
        Csv => "csv",
        /// NumPy: `q` (N, joints) and `time_s` (N,) as f64, `joints` (names), `frame_rate_hz`.
        Npz => "npz",
    }
}

enum Kind {
    Csv(BufWriter<File>, String),
    Npz(Box<zip::ZipWriter<BufWriter<File>>>, Vec<f64>),
}

/// A file that is being written. It is removed again unless [`Writer::move_in_place`] is reached.
pub(crate) struct Writer {
    place: PathBuf,
    part: PathBuf,
    kind: Option<Kind>,
    rate_hz: f64,
    joint_names: Vec<String>,
}

impl Writer {
    pub(crate) fn create(
        place: &Path,
        format: Format,
        count: usize,
        rate_hz: f64,
        joint_names: &[String],
    ) -> Result<Self, Failure> {
        let folder = place.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(failed(folder, "create the folder"))?;
        let name = place.file_name().unwrap_or_default().to_string_lossy();
        let part = folder.join(format!(".{name}.part"));
        // The folder is locked, so a part of this name is the remainder of a killed run. It is not opened,
        // because it may be a link or a pipe.
        match std::fs::remove_file(&part) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(&part, "remove")(error)),
            _ => {}
        }
        let file = File::create_new(&part).map_err(failed(&part, "create"))?;
        let mut writer =
            Self { place: place.to_path_buf(), part, kind: None, rate_hz, joint_names: joint_names.to_vec() };
        let out = BufWriter::with_capacity(1 << 16, file);
        writer.kind = Some(match format {
            Format::Csv => {
                let mut out = out;
                let header = writeln!(out, "time_s,{}", joint_names.join(","));
                header.map_err(failed(&writer.part, "write"))?;
                Kind::Csv(out, String::new())
            }
            Format::Npz => {
                let mut zip = zip::ZipWriter::new(out);
                let begun = zip.start_file("q.npy", plain()).map_err(std::io::Error::from);
                let begun = begun.and_then(|()| write_npy_header(&mut zip, "<f8", &[count, joint_names.len()]));
                begun.map_err(failed(&writer.part, "write"))?;
                Kind::Npz(Box::new(zip), Vec::new())
            }
        });
        Ok(writer)
    }

    /// Appends a row. Only the robot's own joints are written.
    pub(crate) fn row(&mut self, time_s: f64, q: &[f64; JOINTS_MAX]) -> Result<(), Failure> {
        let q = &q[..self.joint_names.len()];
        let written = match &mut self.kind {
            Some(Kind::Csv(out, line)) => {
                use std::fmt::Write as _;
                line.clear();
                // Writing to a String cannot fail.
                let _ = write!(line, "{time_s}");
                for value in q {
                    let _ = write!(line, ",{value}");
                }
                line.push('\n');
                out.write_all(line.as_bytes())
            }
            Some(Kind::Npz(zip, times)) => {
                times.push(time_s);
                let mut bytes = [0; 8 * JOINTS_MAX];
                for (part, value) in bytes.chunks_exact_mut(8).zip(q) {
                    part.copy_from_slice(&value.to_le_bytes());
                }
                zip.write_all(&bytes[..8 * q.len()])
            }
            None => Ok(()),
        };
        written.map_err(failed(&self.part, "write"))
    }

    /// Ends the file, still next to its place. Returns its SHA-256.
    pub(crate) fn seal(&mut self) -> Result<String, Failure> {
        let ended = match self.kind.take() {
            Some(Kind::Csv(out, _)) => out.into_inner().map_err(|error| error.into_error()),
            Some(Kind::Npz(zip, times)) => end_npz(*zip, &times, self.rate_hz, &self.joint_names),
            None => Err(std::io::Error::other("was ended before")),
        };
        let file = ended.map_err(failed(&self.part, "write"))?;
        // A name must never refer to data that a power cut destroys.
        file.sync_data().map_err(failed(&self.part, "write"))?;
        sha256_file(&self.part)
    }

    pub(crate) fn move_in_place(self) -> Result<(), Failure> {
        std::fs::rename(&self.part, &self.place).map_err(failed(&self.place, "put in place"))
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // After a rename there is no file of this name.
        let _ = std::fs::remove_file(&self.part);
    }
}

/// Options of `numpy.savez`: not compressed, and without a date. So equal results give equal files.
fn plain() -> SimpleFileOptions {
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).large_file(true);
    options.last_modified_time(zip::DateTime::default())
}

fn end_npz(
    mut zip: zip::ZipWriter<BufWriter<File>>,
    times: &[f64],
    rate_hz: f64,
    joint_names: &[String],
) -> std::io::Result<File> {
    entry(&mut zip, "time_s", "<f8", &[times.len()], times.iter().flat_map(|t| t.to_le_bytes()))?;
    entry(&mut zip, "frame_rate_hz", "<f8", &[], rate_hz.to_le_bytes().into_iter())?;
    // NumPy's strings are UTF-32 of one width, padded with zeros.
    let width = joint_names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(1);
    let padded = |name: &String| {
        let characters = name.chars().map(u32::from).chain(std::iter::repeat(0)).take(width);
        characters.flat_map(u32::to_le_bytes).collect::<Vec<u8>>()
    };
    entry(&mut zip, "joints", &format!("<U{width}"), &[joint_names.len()], joint_names.iter().flat_map(padded))?;
    zip.finish().map_err(std::io::Error::from)?.into_inner().map_err(|error| error.into_error())
}

fn entry<W: Write + Seek>(
    zip: &mut zip::ZipWriter<W>,
    key: &str,
    descr: &str,
    shape: &[usize],
    bytes: impl Iterator<Item = u8>,
) -> std::io::Result<()> {
    zip.start_file(format!("{key}.npy"), plain()).map_err(std::io::Error::from)?;
    write_npy_header(&mut *zip, descr, shape)?;
    zip.write_all(&bytes.collect::<Vec<u8>>())
}
