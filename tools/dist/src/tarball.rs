//! The programs with all files that they read, as an archive that can be unpacked anywhere. `bin/teleopd` finds
//! `share/teleopd` by its own path.

use flate2::{Compression, write::GzEncoder};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Programs of a build, and their names in the archive.
const PROGRAMS: [(&str, &str); 11] = [
    ("teleopd", "teleopd"),
    ("teleopctl", "teleopctl"),
    ("replay", "teleop-replay"),
    ("latency", "teleop-latency"),
    ("record", "teleop-record"),
    ("teleop-bridge", "teleop-bridge"),
    ("teleopd-ros2", "teleopd-ros2"),
    // For a robot of one's own.
    ("collision", "teleop-collision"),
    ("train", "teleop-train"),
    ("torture", "teleop-torture"),
    ("simulate", "teleop-simulate"),
];

/// Links to `teleop-replay`, with the names that its subcommands had as programs.
pub const LINKS: [&str; 3] = ["teleop-batch", "teleop-keyposes", "teleop-say"];
/// The program that the links lead to, in their folder.
pub const LINKED: &str = "teleop-replay";

/// Folders of the repository, the extensions of the files that are taken, and their destinations.
const FOLDERS: [(&str, &[&str], &str); 6] = [
    ("config/robots", &["toml", "urdf"], "share/teleopd/robots"),
    ("config/skeletons", &["toml"], "share/teleopd/skeletons"),
    ("weights", &["toml", "safetensors"], "share/teleopd/weights"),
    ("tools/replay/motions", &["bvh", "tsv", "txt"], "share/teleopd/motions"),
    ("docs/src", &["md", "webp", "png"], "docs/src"),
    ("docs/results", &["md"], "docs/results"),
];

/// Documents at the root of the repository.
const DOCUMENTS: [&str; 6] =
    ["README.md", "SAFETY.md", "ARCHITECTURE.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"];

/// The oldest glibc with which the archive must run: that of Debian 11 and Ubuntu 20.04.
pub const GLIBC_MAX: Version = [2, 31];

/// A version of glibc: major, minor.
pub type Version = [u32; 2];

/// Writes `teleopd-VERSION-ARCH-linux.tar.gz` into `out`. `programs` is the folder of the programs. `out`
/// already has man pages, completions and notices. With `any_glibc` the programs may need one that is newer than [`GLIBC_MAX`].
pub fn write(root: &Path, programs: &Path, out: &Path, settings: &str, any_glibc: bool) -> Result<PathBuf, String> {
    let name = format!("teleopd-{}-{}-linux", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH);
    let mut files: BTreeMap<String, Content> = BTreeMap::new();
    for (program, as_name) in PROGRAMS {
        let path = programs.join(program);
        refuse_new_glibc(&path, GLIBC_MAX, any_glibc)?;
        files.insert(format!("bin/{as_name}"), Content::Program(path));
    }
    files.extend(LINKS.map(|link| (format!("bin/{link}"), Content::Link(LINKED))));
    for (path, to) in listed(root)? {
        files.insert(to, Content::File(path));
    }
    for folder in ["man", "completions/bash", "completions/zsh", "completions/fish"] {
        for path in files_of(&out.join(folder))? {
            files.insert(format!("share/{folder}/{}", file_name(&path)), Content::File(path));
        }
    }
    files.extend(DOCUMENTS.map(|document| (document.to_owned(), Content::File(root.join(document)))));
    files.insert("third-party.txt".into(), Content::File(out.join("third-party.txt")));
    files.insert("share/teleopd/teleop.toml".into(), Content::Text(settings.to_owned()));
    let path = out.join(format!("{name}.tar.gz"));
    pack(&path, &name, &files).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(path)
}

/// Returns the files of [`FOLDERS`] with their destinations.
fn listed(root: &Path) -> Result<Vec<(PathBuf, String)>, String> {
    let mut all = Vec::new();
    for (folder, endings, to) in FOLDERS {
        for path in files_of(&root.join(folder))? {
            let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or("");
            if endings.contains(&ending) {
                let to = format!("{to}/{}", file_name(&path));
                all.push((path, to));
            }
        }
    }
    Ok(all)
}

/// Returns the files that the programs read, with their destinations.
pub fn data_files(root: &Path) -> Result<Vec<(PathBuf, String)>, String> {
    Ok(listed(root)?.into_iter().filter(|(_, to)| to.starts_with("share/")).collect())
}

