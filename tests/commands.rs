//! The commands that README, CONTRIBUTING and book print. A test runs each of them, or `commands.toml` gives the reason and
//! the day of its last run. Such a day is that of the measurement in `docs/results`, or of the commit that printed the
//! command.

use crate::sources::{self, root, rust_files};
use serde::Deserialize;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

/// Treatment of a command. A command in a block without a row in `commands.toml` runs to its end, which must be a success.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum How {
    /// Runs to its end with one of these exit codes, with more options.
    Ends(Vec<i32>, String),
    /// Runs beside the commands of this many blocks once it prints these words. Then it gets Ctrl-C. With more options.
    Beside(String, usize, String),
    /// Is not run, for this reason. It last ran on this day. `--help` of a program of ours must name its options.
    Listed(String, String),
    /// Is run by a test in this file.
    Tested(String),
}
use How::{Beside, Ends, Listed, Tested};

/// A demo on a busy machine holds and continues. Exit code 2 means that it held for more than half of the motion.
pub const DEMO: &[i32] = &[0, 2];

/// Commands of the prose that run after those of the blocks.
pub const OF_PROSE: [&str; 5] = [
    "cargo run --release -- demo --view --motion pick-and-place",
    "cargo run --release -p hazards",
    "cargo run --release -p replay -- batch --input FOLDER --out OUT --format npz",
    "replay tools/replay/motions/clap.bvh --offline out.csv --record out.mcap",
    "replay --compare out.mcap",
];

/// Commands of the shell that place the files of a robot of one's own.
pub const OWN_FILES: [&str; 3] = ["rm -rf target/own", "cp docs/robots/", "mv target/own/"];

/// Names of programs of ours in prose, by which a reader means the built or the installed program.
const OURS: &str = "\
    teleopd teleopctl replay record latency eval train collision torture simulate chaos teleop-bridge";

/// The rows of `commands.toml`.
static ROWS: LazyLock<Vec<(String, How)>> = LazyLock::new(|| {
    let mut file: HashMap<String, Vec<_>> = toml::from_str(include_str!("commands.toml")).expect("rows");
    file.remove("commands").expect("the one table")
});

/// Returns the row of a command.
fn row(command: &str) -> Option<How> {
    ROWS.iter().find(|(start, _)| command.starts_with(start)).map(|(_, how)| how.clone())
}

/// Returns the treatment of a command in a block.
pub fn how(command: &str) -> How {
    row(command).unwrap_or_else(|| Ends(vec![0], String::new()))
}

/// Returns true if the command runs a program of ours.
pub fn is_ours(command: &str) -> bool {
    let first = command.split_whitespace().next().unwrap_or_default();
    command.starts_with("cargo run ") || first.starts_with("target/release/") || OURS.split(' ').any(|own| own == first)
}

/// Returns the commands of each block of a document. Joins continued lines and removes remarks.
pub fn blocks(document: &str) -> Vec<Vec<String>> {
    let fenced = document.split("\n```").skip(1).step_by(2);
    fenced
        .map(|block| {
            let joined = block.replace("\\\n", " ");
            let lines =
                joined.lines().map(|line| line.split("   #").next().unwrap_or("").split(" # ").next().unwrap_or(""));
            let words = lines.map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
            words.filter(|line| is_command(line)).collect::<Vec<_>>()
        })
        .filter(|commands| !commands.is_empty())
        .collect()
}

fn is_command(line: &str) -> bool {
    let starts = ["cargo ", "target/release/", "sudo ", "python3 ", "pip ", "venv/", ".ci/"];
    starts.iter().chain(&OWN_FILES).any(|start| line.starts_with(start))
}

/// Splits a command into words like the shell, with double quotes.
pub fn words(command: &str) -> Vec<String> {
    let parts = command.split('"').enumerate();
    let words = parts.flat_map(|(i, part)| if i % 2 == 1 { vec![part] } else { part.split_whitespace().collect() });
    words.map(str::to_owned).collect()
}

/// Returns the commands that a document's prose and tables have in backquotes. A name alone is no command.
fn of_prose(document: &str) -> BTreeSet<String> {
    let prose: String = document.split("\n```").step_by(2).collect();
    let spans = prose.split('`').skip(1).step_by(2).map(|span| span.split_whitespace().collect::<Vec<_>>().join(" "));
    let others = ["systemctl ", "mdbook ", "npm ", "ros2 ", "teleopd-ros2 ", "bin/"];
    let is_command = |span: &str| {
        is_command(span) || others.iter().any(|start| span.starts_with(start)) || is_ours(span) && span.contains(' ')
    };
    spans.filter(|span| is_command(span)).collect()
}

