//! The options that messages of the readers name.

use clap::{Args, Command};
use motion::LoadOptions;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Options in the texts of a source file: what follows `--` outside of comments.
fn named(text: &str) -> BTreeSet<String> {
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let words = code.flat_map(|line| line.split("--").skip(1).map(str::to_owned).collect::<Vec<_>>());
    let option = |rest: String| rest.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).next().map(str::to_owned);
    words.filter_map(option).filter(|option| !option.is_empty()).collect()
}

#[test]
fn every_option_that_a_message_names_belongs_to_every_program_that_reads_motions() {
    let command = LoadOptions::augment_args(Command::new("reader"));
    let known: BTreeSet<_> = command.get_arguments().filter_map(|option| option.get_long()).collect();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src");
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(folder).expect("the sources").flatten() {
        let text = std::fs::read_to_string(entry.path()).expect("a source");
        found.extend(named(&text).into_iter().map(|option| (option, entry.file_name())));
    }
    let unknown: Vec<_> = found.iter().filter(|(option, _)| !known.contains(option.as_str())).collect();
    assert!(unknown.is_empty(), "{unknown:?} is no option of {known:?}");
    assert!(found.len() >= 6, "{found:?}: the sources were not read");
}

/// Adds the Rust files below a folder that are no tests.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() && !path.ends_with("tests") {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn every_program_passes_these_options_to_the_reader() {
    let (root, mut files) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."), Vec::new());
    ["crates", "tools"].iter().for_each(|folder| sources(&root.join(folder), &mut files));
    let calls = |text: &str, call: &str| {
        text.lines().filter(|line| !line.trim_start().starts_with("//") && line.contains(call)).count()
    };
    let (mut with, mut without) = (0, Vec::new());
    for file in &files {
        let text = std::fs::read_to_string(file).expect("a source");
        with += calls(&text, "load_with(");
        if calls(&text, "motion::load(") > 0 {
            without.push(file);
        }
    }
    assert!(without.is_empty(), "{without:?} read motions without options");
    assert!(with >= 6, "{with}: the sources were not read");
}
