//! The program itself: it writes every file that the package's table expects from it, and reports a folder that
//! it cannot write to.

use std::path::Path;
use std::process::Command;

#[test]
fn dist_writes_every_file_of_the_asset_table() {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.toml");
    let manifest: toml::Table = std::fs::read_to_string(manifest).expect("Cargo.toml").parse().expect("TOML");
    let out = tempfile::tempdir().expect("a folder");
    let status = Command::new(env!("CARGO_BIN_EXE_dist")).arg("--out").arg(out.path()).status().expect("dist runs");
    assert!(status.success());
    let assets = manifest["package"]["metadata"]["deb"]["assets"].as_array().expect("a table");
    let expected: Vec<_> = assets.iter().filter_map(|row| row[0].as_str()?.strip_prefix("target/dist/")).collect();
    assert!(expected.len() > 5, "{expected:?}");
    for source in expected {
        let (folder, name) = source.rsplit_once('/').unwrap_or((".", source));
        let (start, end) = name.split_once('*').unwrap_or((name, ""));
        let entries = std::fs::read_dir(out.path().join(folder)).unwrap_or_else(|error| panic!("{source}: {error}"));
        let fits = |name: String| name.starts_with(start) && name.ends_with(end);
        let found = entries.flatten().filter(|entry| fits(entry.file_name().to_string_lossy().into_owned())).count();
        assert!(found > 0, "dist writes no {source}");
    }
}

#[test]
fn out_folder_that_cannot_be_made_is_reported() {
    let file = tempfile::NamedTempFile::new().expect("a file");
    let output = Command::new(env!("CARGO_BIN_EXE_dist")).arg("--out").arg(file.path()).output().expect("dist runs");
    assert_eq!(output.status.code(), Some(73));
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(printed.contains(&file.path().display().to_string()), "{printed}");
}
