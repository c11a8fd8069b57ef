//! Tests the Debian package. Its table of files covers an installation's needs, and the built package works.

use crate::sources::{files, root};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns the table of files: source, destination, mode.
fn assets() -> Vec<[String; 3]> {
    let text = std::fs::read_to_string(root().join("Cargo.toml")).expect("Cargo.toml");
    let manifest: toml::Table = text.parse().expect("TOML");
    let assets = manifest["package"]["metadata"]["deb"]["assets"].as_array().expect("a table of files");
    let word = |row: &toml::Value, column: usize| row[column].as_str().expect("text").to_owned();
    assets.iter().map(|row| [0, 1, 2].map(|column| word(row, column))).collect()
}

/// Returns the files of the repository that a pattern names, by their paths in it.
fn named(pattern: &str) -> BTreeSet<String> {
    let files = files(&root().join(pattern));
    files.iter().map(|path| path.strip_prefix(root()).expect("a file of ours").display().to_string()).collect()
}

#[test]
fn package_sources_exist_and_needed_files_are_included() {
    let mut covered = BTreeSet::new();
    for [source, _, _] in assets().iter().filter(|[source, _, _]| !source.starts_with("target/")) {
        let mut found = named(source);
        assert!(!found.is_empty(), "{source} names no file");
        covered.append(&mut found);
    }
    for all in ["config/robots/**/*", "config/systemd/**/*"] {
        let left_out: Vec<_> = named(all).difference(&covered).cloned().collect();
        assert!(left_out.is_empty(), "not in the package: {left_out:?}");
    }
    for file in [
        "weights/tiago_dual.toml",
        "weights/tiago_dual.safetensors",
        "weights/prediction.safetensors",
        "SAFETY.md",
        "LICENSE-MIT",
        "LICENSE-APACHE",
    ] {
        assert!(covered.contains(file), "not in the package: {file}");
    }
}

#[test]
fn package_destinations_are_unique_and_only_settings_in_etc() {
    let mut destinations = BTreeMap::new();
    for [source, destination, mode] in assets() {
        assert!(destination.starts_with("usr/") || destination == "etc/teleop/teleop.toml", "{destination}");
        assert_eq!(mode == "755", destination.starts_with("usr/bin/"), "{destination}");
        if !destination.ends_with('/') {
            assert_eq!(destinations.insert(destination.clone(), source), None, "{destination}");
        }
    }
}

#[test]
fn package_scripts_start_and_enable_nothing() {
    for name in ["postinst", "prerm", "postrm"] {
        let path = root().join("tools/dist/debian").join(name);
        let script = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        run(Command::new("/bin/sh").arg("-n").arg(&path)).expect("a shell");
        for line in script.lines().filter(|line| !line.trim_start().starts_with('#')) {
            let banned = ["enable", "preset", "restart", "systemctl start", "deb-systemd"];
            assert!(banned.iter().all(|word| !line.contains(word)), "{name}: {line}");
        }
    }
}

/// Returns a program's output. `None` if it is not installed.
fn run(command: &mut Command) -> Option<Output> {
    let output = command.output().ok()?;
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {}: {printed}", output.status);
    Some(output)
}

/// Returns the folder of our programs. The error says which of others is not installed, or which of ours is not built.
fn programs(others: &[&str], ours: &[&str]) -> Result<&'static Path, String> {
    for needed in others {
        if !Command::new(needed).arg("--version").output().is_ok_and(|output| output.status.success()) {
            return Err(format!("{needed} is not installed"));
        }
    }
    let built = Path::new(env!("CARGO_BIN_EXE_teleopd")).parent().expect("a folder");
    match ours.iter().find(|needed| !built.join(needed).exists()) {
        Some(needed) => Err(format!("{needed} is not built (cargo build --release --workspace)")),
        None => Ok(built),
    }
}

