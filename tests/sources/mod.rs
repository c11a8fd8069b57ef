//! The sources of the repository, as the tests of their form read them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The repository.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Returns the files that a pattern names.
pub fn files(pattern: &Path) -> Vec<PathBuf> {
    let found =
        glob::glob(&pattern.display().to_string()).unwrap_or_else(|error| panic!("{}: {error}", pattern.display()));
    found.map(|path| path.expect("a path")).filter(|path| path.is_file()).collect()
}

/// Returns the output of a cargo command. It uses no network.
pub fn cargo(arguments: &[&str]) -> String {
    let mut cargo = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    let output =
        cargo.args(arguments).args(["--locked", "--offline"]).current_dir(root()).output().expect("cargo runs");
    assert!(output.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// Returns what cargo knows about the workspace and the packages that it needs here.
pub fn metadata() -> serde_json::Value {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let json = cargo(&["metadata", "--format-version", "1", "--filter-platform", &platform]);
    serde_json::from_str(&json).expect("metadata is JSON")
}

/// The Rust files of the repository, and their text.
pub fn rust_files() -> Vec<(String, String)> {
    let listed = Command::new("git").args(["ls-files", "*.rs"]).current_dir(root()).output();
    let names: Vec<String> = match listed {
        Ok(output) if output.status.success() => {
            String::from_utf8_lossy(&output.stdout).lines().map(str::to_owned).collect()
        }
        _ => {
            let folders = ["crates", "tests", "tools"].iter();
            let found = folders.flat_map(|folder| files(&root().join(folder).join("**/*.rs")));
            found.map(|path| path.strip_prefix(root()).unwrap().display().to_string()).collect()
        }
    };
    assert!(names.len() > 30, "the tree has more sources than {}", names.len());
    names
        .into_iter()
        .filter_map(|name| std::fs::read_to_string(root().join(&name)).ok().map(|text| (name, text)))
        .collect()
}

/// The chapters of the book and these pages of the root, and their text.
pub fn documents(pages: &[&str]) -> Vec<(String, String)> {
    let chapters = std::fs::read_dir(root().join("docs/src")).expect("the book").flatten();
    let chapters = chapters.map(|entry| format!("docs/src/{}", entry.file_name().to_string_lossy()));
    let names = chapters.filter(|name| name.ends_with(".md")).chain(pages.iter().map(|page| (*page).to_owned()));
    names.map(|name| (name.clone(), std::fs::read_to_string(root().join(&name)).expect(&name))).collect()
}
