//! Plays a motion through all stages in virtual time, and keeps every command.

use super::failed;
use super::run::{RowResult, Shared};
use messages::{JOINTS_MAX, TICK_HZ};
use motion::Motion;
use rt::{Exit, Failure};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;
use world::Uncertified;

/// Returns the commands of a motion and their number, from the robot's start until it is at rest again. `None` if
/// `interrupted` returned true. Those of an hour take 780 MB, so they stand in a file without a name beside `output`.
///
/// # Errors
/// Returns why the robot was stopped or did not engage, or that the folder takes no file.
pub(super) fn commands(
    shared: &Shared<'_>,
    input: &Path,
    output: &Path,
    motion: &Motion,
    interrupted: impl Fn() -> bool,
) -> Result<Option<(usize, impl Iterator<Item = RowResult>)>, Failure> {
    let Some(loaded) = &shared.loaded else { return Ok(None) };
    let place = output.with_extension("rows.part");
    if let Some(folder) = place.parent() {
        std::fs::create_dir_all(folder).map_err(failed(folder, "create the folder"))?;
    }
    // A file that remains of a killed run is not opened: it may be a link.
    let _ = std::fs::remove_file(&place);
    let file =
        File::options().read(true).write(true).create_new(true).open(&place).map_err(failed(&place, "create"))?;
    std::fs::remove_file(&place).map_err(failed(&place, "remove"))?;
    let (mut rows, mut count, joints) = (BufWriter::new(file), 0, loaded.model.count);
    let certified = world::certify(loaded, motion, shared.cli.calibration, 1, |row| {
        if interrupted() {
            return Err(None);
        }
        count += 1;
        let time_s = row.k as f64 / TICK_HZ as f64;
        let mut values = std::iter::once(time_s).chain(row.q[..joints].iter().copied());
        values.try_for_each(|value| rows.write_all(&value.to_le_bytes())).map_err(Some)
    });
    let write = failed(&place, "write");
    match certified {
        Ok(_) => {
            let rows = rows.into_inner().map_err(|error| error.into_error());
            let mut rows = rows.and_then(|mut file| file.rewind().map(|()| BufReader::new(file))).map_err(write)?;
            let read = move |index| {
                let mut row = [[0; 8]; 1 + JOINTS_MAX];
                let bytes = row[..=joints].as_flattened_mut();
                rows.read_exact(bytes).map_err(|_| (index, "cannot be read again from the folder of --out"))?;
                let [time_s, q @ ..] = row.map(f64::from_le_bytes);
                Ok((time_s, q))
            };
            Ok(Some((count, (0..count).map(read))))
        }
        Err(Uncertified::Ended(None)) => Ok(None),
        Err(Uncertified::Ended(Some(error))) => Err(write(error)),
        Err(Uncertified::Settings(error)) => Err(Failure::new(Exit::Config, error)),
        Err(Uncertified::Refused(why)) => Err(Failure::new(Exit::Failed, format!("{}: {why}", input.display()))),
    }
}