/// Builds the package from the programs that are already built. The error says why there is none.
fn package(folder: &Path) -> Result<PathBuf, String> {
    let built = programs(&["cargo-deb", "dpkg-deb"], &["dist", "replay", "latency", "record", "teleop-bridge"])?;
    if !built.ends_with("release") {
        return Err("the package takes release builds".into());
    }
    run(Command::new(built.join("dist")).current_dir(root())).ok_or("dist does not run")?;
    let file = folder.join("teleopd.deb");
    let mut cargo_deb = Command::new("cargo-deb");
    cargo_deb.args(["deb", "--no-build", "--strip", "--fast", "--output"]).arg(&file).current_dir(root());
    run(&mut cargo_deb).ok_or("cargo-deb does not run")?;
    Ok(file)
}

fn assert_has_links(listed: &str) {
    for link in ["batch", "keyposes", "say"] {
        let path = format!(" ./usr/bin/teleop-{link} -> teleop-replay");
        assert!(listed.lines().any(|line| line.ends_with(&path)), "the package lacks {path}:\n{listed}");
    }
}

#[test]
fn package_holds_its_files_and_its_settings_are_accepted() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = match package(folder.path()) {
        Ok(file) => file,
        Err(reason) => return println!("skipped: {reason}"),
    };
    let listed = run(Command::new("dpkg-deb").arg("--contents").arg(&file)).expect("dpkg-deb");
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    let holds = |path: &str| listed.lines().any(|line| line.ends_with(&format!(" ./{path}")));
    for [_, destination, _] in assets().iter().filter(|[_, destination, _]| !destination.ends_with('/')) {
        assert!(holds(destination), "the package lacks {destination}:\n{listed}");
    }
    let wanted = "usr/lib/systemd/system/teleop@.service usr/lib/systemd/user/teleop.target \
        usr/share/teleopd/weights/tiago_dual.safetensors usr/share/teleopd/weights/prediction.safetensors \
        usr/share/doc/teleopd/examples/driver.conf usr/share/man/man1/teleopd.1.gz \
        usr/share/man/man1/teleop-replay.1.gz usr/share/man/man1/teleop-latency.1.gz \
        usr/share/man/man1/teleop-record.1.gz usr/share/man/man1/teleop-replay-say.1.gz \
        usr/share/man/man1/teleop-say.1.gz usr/share/man/man1/teleop-bridge-link.1.gz \
        usr/share/teleopd/motions/captions.tsv usr/share/teleopd/motions/synonyms.txt \
        usr/share/teleopd/motions/clap.bvh usr/share/zsh/vendor-completions/_teleopctl \
        usr/share/doc/teleopd/SAFETY.md usr/share/doc/teleopd/LICENSE-MIT";
    for path in wanted.split(' ') {
        assert!(holds(path), "the package lacks {path}:\n{listed}");
    }

    assert_has_links(&listed);
    let (tree, control) = (folder.path().join("tree"), folder.path().join("control"));
    run(Command::new("dpkg-deb").arg("--extract").arg(&file).arg(&tree)).expect("dpkg-deb");
    run(Command::new("dpkg-deb").arg("--control").arg(&file).arg(&control)).expect("dpkg-deb");
    let conffiles = std::fs::read_to_string(control.join("conffiles")).expect("conffiles");
    assert_eq!(conffiles.split_whitespace().collect::<Vec<_>>(), ["/etc/teleop/teleop.toml"]);

    match run(Command::new("systemd-sysusers").arg(format!("--root={}", tree.display())).arg("teleopd.conf")) {
        None => println!("note: there is no systemd-sysusers"),
        Some(_) => {
            let of = |file: &str| std::fs::read_to_string(tree.join("etc").join(file)).unwrap_or_default();
            assert!(
                of("passwd").contains("teleop:")
                    && of("group").contains("teleop-operator:")
                    && of("group").contains("teleop-skeleton:"),
                "{}",
                of("passwd")
            );
        }
    }

    // The settings name absolute paths. Here the tree is in another place.
    let settings = tree.join("etc/teleop/teleop.toml");
    let text = std::fs::read_to_string(&settings).expect("settings");
    let moved = text.replace("\"/usr/share/", &format!("\"{}/usr/share/", tree.display()));
    assert_ne!(text, moved);
    std::fs::write(&settings, moved).expect("settings");
    let mut check = Command::new(tree.join("usr/bin/teleopd"));
    let output = run(check.args(["check", "--config"]).arg(&settings).current_dir("/")).expect("teleopd");
    let printed = String::from_utf8_lossy(&output.stdout);
    for read in ["usr/share/teleopd/robots/tiago_dual.urdf", "usr/share/teleopd/weights/tiago_dual.safetensors"] {
        assert!(printed.contains(read), "check read no {read}:\n{printed}");
    }
}

