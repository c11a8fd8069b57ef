//! Writes the additional files of a package. Man pages and completions come from the definitions of the command
//! lines. It also writes the settings with the package's paths, and the notices of the linked libraries.

mod commands;
mod notices;
mod tarball;
mod wheel;

use clap::Parser;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Writes man pages, completions, settings and notices for a package.
#[derive(Debug, Parser)]
#[command(name = "dist", version, about)]
struct Cli {
    /// Output folder. The package's table of files names this one.
    #[arg(long, value_name = "DIR", default_value = "target/dist")]
    out: PathBuf,
    /// Also write an archive of the programs, which can be unpacked anywhere. They must run with glibc 2.31.
    #[arg(long)]
    tarball: bool,
    /// Also write a wheel for Python with the extension, the programs and their files. They must run with glibc 2.28. It needs
    /// maturin.
    #[arg(long)]
    wheel: bool,
    /// The archive or the wheel is for this machine and those with a glibc that is not older.
    #[arg(long)]
    this_machine: bool,
    /// Folder of the programs in the archive and in the wheel.
    #[arg(long, value_name = "DIR", default_value = "target/release")]
    programs: PathBuf,
}

fn main() -> ExitCode {
    rt::abort_on_panic();
    rt::finish("dist", write(&Cli::parse()).map_err(Failure::with(Exit::CantCreate)))
}

fn write(cli: &Cli) -> Result<(), String> {
    let out = cli.out.as_path();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    commands::write(out)?;
    let settings = root.join("config/teleop.toml");
    let text = std::fs::read_to_string(&settings).map_err(|error| format!("{}: {error}", settings.display()))?;
    save(&out.join("teleop.toml"), &settings_with(&text, "/usr/share/teleopd/")?)?;
    save(&out.join("third-party.txt"), &notices::collect(&root)?)?;
    link(&out.join("links"))?;
    println!("wrote {}", out.display());
    if cli.tarball {
        let archive = tarball::write(&root, &cli.programs, out, &settings_with(&text, "")?, cli.this_machine)?;
        println!("wrote {}", archive.display());
    }
    if cli.wheel {
        let wheel = wheel::write(&root, &cli.programs, out, &settings_with(&text, "")?, cli.this_machine)?;
        println!("wrote {}", wheel.display());
    }
    Ok(())
}

fn save(path: &Path, text: &str) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(path, text))
        .map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes the links to programs. They lead nowhere before they are installed.
fn link(folder: &Path) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(failed)?;
    for name in tarball::LINKS {
        match std::os::unix::fs::symlink(tarball::LINKED, folder.join(name)) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
            made => made.map_err(failed)?,
        }
    }
    Ok(())
}

/// Paths of config/teleop.toml that point into the repository, and their places below the shared folder.
const PATHS: [(&str, &str); 5] = [
    ("\"robots/", "robots/"),
    ("\"../weights/tiago_dual\"", "weights/tiago_dual\""),
    ("\"../weights/prediction\"", "weights/prediction\""),
    ("\"../weights/lifter\"", "weights/lifter\""),
    // An example in a comment.
    ("\"skeletons/", "skeletons/"),
];

/// Returns the settings with paths below `folder`. Each path must occur in the text exactly once. With an
/// absolute folder the settings may be copied anywhere.
fn settings_with(text: &str, folder: &str) -> Result<String, String> {
    let mut packaged = text.to_owned();
    for (here, below) in PATHS {
        let there = &format!("\"{folder}{below}");
        let count = packaged.matches(here).count();
        if count != 1 {
            return Err(format!("config/teleop.toml: {here}...\" occurs {count} times, not once"));
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
    fn packaged_settings_differ_from_the_source_only_in_paths() {
        let packaged = settings_with(&settings(), "/usr/share/teleopd/").expect("settings");
        let mut read = config::Settings::parse("packaged", &packaged).expect("settings that are accepted");
        let here = config::Settings::parse("here", &settings()).expect("settings that are accepted");
        assert_eq!(read.robot.file, "/usr/share/teleopd/robots/tiago_dual.toml");
        assert_eq!(read.weights.file, "/usr/share/teleopd/weights/tiago_dual");
        assert!(packaged.contains("\"/usr/share/teleopd/skeletons/zed_body_38.toml\""));
        assert_eq!(read.retarget.prediction, "/usr/share/teleopd/weights/prediction");
        read.retarget.prediction.clone_from(&here.retarget.prediction);
        assert_eq!(read.ingest.lifter, "/usr/share/teleopd/weights/lifter");
        read.ingest.lifter.clone_from(&here.ingest.lifter);
        (read.robot.file, read.weights.file) = (here.robot.file.clone(), here.weights.file.clone());
        assert_eq!(format!("{read:?}"), format!("{here:?}"));
    }

    #[test]
    fn path_missing_or_repeated_in_settings_is_an_error() {
        let text = settings();
        assert!(settings_with(&text.replace("../weights/", "weights/"), "").unwrap_err().contains("0 times"));
        assert!(settings_with(&format!("{text}# \"robots/x\"\n"), "").unwrap_err().contains("2 times"));
    }
}
