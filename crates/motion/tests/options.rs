//! The options that messages of the readers name.

use clap::{Args, Command};
use motion::LoadOptions;
use std::collections::BTreeSet;

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
