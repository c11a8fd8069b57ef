//! `teleopd robot new`: the first robot file of a robot.

use crate::cli::RobotFile;
use rt::{Exit, Failure, out};
use std::io::Write;
use std::path::{Path, PathBuf};

pub fn run(RobotFile::New { urdf, out }: &RobotFile) -> Result<Exit, Failure> {
    let text = config::read_text(urdf).map_err(Failure::with(Exit::NoInput))?;
    let name = urdf.file_name().unwrap_or_default();
    let draft = robot::draft(&name.to_string_lossy(), &text).map_err(Failure::with(Exit::DataErr))?;
    let out: PathBuf = out.clone().unwrap_or_else(|| urdf.with_extension("toml"));
    // A robot file and its URDF lie in the same folder.
    let beside = out.with_file_name(name);
    if !std::fs::read(&beside).is_ok_and(|own| own == text.as_bytes()) {
        create(&beside, &text)?;
        out!("copied {} to {}", urdf.display(), beside.display());
    }
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

/// Writes a new file. A file that exists may hold a person's work, so it stays.
fn create(file: &Path, text: &str) -> Result<(), Failure> {
    let created = std::fs::File::create_new(file).and_then(|mut file| file.write_all(text.as_bytes()));
    created.map_err(|error| Failure::unwritable(file, &error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draft_in_another_folder_has_its_urdf_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/robots/heron.urdf");
        let new = |name: &str| run(&RobotFile::New { urdf: urdf.clone(), out: Some(folder.path().join(name)) });
        new("a.toml").expect("a draft");
        let text = |path: PathBuf| std::fs::read_to_string(path).expect("a file");
        assert_eq!(text(folder.path().join("heron.urdf")), text(urdf.clone()));
        new("b.toml").expect("another draft of the same URDF");
        std::fs::write(folder.path().join("heron.urdf"), "another robot").expect("written");
        let refused = new("c.toml").expect_err("the other URDF stays").text;
        assert!(refused.contains("heron.urdf exists already, and is not replaced"), "{refused}");
    }
}
