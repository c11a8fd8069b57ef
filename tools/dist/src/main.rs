//! Writes what a package needs beside the binaries: man pages and completions from the definitions of the command lines,
//! the settings with the package's paths, and the notices of the libraries that are linked in.

mod commands;
mod notices;

use clap::Parser;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// EX_CANTCREAT of sysexits(3).
const EX_CANTCREAT: u8 = 73;

/// Writes man pages, completions, settings and notices for a package.
#[derive(Debug, Parser)]
#[command(name = "dist", version, about)]
struct Cli {
    /// Folder to write to; the package's table of files names this one.
    #[arg(long, value_name = "DIR", default_value = "target/dist")]
    out: PathBuf,
}

fn main() -> ExitCode {
    let out = Cli::parse().out;
    match write(&out) {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("dist: {text}");
            ExitCode::from(EX_CANTCREAT)
        }
    }
}

fn write(out: &Path) -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    commands::write(out)?;
    let settings = root.join("config/teleop.toml");
    let text = std::fs::read_to_string(&settings).map_err(|error| format!("{}: {error}", settings.display()))?;
    save(&out.join("teleop.toml"), &packaged_settings(&text)?)?;
    save(&out.join("third-party.txt"), &notices::collect(&root)?)?;
    println!("wrote {}", out.display());
    Ok(())
}

fn save(path: &Path, text: &str) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(path, text))
        .map_err(|error| format!("{}: {error}", path.display()))
}

/// The paths of config/teleop.toml that point into the repository, and where the package has the same files. Settings may be
/// copied to any folder then.
const PATHS: [(&str, &str); 4] = [
    ("\"robots/", "\"/usr/share/teleopd/robots/"),
    ("\"../weights/tiago_dual\"", "\"/usr/share/teleopd/weights/tiago_dual\""),
    ("\"../weights/prediction\"", "\"/usr/share/teleopd/weights/prediction\""),
    // An example in a comment.
    ("\"skeletons/", "\"/usr/share/teleopd/skeletons/"),
];

/// The settings with the package's paths; each path must stand in the text exactly once.
fn packaged_settings(text: &str) -> Result<String, String> {
    let mut packaged = text.replace("  # relative to this file", "  # or relative to this file");
    for (here, there) in PATHS {
        let count = packaged.matches(here).count();
        if count != 1 {
            return Err(format!("config/teleop.toml: {here}...\" stands there {count} times, not once"));
        }
        packaged = packaged.replace(here, there);
    }
    Ok(packaged)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> String {
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/teleop.toml")).expect("settings")
    }

    #[test]
    fn packaged_settings_differ_in_three_paths_and_in_nothing_else() {
        let packaged = packaged_settings(&settings()).expect("settings");
        let mut read = pipeline::Settings::parse("packaged", &packaged).expect("settings that are accepted");
        let here = pipeline::Settings::parse("here", &settings()).expect("settings that are accepted");
        assert_eq!(read.robot.file, "/usr/share/teleopd/robots/tiago_dual.toml");
        assert_eq!(read.weights.file, "/usr/share/teleopd/weights/tiago_dual");
        assert!(packaged.contains("\"/usr/share/teleopd/skeletons/zed_body_38.toml\""));
        assert_eq!(read.retarget.prediction, "/usr/share/teleopd/weights/prediction");
        read.retarget.prediction.clone_from(&here.retarget.prediction);
        (read.robot.file, read.weights.file) = (here.robot.file.clone(), here.weights.file.clone());
        assert_eq!(format!("{read:?}"), format!("{here:?}"));
    }

    #[test]
    fn a_path_that_is_missing_or_twice_is_an_error() {
        let text = settings();
        assert!(packaged_settings(&text.replace("../weights/", "weights/")).unwrap_err().contains("0 times"));
        assert!(packaged_settings(&format!("{text}# \"robots/x\"\n")).unwrap_err().contains("2 times"));
    }
}
