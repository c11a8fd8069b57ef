//! Tables of the book that are generated from the sources: the settings and the hazards. With
//! `TELEOPD_WRITE_DOCS=1` the tests write them. Otherwise they compare.

mod rig;

use hazards::{Answer, GROUPS};
use std::fmt::Write;

const SETTINGS: &str = "crates/config/src/settings.rs";
const ENVIRONMENT: &str = "crates/robot/src/environment.rs";
const THRESHOLDS: &str = "crates/safety/src/engage/config.rs";

/// A field of a struct that is read from a file.
#[derive(Clone, Debug, PartialEq)]
struct Field {
    name: String,
    kind: String,
    meaning: String,
}

fn text(file: &str) -> String {
    std::fs::read_to_string(rig::repository().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// Returns the public fields of a struct, each with its doc comment on one line.
fn fields(source: &str, name: &str) -> Vec<Field> {
    let (_, rest) = source.split_once(&format!("pub struct {name} {{\n")).unwrap_or_else(|| panic!("no struct {name}"));
    let body = rest.split_once("\n}").expect("the struct ends").0;
    let (mut found, mut meaning) = (Vec::new(), Vec::new());
    for line in body.lines().map(str::trim) {
        if let Some(words) = line.strip_prefix("///") {
            meaning.push(words.trim().to_owned());
        } else if let Some((name, kind)) = line.strip_prefix("pub ").and_then(|field| field.split_once(": ")) {
            let (name, kind) = (name.to_owned(), kind.trim_end_matches(',').to_owned());
            found.push(Field { name, kind, meaning: std::mem::take(&mut meaning).join(" ") });
        }
    }
    found
}

/// Returns the value of a key in a section of the shipped settings, as written. Empty if there is none.
fn shipped(settings: &str, section: &str, key: &str) -> String {
    let of_section = settings.lines().skip_while(|line| {
        let head = line.split('#').next().unwrap_or_default().trim();
        head != format!("[{section}]") && head != format!("[[{section}]]")
    });
    let lines = of_section.skip(1).take_while(|line| !line.starts_with('['));
    let values = lines.filter_map(|line| line.split_once(" = ")).filter(|(name, _)| *name == key);
    values
        .map(|(_, rest)| format!("`{}`", rest.split(" #").next().unwrap_or_default().trim()))
        .next()
        .unwrap_or_default()
}

fn section(out: &mut String, settings: &str, name: &str, meaning: &str, keys: &[Field]) {
    writeln!(out, "\n## {name}\n\n{meaning}\n\n| key | default | meaning |\n|---|---|---|").expect("a string");
    for Field { name: key, meaning, .. } in keys {
        assert!(!meaning.is_empty() && !meaning.contains('|'), "[{name}] {key}: {meaning:?}");
        let value = shipped(settings, name, key);
        let value = if value.is_empty() { "none" } else { &value };
        writeln!(out, "| `{key}` | {value} | {meaning} |").expect("a string");
    }
}

fn settings_table() -> String {
    let (source, environment, settings) = (text(SETTINGS), text(ENVIRONMENT), text("config/teleop.toml"));
    let mut out = String::new();
    for Field { name, kind, meaning } in fields(&source, "Settings") {
        match kind.as_str() {
            "FileKey" => {
                let file = Field { name: "file".into(), kind: String::new(), meaning };
                section(&mut out, &settings, &name, "", std::slice::from_ref(&file));
            }
            "robot::Environment" => {
                for Field { name: list, kind, meaning } in fields(&environment, "Environment") {
                    let entry = kind.trim_start_matches("Vec<").trim_end_matches('>');
                    section(&mut out, &settings, &format!("{name}.{list}"), &meaning, &fields(&environment, entry));
                }
            }
            kind => section(&mut out, &settings, &name, &meaning, &fields(&source, kind)),
        }
    }
    out.replace("\n\n\n\n", "\n\n")
}

fn hazards_table() -> String {
    let mut out = String::new();
    for (title, hazards) in GROUPS {
        writeln!(out, "\n### {title}\n\n| id | what goes wrong | reaction | bound |\n|---|---|---|---|")
            .expect("a string");
        for hazard in hazards {
            let (id, what) = (hazard.id, hazard.what);
            match hazard.answer {
                Answer::Does { does, within } => writeln!(out, "| {id} | {what} | {does} | {within} |"),
                Answer::Struck { because } => writeln!(out, "| {id} | {what} | does not apply: {because} | |"),
            }
            .expect("a string");
        }
    }
    out
}

/// Compares the text between two marks of a chapter with `table`, or writes the table there.
fn check(chapter: &str, name: &str, table: &str) {
    let (begin, end) = (format!("<!-- {name}: written by tests/book.rs -->\n"), format!("\n<!-- end of {name} -->"));
    let page = text(chapter);
    let (before, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("{chapter} lacks {begin}"));
    let (stands, after) = rest.split_once(&end).unwrap_or_else(|| panic!("{chapter} lacks {end}"));
    if std::env::var_os("TELEOPD_WRITE_DOCS").is_some() {
        let page = format!("{before}{begin}{table}{end}{after}");
        return std::fs::write(rig::repository().join(chapter), page).expect("the chapter is written");
    }
    let again = "TELEOPD_WRITE_DOCS=1 cargo test --release --test book";
    assert!(stands == table, "{chapter} does not say what the sources say; {again} writes it");
}

#[test]
fn settings_chapter_matches_the_sources() {
    check("docs/src/settings.md", "settings", &settings_table());
}

#[test]
fn hazards_of_the_evidence_chapter_match_the_list() {
    check("docs/src/evidence.md", "hazards", &hazards_table());
}

/// Returns the bounds that the code checks with literal numbers: section, key, `low to high`.
fn bounds() -> Vec<(String, String, String)> {
    let whole = text(SETTINGS);
    let rows = |source: &str, section: &str| -> Vec<_> {
        let rows = source.lines().filter_map(|line| line.trim().strip_prefix("(\"")?.strip_suffix("),"));
        let numbers = rows.filter_map(|row| {
            let (key, rest) = row.split_once("\", ")?;
            let mut last = rest.rsplit(", ").map(|number| number.replace('_', "").parse::<f64>().ok());
            let (high, low) = (last.next()??, last.next()??);
            let (section, key) = key.split_once('.').unwrap_or((section, key));
            Some((section.to_owned(), key.to_owned(), format!("{low} to {high}")))
        });
        numbers.collect()
    };
    [rows(&whole, "?"), rows(&text(THRESHOLDS), "safety")].concat()
}

#[test]
fn every_bounded_setting_names_its_checked_bounds() {
    let table = settings_table();
    let bounds = bounds();
    assert!(bounds.len() > 35, "{bounds:?}");
    for (section, key, range) in bounds {
        let (_, rest) = table.split_once(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("no [{section}]"));
        let rows = rest.split("\n## ").next().unwrap_or_default();
        let row = rows.lines().find(|line| line.starts_with(&format!("| `{key}` |")));
        assert!(row.is_some_and(|row| row.contains(&range)), "[{section}] {key} is bounded by {range}: {row:?}");
    }
}

#[test]
fn parsed_fields_have_their_comments_and_defaults() {
    let source = "pub struct A {\n    /// One\n    /// two.\n    #[serde(default)]\n    pub x_ms: Option<f64>,\n    pub y: u32,\n}\n";
    let field =
        |name: &str, kind: &str, meaning: &str| Field { name: name.into(), kind: kind.into(), meaning: meaning.into() };
    assert_eq!(fields(source, "A"), [field("x_ms", "Option<f64>", "One two."), field("y", "u32", "")]);
    let settings = "[a]\nx = 1\n[b]     # x = 3\nx = [\"p\"]   # said\n# y = 2\n";
    assert_eq!([shipped(settings, "b", "x"), shipped(settings, "b", "y")], ["`[\"p\"]`", ""]);
}
