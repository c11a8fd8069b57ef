//! `teleopd robot new`: the first robot file of a robot.

use crate::cli::RobotFile;
use rt::{Exit, Failure, err, out};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Programs that print the URDF of a xacro. The first one on PATH runs. xacrodoc needs no ROS to find a package.
const EXPANDERS: [&[&str]; 3] = [&["xacrodoc"], &["xacro"], &["uvx", "xacrodoc"]];

pub fn run(RobotFile::New { urdf, xacro, out }: &RobotFile) -> Result<Exit, Failure> {
    let text = config::read_text(urdf).map_err(Failure::with(Exit::NoInput))?;
    if urdf.extension().is_some_and(|ending| ending == "xacro") {
        // a.xacro and a.urdf.xacro become a.urdf, beside the robot file.
        let name = Path::new(urdf.file_stem().unwrap_or_default()).with_extension("urdf");
        let expanded = out.as_ref().unwrap_or(urdf).with_file_name(name);
        create(&expanded, &expand(urdf, xacro)?)?;
        out!("expanded {} to {}", urdf.display(), expanded.display());
        return run(&RobotFile::New { urdf: expanded, xacro: Vec::new(), out: out.clone() });
    } else if !xacro.is_empty() {
        return Err(Failure::new(Exit::Usage, format!("--xacro is for a .xacro, and {} is none", urdf.display())));
    }
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

/// Returns the URDF of a xacro with these arguments. A xacro computes in Python, so only a program in Python knows its meaning.
fn expand(file: &Path, arguments: &[String]) -> Result<String, Failure> {
    let run = |words: &&[&str]| {
        let mut program = Command::new(words[0]);
        // A file of this folder may have the name of an option.
        program.args(&words[1..]).arg(Path::new(".").join(file)).args(arguments).output().ok()
    };
    let Some(done) = EXPANDERS.iter().find_map(run) else {
        let text = "no program on PATH expands a xacro: `pip install xacrodoc` gets one";
        return Err(Failure::new(Exit::Unavailable, format!("{}: {text}", file.display())));
    };
    let printed = String::from_utf8_lossy(&done.stderr);
    if !done.status.success() {
        return Err(Failure::new(Exit::DataErr, format!("{}: {}", file.display(), printed.trim())));
    }
    printed.lines().for_each(|line| err!("{line}"));
    String::from_utf8(done.stdout).map_err(Failure::with(Exit::DataErr))
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
        let new = |name: &str| {
            run(&RobotFile::New { urdf: urdf.clone(), xacro: vec![], out: Some(folder.path().join(name)) })
        };
        new("a.toml").expect("a draft");
        let text = |path: PathBuf| std::fs::read_to_string(path).expect("a file");
        assert_eq!(text(folder.path().join("heron.urdf")), text(urdf.clone()));
        new("b.toml").expect("another draft of the same URDF");
        std::fs::write(folder.path().join("heron.urdf"), "another robot").expect("written");
        let refused = new("c.toml").expect_err("the other URDF stays").text;
        assert!(refused.contains("heron.urdf exists already, and is not replaced"), "{refused}");
    }
}
