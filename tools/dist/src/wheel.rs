//! The wheel: the extension for Python with the programs and every file that they read, from the archive's list. maturin
//! builds the extension and writes the wheel.

use crate::save;
use crate::tarball::{self, Version};
use std::ffi::OsStr;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The oldest glibc with which the wheel must run: that of Debian 10, RHEL 8 and Ubuntu 20.04.
const GLIBC_MAX: Version = [2, 28];
/// The program of a build that is all of them, and its name.
const PROGRAM: (&str, &str) = ("bundle", "teleopd");
/// Most bytes of a wheel of small programs: a download of a few seconds.
const BYTES_MAX: u64 = 15_000_000;
/// The cargo profile of small programs, and its folder.
const SMALL: &str = "wheel";
/// Names that start it as another program.
const NAMES: [&str; 3] = ["teleopctl", "replay", "record"];
/// Files of the package: folders and their destinations.
const SOURCES: [(&str, &str); 2] =
    [("crates/python/teleopd", "python/teleopd"), ("tools/clients/python/teleopd_client", "python/teleopd/client")];
/// Place of the archive's data in the wheel.
const DATA: &str = "data/data";

/// Writes `teleopd-VERSION-cp310-abi3-manylinux_*.whl` into `out`. The other arguments are those of [`tarball::write`].
pub fn write(root: &Path, programs: &Path, out: &Path, settings: &str, any_glibc: bool) -> Result<PathBuf, String> {
    let staged = out.join("wheel");
    match std::fs::remove_dir_all(&staged) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(failed(&staged)(error)),
        _ => {}
    }
    let (program, name) = PROGRAM;
    let (from, to) = (programs.join(program), staged.join("data/scripts").join(name));
    tarball::refuse_new_glibc(&from, GLIBC_MAX, any_glibc)?;
    copy(&from, &to)?;
    // The extension is built as the programs were. cargo has stripped small ones.
    let profile = if programs.ends_with(SMALL) { SMALL } else { "release" };
    if profile != SMALL {
        run(Command::new("strip").arg(&to), "it is a part of binutils")?;
    }
    let bytes = std::fs::read(&to).map_err(failed(&to))?;
    let newest = tarball::newest_glibc(&bytes).unwrap_or(GLIBC_MAX).max(GLIBC_MAX);
    for name in NAMES {
        let path = staged.join("data/scripts").join(name);
        save(&path, &format!("#!/bin/sh\nexec \"${{0%/*}}/teleopd\" {name} \"$@\"\n"))?;
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).map_err(failed(&path))?;
    }
    for (from, to) in tarball::data_files(root)? {
        copy(&from, &staged.join(DATA).join(to))?;
    }
    save(&staged.join(DATA).join("share/teleopd/teleop.toml"), settings)?;
    for (folder, to) in SOURCES {
        for file in tarball::files_of(&root.join(folder))? {
            copy(&file, &staged.join(to).join(tarball::file_name(&file)))?;
        }
    }
    for document in ["README.md", "LICENSE-APACHE", "LICENSE-MIT"] {
        copy(&root.join(document), &staged.join(document))?;
    }
    copy(&out.join("third-party.txt"), &staged.join("third-party.txt"))?;
    let manifest = root.join("crates/python/Cargo.toml").canonicalize().map_err(failed(root))?;
    let project = root.join("crates/python/pyproject.toml");
    let text = std::fs::read_to_string(&project).map_err(failed(&project))?;
    let text = text.replace("\"Cargo.toml\"", &format!("\"{}\"", manifest.display()));
    save(&staged.join("pyproject.toml"), &text)?;
    let folder = programs.parent().and_then(Path::file_name).and_then(OsStr::to_str);
    let own = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let target = folder.filter(|name| name.ends_with("-linux-gnu")).unwrap_or(&own);
    let wheel = build(&staged, profile, newest, (!any_glibc).then_some(target))?;
    let bytes = wheel.metadata().map_err(failed(&wheel))?.len();
    match bytes {
        BYTES_MAX.. if profile == SMALL => Err(format!("{}: {bytes} bytes, at most {BYTES_MAX}", wheel.display())),
        _ => Ok(wheel),
    }
}

/// Calls maturin. A wheel for every machine of a target is linked by zig.
fn build(staged: &Path, profile: &str, [major, minor]: Version, target: Option<&str>) -> Result<PathBuf, String> {
    let mut maturin = Command::new("maturin");
    maturin.args(["build", "--strip", "--compression-level", "9", "--out", "wheels", "--profile", profile]);
    maturin.arg("--compatibility").arg(format!("manylinux_{major}_{minor}")).current_dir(staged);
    // A panic of the extension is an exception of Python's. That of a program ends it.
    maturin.env("CARGO_PROFILE_WHEEL_PANIC", "unwind");
    if let Some(target) = target {
        maturin.args(["--zig", "--target", target]);
    }
    run(&mut maturin, "pip install maturin ziglang")?;
    let wheels = tarball::files_of(&staged.join("wheels"))?;
    wheels.into_iter().next().ok_or_else(|| format!("{}: maturin wrote no wheel", staged.display()))
}

fn run(command: &mut Command, hint: &str) -> Result<(), String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let status = command.status().map_err(|error| format!("{name} cannot be started: {error} ({hint})"))?;
    if status.success() { Ok(()) } else { Err(format!("{name}: {status}")) }
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    let folder = to.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(failed(folder))?;
    std::fs::copy(from, to).map(|_| ()).map_err(failed(from))
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> String {
    move |error| format!("{}: {error}", path.display())
}
