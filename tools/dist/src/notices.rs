//! Notices of the libraries that are linked into the packaged programs. The licences require them.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// The packages whose programs are packaged.
const PACKAGED: [&str; 5] = ["teleopd", "replay", "latency", "record", "bridge"];

/// Beginnings of the names of licence files.
const BEGINNINGS: [&str; 5] = ["licen", "copying", "copyright", "notice", "unlicense"];

/// Returns every library by name and version, with its licence, its source, and its texts. A text that several
/// libraries share occurs only once.
pub fn collect(root: &Path) -> Result<String, String> {
    let metadata = metadata(root)?;
    let linked = linked(&metadata);
    let mut libraries = String::new();
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    for package in
        packages.iter().filter(|package| linked.contains(text(package, "id")) && !package["source"].is_null())
    {
        let name = format!("{} {}", text(package, "name"), text(package, "version"));
        let _ = writeln!(libraries, "{name}: {} ({})", text(package, "license"), text(package, "repository"));
        let folder = Path::new(text(package, "manifest_path")).parent().unwrap_or(root);
        for notice in notices(folder)? {
            texts.entry(notice).or_default().push(name.clone());
        }
    }
    let mut out = format!("Libraries that are linked into the programs of this package.\n\n{libraries}");
    for (text, mut names) in texts {
        names.dedup();
        let _ = write!(out, "\n{}\n{}\n\n{}\n", "-".repeat(80), names.join(", "), text.trim());
    }
    Ok(out)
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or("")
}

fn metadata(root: &Path) -> Result<Value, String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--locked", "--filter-platform"])
        .arg(format!("{}-unknown-linux-gnu", std::env::consts::ARCH))
        .current_dir(root)
        .output()
        .map_err(|error| format!("cargo metadata: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr)));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| format!("cargo metadata: {error}"))
}

/// Returns the ids of everything from which the packaged programs are built, by normal dependencies.
fn linked(metadata: &Value) -> BTreeSet<&str> {
    let nodes = metadata["resolve"]["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    let by_id: BTreeMap<&str, &Value> = nodes.iter().map(|node| (text(node, "id"), node)).collect();
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    let ours = |package: &&Value| package["source"].is_null() && PACKAGED.contains(&text(package, "name"));
    let mut open: VecDeque<&str> = packages.iter().filter(ours).map(|package| text(package, "id")).collect();
    let mut seen = BTreeSet::new();
    while let Some(id) = open.pop_front() {
        if !seen.insert(id) {
            continue;
        }
        for dependency in by_id.get(id).and_then(|node| node["deps"].as_array()).into_iter().flatten() {
            let kinds = dependency["dep_kinds"].as_array().map_or(&[][..], Vec::as_slice);
            if kinds.iter().any(|kind| kind["kind"].is_null()) {
                open.push_back(text(dependency, "pkg"));
            }
        }
    }
    seen
}

/// Returns the texts of the licence files in a library's folder, in the order of their names.
fn notices(folder: &Path) -> Result<Vec<String>, String> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.retain(|path| {
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().to_lowercase());
        BEGINNINGS.iter().any(|beginning| name.starts_with(beginning))
    });
    files.sort();
    Ok(files.iter().filter_map(|path| std::fs::read_to_string(path).ok()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notices_list_linked_crates_with_licence_and_no_test_crates() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let out = collect(&root).expect("notices");
        let listed = |name: &str| out.lines().any(|line| line.starts_with(&format!("{name} ")) && line.contains(": "));
        assert!(listed("iceoryx2") && listed("nalgebra") && listed("tokenizers"), "{}", &out[..2000]);
        assert!(!listed("proptest") && !listed("clarabel"), "{}", &out[..2000]);
        assert!(out.contains("Permission is hereby granted"));
        let unnamed: Vec<_> =
            out.lines().take_while(|line| !line.starts_with('-')).filter(|l| l.contains(":  (")).collect();
        assert!(unnamed.is_empty(), "without a licence: {unnamed:?}");
    }
}
