//! Everything that is generated from the sources: the shipped settings, and the book's tables of settings and hazards.
//! With `TELEOPD_WRITE_DOCS=1` the tests write them. Otherwise they compare.

use config::{Reference, Settings};
use hazards::{Answer, Group, Hazard, groups};
use schema::Key;
use std::fmt::Write;

const SETTINGS: &str = "config/teleop.toml";
/// Longest line of the shipped settings, characters.
const LINE_MAX: usize = 118;

fn text(file: &str) -> String {
    std::fs::read_to_string(harness::repository().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// Returns the meaning of a key with its bounds.
fn meaning(key: &Key) -> String {
    let number = |x: f64| format!("{x:.4}").trim_end_matches('0').trim_end_matches('.').to_owned();
    let bounds = key.bounds.map(|[low, high]| format!(" {} to {}.", number(low), number(high)));
    key.meaning.join("").trim().to_owned() + &bounds.unwrap_or_default()
}

/// Returns the value of a key as the file has it. Empty if it has no default.
fn default(table: &Reference, key: &Key) -> String {
    table.defaults.get(key.name).map(ToString::to_string).unwrap_or_default()
}

fn settings_table() -> String {
    let mut out = String::new();
    for table in Settings::reference() {
        let about = table.meaning.join("");
        write!(out, "\n## {}\n\n{}\n\n| key | default | meaning |\n|---|---|---|\n", table.name, about.trim()).unwrap();
        for key in table.keys {
            let (meaning, value) = (meaning(key), default(&table, key));
            assert!(!meaning.contains('|'), "[{}] {}: {meaning:?}", table.name, key.name);
            let value = if value.is_empty() { "none".to_owned() } else { format!("`{value}`") };
            writeln!(out, "| `{}` | {value} | {meaning} |", key.name).unwrap();
        }
    }
    out
}

/// Writes `text` as comments of at most [`LINE_MAX`] characters.
fn comment(out: &mut String, text: &str) {
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.len() + 1 + word.len() > LINE_MAX {
            writeln!(out, "{line}").unwrap();
            line = String::from("#");
        }
        line = line + " " + word;
    }
    writeln!(out, "{line}").unwrap();
}

fn settings_file() -> String {
    let mut out = String::from(
        "# teleopd, all settings. The last word of a key is its unit. Nothing here can loosen a limit of the robot.\n\
         # cargo test --release --test rules book compares this file with the sources.\n",
    );
    for table in Settings::reference() {
        writeln!(out).unwrap();
        comment(&mut out, &table.meaning.join(""));
        // A list may be empty, so its example is a comment, except for the floor.
        let listed = table.name.contains('.');
        let hidden = if listed && table.name != "environment.planes" { "# " } else { "" };
        let head = if listed { format!("[[{}]]", table.name) } else { format!("[{}]", table.name) };
        writeln!(out, "{hidden}{head}").unwrap();
        for key in table.keys {
            comment(&mut out, &meaning(key));
            let value = default(&table, key);
            if value.is_empty() {
                let example = if key.bounds.is_some() { "0.0" } else { "\"direct\"" };
                writeln!(out, "# {} = {example}", key.name).unwrap();
            } else {
                writeln!(out, "{hidden}{} = {value}", key.name).unwrap();
            }
        }
    }
    out
}

fn hazards_table() -> String {
    let mut out = String::new();
    for Group { title, hazards } in groups() {
        writeln!(out, "\n### {title}\n\n| id | what goes wrong | reaction | bound |\n|---|---|---|---|")
            .expect("a string");
        for Hazard { id, what, answer } in hazards {
            match answer {
                Answer::Does { does, within } => writeln!(out, "| {id} | {what} | {does} | {within} |"),
                Answer::Struck { because } => writeln!(out, "| {id} | {what} | does not apply: {because} | |"),
            }
            .expect("a string");
        }
    }
    out
}

/// Compares a page with the one on disk, or writes it.
fn compare(file: &str, before: &str, page: String) {
    if std::env::var_os("TELEOPD_WRITE_DOCS").is_some() {
        return std::fs::write(harness::repository().join(file), page).expect("it is written");
    }
    let again = "TELEOPD_WRITE_DOCS=1 cargo test --release --test rules book";
    assert!(before == page, "{file} does not say what the sources say; {again} writes it");
}

/// Compares the text between two marks of a chapter with `table`, or writes the table there.
fn check(chapter: &str, name: &str, table: &str) {
    let (begin, end) = (format!("<!-- {name}: written by tests/book.rs -->\n"), format!("\n<!-- end of {name} -->"));
    let page = text(chapter);
    let (before, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("{chapter} lacks {begin}"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("{chapter} lacks {end}"));
    compare(chapter, &page, format!("{before}{begin}{table}{end}{after}"));
}

#[test]
fn settings_chapter_matches_the_sources() {
    check("docs/src/settings.md", "settings", &settings_table());
}

#[test]
fn hazards_of_the_evidence_chapter_match_the_list() {
    check("docs/src/evidence.md", "hazards", &hazards_table());
}

#[test]
fn shipped_settings_match_the_sources() {
    compare(SETTINGS, &text(SETTINGS), settings_file());
    assert_eq!(Settings::parse(SETTINGS, &text(SETTINGS)).expect("valid"), Settings::default());
}

#[test]
fn reference_names_every_table_and_key_of_the_settings() {
    let parsed: toml::Table = text(SETTINGS).parse().expect("TOML");
    let reference = Settings::reference();
    for (name, table) in parsed.iter().filter(|(name, _)| *name != "environment") {
        let known = reference.iter().find(|known| known.name == name).expect(name);
        let keys: Vec<_> = table.as_table().expect("a table").keys().collect();
        let mut named: Vec<_> =
            known.keys.iter().filter(|key| known.defaults.contains_key(key.name)).map(|key| key.name).collect();
        named.sort_unstable();
        assert_eq!(keys, named, "[{name}]");
    }
    assert_eq!(parsed.len() + 1, reference.len(), "environment has two");
}