/// Builds the wheel from the programs that are already built. The error says why there is none.
fn wheel(folder: &Path) -> Result<PathBuf, String> {
    let built = programs(&["maturin", "strip"], &["dist", "bundle"])?;
    let mut dist = Command::new(built.join("dist"));
    dist.args(["--wheel", "--this-machine", "--out"]).arg(folder).arg("--programs").arg(built);
    run(dist.current_dir(root())).ok_or("dist does not run")?;
    let wheels = std::fs::read_dir(folder.join("wheel/wheels")).expect("a folder");
    wheels.flatten().map(|entry| entry.path()).next().ok_or("dist wrote no wheel".into())
}

#[test]
fn wheel_installs_and_its_programs_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = match wheel(folder.path()) {
        Ok(file) => file,
        Err(reason) => return println!("skipped: {reason}"),
    };
    let venv = folder.path().join("venv");
    let python = match harness::python(&venv, &[file.to_str().expect("UTF-8")]) {
        Ok(python) => python,
        Err(why) => return println!("skipped: no NumPy for Python: {why}"),
    };
    let share = venv.join("share/teleopd");
    for kind in ["robots", "skeletons"] {
        let here = files(&root().join("config").join(kind));
        let installed = std::fs::read_dir(share.join(kind)).expect("a folder").count();
        assert!(installed > 0 && installed == here.len(), "{installed} {kind} of {here:?}");
    }
    let elsewhere = |program: &Path| {
        let mut command = Command::new(program);
        command.current_dir(folder.path());
        command
    };
    let program = |name: &str| elsewhere(&venv.join("bin").join(name));
    let checked = run(program("teleopd").arg("check")).expect("teleopd");
    let read = share.join("weights/tiago_dual.safetensors");
    let printed = String::from_utf8_lossy(&checked.stdout);
    assert!(printed.contains(&read.display().to_string()), "check read no {}:\n{printed}", read.display());
    run(program("teleopctl").arg("--version")).expect("teleopctl");
    run(program("record").arg("--version")).expect("record");
    std::fs::create_dir(folder.path().join("in")).expect("a folder");
    std::fs::copy(root().join("tools/replay/motions/box.bvh"), folder.path().join("in/box.bvh")).expect("copied");
    run(program("replay").args(["batch", "--certified", "--input", "in", "--out", "out"])).expect("replay");
    let script = "import teleopd; print(teleopd.certify(teleopd.read_motion('in/box.bvh')).positions[-1].tolist())";
    let certified = run(elsewhere(&python).args(["-c", script])).expect("Python");
    let certified = String::from_utf8_lossy(&certified.stdout).into_owned();
    assert!(certified.split(',').count() == 17, "{certified}");
    let mut demo = program("teleopd");
    let demo = demo.args(["demo", "--seconds", "3", "--run-dir"]).arg(folder.path().join("run")).output();
    let demo = demo.expect("it starts");
    let verdict = String::from_utf8_lossy(&demo.stdout).into_owned();
    assert!(demo.status.code().is_some_and(|code| code == 0 || code == 2), "{verdict}{}", harness::stderr(&demo));
    assert!(verdict.contains("smallest clearance"), "{verdict}");
}