enum Content {
    Program(PathBuf),
    File(PathBuf),
    Text(String),
    /// A symbolic link to this file of the same folder.
    Link(&'static str),
}

/// Packs the files. The same files make the same archive, because they are in the order of their names and have
/// no time and no owner.
fn pack(path: &Path, name: &str, files: &BTreeMap<String, Content>) -> std::io::Result<()> {
    let mut archive = tar::Builder::new(GzEncoder::new(File::create(path)?, Compression::default()));
    for (place, content) in files {
        let (bytes, mode) = match content {
            Content::Program(path) => (read(path)?, 0o755),
            Content::File(path) => (read(path)?, 0o644),
            Content::Text(text) => (text.clone().into_bytes(), 0o644),
            Content::Link(_) => (Vec::new(), 0o777),
        };
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(mode);
        let place = format!("{name}/{place}");
        if let Content::Link(to) = content {
            header.set_entry_type(tar::EntryType::Symlink);
            archive.append_link(&mut header, place, to)?;
        } else {
            archive.append_data(&mut header, place, bytes.as_slice())?;
        }
    }
    archive.into_inner()?.finish()?.sync_all()
}

fn read(path: &Path) -> std::io::Result<Vec<u8>> {
    std::fs::read(path).map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

pub fn file_name(path: &Path) -> String {
    path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned())
}

pub fn files_of(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    Ok(entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect())
}

/// Refuses a program that needs a newer glibc than `most`, unless any will do.
pub fn refuse_new_glibc(program: &Path, most: Version, any_glibc: bool) -> Result<(), String> {
    let bytes = std::fs::read(program).map_err(|error| {
        format!("{}: {error}; build it first: cargo build --release --workspace", program.display())
    })?;
    match newest_glibc(&bytes).filter(|needed| *needed > most && !any_glibc) {
        None => Ok(()),
        Some([major, minor]) => Err(format!(
            "{} needs glibc {major}.{minor}, but this must run with {}.{}. Build for that version: pip install \
             ziglang cargo-zigbuild && cargo zigbuild --release --workspace --target {}-unknown-linux-gnu.{}.{}, then \
             give its folder as --programs. Or give --this-machine",
            program.display(),
            most[0],
            most[1],
            std::env::consts::ARCH,
            most[0],
            most[1],
        )),
    }
}

/// Returns the newest version of glibc in a program's table of needed versions, such as `GLIBC_2.31`.
pub fn newest_glibc(program: &[u8]) -> Option<Version> {
    const MARK: &[u8] = b"GLIBC_";
    let found = program.windows(MARK.len()).enumerate().filter(|(_, window)| *window == MARK);
    let versions = found.filter_map(|(at, _)| {
        let rest = &program[at + MARK.len()..];
        let end = rest.iter().position(|byte| *byte == 0)?;
        let (major, minor) = std::str::from_utf8(&rest[..end]).ok()?.split_once('.')?;
        let minor = minor.split('.').next()?;
        Some([major.parse().ok()?, minor.parse().ok()?])
    });
    versions.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_glibc_version_of_a_program_is_found() {
        let program = b"\0GLIBC_2.4\0GLIBC_2.31\0GLIBC_PRIVATE\0GLIBC_2.2.5\0GLIBC_2.30\0";
        assert_eq!(newest_glibc(program), Some([2, 31]));
        assert_eq!(newest_glibc(b"nothing of it"), None);
        let own = std::fs::read(std::env::current_exe().expect("a test is a program")).expect("it can be read");
        assert!(newest_glibc(&own).is_some_and(|version| version >= [2, 17]));
    }

    #[test]
    fn program_that_needs_a_newer_glibc_is_refused_with_advice() {
        let folder = tempfile::tempdir().expect("a folder");
        let program = folder.path().join("teleopd");
        assert!(refuse_new_glibc(&program, GLIBC_MAX, true).unwrap_err().contains("build it first"));
        std::fs::write(&program, b"\0GLIBC_2.31\0").expect("written");
        assert_eq!(refuse_new_glibc(&program, GLIBC_MAX, false), Ok(()));
        std::fs::write(&program, b"\0GLIBC_2.34\0").expect("written");
        assert_eq!(refuse_new_glibc(&program, GLIBC_MAX, true), Ok(()));
        let refused = refuse_new_glibc(&program, GLIBC_MAX, false).unwrap_err();
        assert!(refused.contains("needs glibc 2.34") && refused.contains("zigbuild"), "{refused}");
    }

    #[test]
    fn archives_of_the_same_files_are_identical() {
        let folder = tempfile::tempdir().expect("a folder");
        let source = folder.path().join("source");
        std::fs::write(&source, "a program").expect("written");
        let files = BTreeMap::from([
            ("bin/one".to_owned(), Content::Program(source.clone())),
            ("bin/three".to_owned(), Content::Link("one")),
            ("share/two".to_owned(), Content::Text("two".into())),
        ]);
        let packed = ["a.tar.gz", "b.tar.gz"].map(|name| {
            let path = folder.path().join(name);
            pack(&path, "teleopd", &files).expect("packed");
            std::fs::read(path).expect("it is there")
        });
        assert_eq!(packed[0], packed[1]);
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(packed[0].as_slice()));
        let entries: Vec<_> = archive
            .entries()
            .expect("entries")
            .map(|entry| {
                let entry = entry.expect("an entry");
                let link = entry.link_name().expect("a link or none").map(|to| to.display().to_string());
                (entry.path().expect("a path").display().to_string(), entry.header().mode().expect("a mode"), link)
            })
            .collect();
        let expected = [("bin/one", 0o755, None), ("bin/three", 0o777, Some("one")), ("share/two", 0o644, None)];
        let expected = expected.map(|(path, mode, to)| (format!("teleopd/{path}"), mode, to.map(str::to_owned)));
        assert_eq!(entries, expected);
    }
}
