//! `teleopd robot new`: the first robot file of a robot.

use crate::cli::RobotFile;
use rt::{Exit, Failure, out};
use std::io::Write;
use std::path::{Path, PathBuf};

pub fn run(RobotFile::New { urdf, out }: &RobotFile) -> Result<Exit, Failure> {
    let name = urdf.file_name().unwrap_or_default().to_string_lossy();
    let draft = robot::draft(&name, &read(urdf)?).map_err(Failure::with(Exit::DataErr))?;
    let out: PathBuf = out.clone().unwrap_or_else(|| urdf.with_extension("toml"));
    create(&out, &draft.toml)?;
    out!("wrote {}", out.display());
    let refused = !draft.refusals.is_empty();
    for (title, notes) in [
        ("Found or guessed:", &draft.guesses),
        ("Decide before the robot moves:", &draft.decisions),
        ("Refused until it is corrected, here or in the URDF:", &draft.refusals),
    ] {
        if notes.is_empty() {
            continue;
        }
        out!("\n{title}");
        for note in notes {
            out!("  - {note}");
        }
    }
    let (urdf, file) = (urdf.display(), out.display());
    out!(
        "\n{}: {} fit --urdf {urdf} --robot {file} --out NEW.toml, with --meshes DIR if the URDF names meshes",
        if refused { "Then" } else { "Next" },
        crate::programs::COLLISION.typed()
    );
    Ok(if refused { Exit::DataErr } else { Exit::Ok })
}

fn read(file: &Path) -> Result<String, Failure> {
    config::read_text(file).map_err(Failure::with(Exit::NoInput))
}

/// Writes a new file. A file that exists may hold a person's work, so it stays.
fn create(file: &Path, text: &str) -> Result<(), Failure> {
    let created = std::fs::File::create_new(file).and_then(|mut file| file.write_all(text.as_bytes()));
    created.map_err(|error| Failure::unwritable(file, &error))
}