fn documents() -> Vec<(String, String)> {
    sources::documents(&["README.md", "CONTRIBUTING.md"])
}

/// Returns true if a word of `cargo test` that selects tests is part of the name of one, or of a module.
fn selects_a_test(word: &str) -> bool {
    static FILES: LazyLock<Vec<(String, String)>> = LazyLock::new(rust_files);
    let name = word.rsplit("::").find(|part| !part.is_empty()).unwrap_or(word);
    FILES.iter().any(|(file, text)| {
        Path::new(file).file_stem().is_some_and(|stem| stem.to_string_lossy().contains(name))
            || text.lines().any(|line| line.trim_start().starts_with("fn ") && line.contains(name))
    })
}

/// Returns what is wrong with the names in a `cargo test`: of the package, of the test program, of the tests.
fn wrong_test_command(command: &str) -> Option<String> {
    let typed = words(command);
    let after = |option: &str| typed.iter().position(|word| word == option).and_then(|at| typed.get(at + 1));
    let folder = match after("-p") {
        None => root(),
        Some(package) => {
            let named = format!("name = \"{package}\"");
            let manifests = ["crates", "tools", "tests"].map(|kind| root().join(kind));
            let folders = manifests.iter().flat_map(|kind| std::fs::read_dir(kind).expect("a folder").flatten());
            let is = |folder: &PathBuf| {
                let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap_or_default();
                manifest.lines().any(|line| line == named)
            };
            folders.map(|entry| entry.path()).find(is)?
        }
    };
    if let Some(program) = after("--test")
        && !folder.join(format!("tests/{program}.rs")).exists()
    {
        return Some(format!("{command}: no test program {program}"));
    }
    let values = ["-p", "--test", "--test-threads"];
    let selectors = typed.iter().enumerate().skip(2).filter(|(at, word)| {
        !word.starts_with('-') && !values.contains(&typed[at - 1].as_str()) && word.parse::<u32>().is_err()
    });
    let missing = selectors.map(|(_, word)| word).find(|word| !selects_a_test(word));
    missing.map(|word| format!("{command}: no test {word}"))
}

#[test]
fn commands_in_prose_are_run_or_listed() {
    let documents = documents();
    let of_blocks: BTreeSet<String> = documents.iter().flat_map(|(_, text)| blocks(text).concat()).collect();
    let (mut wrong, mut seen) = (Vec::new(), of_blocks.clone());
    for (file, text) in &documents {
        for command in of_prose(text) {
            seen.insert(command.clone());
            let is_build = command.starts_with("cargo build");
            if command.starts_with("cargo test") {
                wrong.extend(wrong_test_command(&command));
            } else if !of_blocks.contains(&command) && !is_build && row(&command).is_none() && !is_ours(&command) {
                wrong.push(format!("{}: no row for `{command}`", file));
            }
        }
    }
    for command in OF_PROSE {
        assert!(seen.contains(command), "{command} is in no document");
    }
    for (start, how) in ROWS.iter() {
        assert!(seen.iter().any(|command| command.starts_with(start)), "a row for no command: {start} {how:?}");
        match how {
            Tested(file) => assert!(root().join(file).exists(), "{start}: no {file}"),
            Listed(_, day) => assert!(day.len() == 10 && day.starts_with("20"), "{start}: {day:?} is no day"),
            Ends(..) | Beside(..) => {}
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn scripts_that_documents_name_exist() {
    for (file, text) in documents() {
        let named = of_prose(&text).into_iter().chain(blocks(&text).concat());
        for script in named.filter(|command| command.starts_with(".ci/")) {
            let path = root().join(script.split_whitespace().next().unwrap_or_default());
            let runs = Command::new("test").arg("-x").arg(&path).status().expect("test runs").success();
            assert!(runs, "{}: {script}", file);
        }
    }
}
#[test]
fn code_blocks_are_read_as_commands_without_remarks() {
    let document = "a\n\n```\ncargo run -- x   # a remark\nsaid\nsudo y \\\n    --z\n```\nb\n\n```\nonly text\n```\n\n```\ncargo z\n```\n";
    assert_eq!(blocks(document), [vec!["cargo run -- x", "sudo y --z"], vec!["cargo z"]]);
    assert_eq!(words("say \"two words\" --play"), ["say", "two words", "--play"]);
}
