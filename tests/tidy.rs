//! Project rules as tests: direction of dependencies, bans in the pure crates, lengths, and tables that must name
//! each other.

use crate::sources::{self, metadata, root, rust_files};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Crates that never do IO, never read a clock and never block.
const PURE: &str = "\
    schema perceptron messages robot layouts skeleton retarget follow wbc safety driver plant checker ingest explain control \
    link";

/// Packages that a pure crate must not depend on, even indirectly.
const NOT_FROM_PURE: [&str; 7] = ["rt", "bus", "iceoryx2", "libc", "tokio", "rustix", "getrandom"];

/// The packages of the workspace that each one may depend on.
#[derive(Deserialize)]
struct Tables {
    may_depend_on: BTreeMap<String, BTreeSet<String>>,
    may_use: BTreeMap<String, BTreeSet<String>>,
}

/// A pure crate's line that forbids the clocks, threads, locks and IO of `clippy.toml`. Nothing in the crate can allow
/// them again.
const FORBIDS: &str = "#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]";

/// Locations that may use `unsafe`: system calls and the counting allocator, shared memory, and the matrix
/// product's pointers.
const UNSAFE_MAY_STAND_IN: [&str; 3] = ["crates/rt/", "crates/bus/", "tools/train/src/gemm.rs"];

const FILE_LINES_MAX: usize = 500;
const FUNCTION_LINES_MAX: usize = 70;

/// Returns the resolved graph of normal dependencies: package name -> names.
fn graph() -> BTreeMap<String, BTreeSet<String>> {
    let metadata = metadata();
    let mut names = BTreeMap::new();
    for package in metadata["packages"].as_array().expect("packages") {
        names.insert(package["id"].as_str().unwrap().to_owned(), package["name"].as_str().unwrap().to_owned());
    }
    let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for node in metadata["resolve"]["nodes"].as_array().expect("nodes") {
        let entry = graph.entry(names[node["id"].as_str().unwrap()].clone()).or_default();
        for dependency in node["deps"].as_array().expect("deps") {
            if dependency["dep_kinds"].as_array().unwrap().iter().any(|kind| kind["kind"].is_null()) {
                entry.insert(names[dependency["pkg"].as_str().unwrap()].clone());
            }
        }
    }
    graph
}

#[test]
fn crates_depend_only_on_the_allowed_crates() {
    let graph = graph();
    let Tables { may_depend_on, may_use } = toml::from_str(include_str!("tidy.toml")).expect("the tables");
    let tools: BTreeSet<&str> = may_use.keys().map(String::as_str).chain(["teleopd"]).collect();
    let ours: BTreeSet<&str> = may_depend_on.keys().map(String::as_str).chain(tools.iter().copied()).collect();
    let crates = may_depend_on.iter().map(|row| (row, &ours));
    for ((package, allowed), watched) in crates.chain(may_use.iter().map(|row| (row, &tools))) {
        let edges = graph.get(package).unwrap_or_else(|| panic!("no package {package}: mend the table"));
        for edge in edges.iter().filter(|edge| watched.contains(edge.as_str())) {
            assert!(allowed.contains(edge), "{package} must not depend on {edge}");
        }
    }
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    let names = packages.filter(|package| package["source"].is_null()).filter_map(|package| package["name"].as_str());
    let unlisted: Vec<_> = names.filter(|name| !ours.contains(name)).collect();
    assert_eq!(unlisted, ["features"], "packages without a row");
}

/// Dev-dependencies and build dependencies count too.
#[test]
fn crates_and_the_root_depend_on_no_tool() {
    let metadata = metadata();
    let ours = |package: &&serde_json::Value| package["source"].is_null();
    let mut found = BTreeSet::new();
    for package in metadata["packages"].as_array().expect("packages").iter().filter(ours) {
        let manifest = Path::new(package["manifest_path"].as_str().unwrap());
        let place = manifest.strip_prefix(root()).expect("below the root");
        if !place.starts_with("crates") && place != Path::new("Cargo.toml") {
            continue;
        }
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            if dependency["path"].as_str().is_some_and(|path| Path::new(path).starts_with(root().join("tools"))) {
                found.insert((package["name"].as_str().unwrap(), dependency["name"].as_str().unwrap()));
            }
        }
    }
    assert!(found.is_empty(), "a crate and its tool: {found:?}");
}

/// Returns everything that `package` is built from on this machine, with the features that it requests itself.
fn built_from(package: &str) -> BTreeSet<String> {
    let text = sources::cargo(&["tree", "--package", package, "--edges", "normal", "--prefix", "none"]);
    text.lines().filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
}

#[test]
fn pure_crates_depend_on_no_io_package() {
    for package in PURE.split(' ') {
        let reached = built_from(package);
        assert!(reached.contains(package), "{package}: {reached:?}");
        for banned in NOT_FROM_PURE {
            assert!(!reached.contains(banned), "{package} reaches {banned}");
        }
    }
}

/// The operator's client must stay small: it stops the robot, whatever became of the daemon.
#[test]
fn operators_client_links_no_control() {
    let reached = built_from("teleopctl");
    assert!(reached.contains("operator") && !reached.contains("wbc") && !reached.contains("control"), "{reached:?}");
}

#[test]
fn pure_crates_document_and_avoid_forbidden_calls() {
    for package in PURE.split(' ') {
        let lib = std::fs::read_to_string(root().join(format!("crates/{package}/src/lib.rs"))).expect("lib.rs");
        let opening: String = lib.lines().take_while(|line| line.starts_with("//!")).collect();
        assert!(opening.to_lowercase().contains("never"), "{package}: the first doc says what the crate never does");
        assert!(lib.lines().any(|line| line == FORBIDS), "{package}: lib.rs has the line {FORBIDS}");
    }
}

#[test]
fn files_and_functions_stay_short() {
    let mut long = Vec::new();
    for (name, text) in rust_files() {
        let lines: Vec<&str> = text.lines().collect();
        if lines.len() > FILE_LINES_MAX {
            long.push(format!("{name}: {} lines", lines.len()));
        }
        let mut open: Option<(usize, usize, String)> = None;
        for (number, line) in lines.iter().enumerate() {
            let indent = line.len() - line.trim_start().len();
            match &open {
                None => {
                    let head = line.trim_start();
                    let is_function =
                        ["fn ", "pub fn ", "pub(crate) fn ", "pub(super) fn ", "const fn ", "pub const fn "]
                            .iter()
                            .any(|start| head.starts_with(start));
                    if is_function && !line.trim_end().ends_with('}') && !line.trim_end().ends_with(';') {
                        open = Some((number, indent, head.to_owned()));
                    }
                }
                Some((start, depth, head)) => {
                    if indent == *depth && line.trim_start().starts_with('}') {
                        if number - start + 1 > FUNCTION_LINES_MAX {
                            long.push(format!("{name}:{}: {} lines: {head}", start + 1, number - start + 1));
                        }
                        open = None;
                    }
                }
            }
        }
    }
    assert!(
        long.is_empty(),
        "over {FILE_LINES_MAX} lines a file or {FUNCTION_LINES_MAX} a function:\n{}",
        long.join("\n")
    );
}

/// Otherwise a tool continues after one of its threads panicked, and reports wrong results.
#[test]
fn every_program_that_runs_threads_aborts_on_a_panic() {
    let mut seen = 0;
    for (name, text) in rust_files() {
        let Some(folder) = name.strip_suffix("src/main.rs").filter(|folder| folder.starts_with("tools/")) else {
            continue;
        };
        let manifest = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).expect("a manifest");
        if manifest.lines().any(|line| line.starts_with("rt.") || line.starts_with("rt =")) {
            seen += 1;
            let first = text.split_once("fn main() -> ExitCode {\n").map(|(_, body)| body.trim_start());
            assert!(first.is_some_and(|body| body.starts_with("rt::abort_on_panic();")), "{name}");
        }
    }
    assert!(seen > 8, "{seen} programs");
}

#[test]
fn unsafe_code_stands_only_in_allowed_places() {
    for (name, text) in rust_files() {
        let allowed = UNSAFE_MAY_STAND_IN.iter().any(|place| name.contains(place)) || name == "tests/tidy.rs";
        for (number, line) in text.lines().enumerate() {
            let code = line.split("//").next().unwrap_or("");
            let found = code.contains("unsafe ") || code.contains("allow(unsafe_code)");
            assert!(allowed || !found, "{name}:{}: unsafe outside rt and bus", number + 1);
        }
    }
}

/// One file may read it to name an incarnation, one to stamp what only watchers read. Nothing is ever timed with it.
#[test]
fn f030_only_the_incarnation_and_what_people_see_read_the_wall_clock() {
    let clocks = ["SystemTime", "UNIX_EPOCH", "CLOCK_REALTIME", "CLOCK_TAI", "ClockId::Realtime", "ClockId::Tai"];
    let readers: BTreeSet<String> = rust_files()
        .into_iter()
        .filter(|(name, source)| name.starts_with("crates/") && clocks.iter().any(|clock| source.contains(clock)))
        .map(|(name, _)| name)
        .collect();
    let may = ["ros2/src/states.rs", "rt/src/incarnation.rs", "teleopd/commission/console.rs"];
    assert_eq!(readers, may.map(|file| format!("crates/{file}")).into());
}

#[test]
fn parry_is_named_in_one_file_of_robot() {
    let naming: Vec<_> = rust_files()
        .into_iter()
        .filter(|(name, text)| {
            name.starts_with("crates/") && name.contains("/src/") && text.contains(concat!("parry3d", "_f64"))
        })
        .map(|(name, _)| name)
        .collect();
    assert!(naming.len() <= 1 && naming.iter().all(|name| name.starts_with("crates/robot/")), "parry in {naming:?}");
}

/// Every fault has a row, and the last cell of a row names a test.
#[test]
fn every_test_that_the_safety_document_names_exists() {
    let text = std::fs::read_to_string(root().join("SAFETY.md")).expect("SAFETY.md");
    for row in &messages::FAULTS {
        let named = text.lines().find(|line| line.starts_with('|') && line.contains(&format!("`{}`", row.name)));
        let test = named.and_then(|line| line.trim_end_matches(['|', ' ']).rsplit('|').next()).unwrap_or("");
        let (file, function) = test.trim().trim_start_matches('`').split_once("` ").unwrap_or((test, ""));
        let source = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        assert!(source.contains(&format!("fn {function}()")), "{}: no test {function:?} in {file:?}", row.name);
    }
    // Takes every table row that ends with a file and a function.
    let rows = text.lines().filter(|line| line.starts_with('|'));
    let cells = rows.filter_map(|line| line.trim_end_matches(['|', ' ']).rsplit('|').next());
    let tests = cells.filter_map(|cell| cell.trim().strip_prefix('`')?.split_once("` "));
    let named: Vec<_> = tests.filter(|(file, _)| file.ends_with(".rs")).collect();
    assert!(named.len() >= messages::FAULTS.len() + 10, "{} rows", named.len());
    for (file, function) in named {
        let source = std::fs::read_to_string(root().join(file)).unwrap_or_default();
        assert!(source.contains(&format!("fn {function}()")), "no test {function:?} in {file:?}");
    }
}

/// Returns the ids in a name, such as `f021` in `f021_f069_silence_stops`: words of `f` and three digits.
fn hazard_ids(name: &str) -> impl Iterator<Item = &str> {
    name.split('_')
        .filter(|word| word.len() == 4 && word.starts_with('f') && word[1..].bytes().all(|byte| byte.is_ascii_digit()))
}

/// Returns the names of all tests whose source is in the tree.
fn test_names() -> Vec<String> {
    let mut names = Vec::new();
    for (_, source) in rust_files() {
        let mut is_test = false;
        for line in source.lines().map(str::trim) {
            if line == "#[test]" {
                is_test = true;
            } else if let Some(rest) = line.strip_prefix("fn ").filter(|_| is_test) {
                names.extend(rest.split('(').next().map(str::to_owned));
                is_test = false;
            }
        }
    }
    names
}

#[test]
fn every_hazard_id_in_a_test_name_is_in_the_list() {
    let names = test_names();
    assert!(names.len() > 500, "only {} tests were found", names.len());
    let carried: BTreeSet<&str> = names.iter().flat_map(|name| hazard_ids(name)).collect();
    let known: BTreeSet<&str> = hazards::all().map(|hazard| hazard.id.as_str()).collect();
    let unknown: Vec<_> = carried.difference(&known).collect();
    assert!(unknown.is_empty(), "tests name ids that are not in the list: {unknown:?}");
}

#[test]
fn every_answered_hazard_has_a_test_and_no_struck_one_has() {
    let names = test_names();
    let carried: BTreeSet<&str> = names.iter().flat_map(|name| hazard_ids(name)).collect();
    let (mut bare, mut struck) = (Vec::new(), Vec::new());
    for hazard in hazards::all() {
        match (&hazard.answer, carried.contains(hazard.id.as_str())) {
            (hazards::Answer::Does { .. }, false) => bare.push((&hazard.id, &hazard.what)),
            (hazards::Answer::Struck { .. }, true) => struck.push((&hazard.id, &hazard.what)),
            _ => {}
        }
    }
    assert!(bare.is_empty(), "no test carries the id of: {bare:#?}");
    assert!(struck.is_empty(), "struck, and still there is a test: {struck:#?}");
}

/// If one program holds the tests of many files, it must hold all of them.
#[test]
fn every_test_file_is_compiled_by_a_test_program() {
    let files = rust_files();
    let programs = files.iter().filter(|(name, _)| name.ends_with("/tests/all.rs"));
    for (name, all) in programs {
        let folder = name.trim_end_matches("all.rs");
        let manifest = root().join(folder).join("../Cargo.toml");
        let manifest = std::fs::read_to_string(&manifest).expect("a manifest");
        let stems = files.iter().filter_map(|(file, _)| file.strip_prefix(folder)?.strip_suffix(".rs"));
        for stem in stems.filter(|stem| !stem.contains('/')) {
            let alone = manifest.contains(&format!("\nname = \"{stem}\"\n"));
            assert!(alone || all.contains(&format!("\nmod {stem};")), "{folder}{stem}.rs is compiled by nothing");
        }
    }
}

/// Files of the repository, and motions to play, must exist. Files that the commands write are exceptions.
#[test]
fn files_that_readme_and_book_name_exist() {
    const WRITTEN: [&str; 3] = ["config/contact.toml", "config/operators/anna.toml", "weights/mine"];
    let text: String = sources::documents(&["README.md"]).into_iter().map(|(_, text)| text).collect();
    let words = text.split(|c: char| c.is_whitespace() || "`()[]\"',;=".contains(c));
    let words = words.map(|word| word.trim_end_matches(['.', ':']).split([':', '@']).next().unwrap_or(word));
    let folders = ["crates/", "tools/", "tests/", "config/", "weights/", ".ci/", "./tools/"];
    let is_file = |word: &&str| folders.iter().any(|folder| word.starts_with(folder)) || word.ends_with(".bvh");
    let named: BTreeSet<&str> = words.filter(is_file).filter(|word| *word != ".bvh").collect();
    assert!(named.len() > 20, "{named:?}");
    // A network consists of two files, and the documents give their common name.
    let exists = |name: &&&str| root().join(name).exists() || root().join(format!("{name}.safetensors")).exists();
    let missing: Vec<_> = named.iter().filter(|name| !WRITTEN.contains(name) && !exists(name)).collect();
    assert!(missing.is_empty(), "files that are not there: {missing:?}");
}

#[test]
fn readme_gives_the_test_command() {
    let text = std::fs::read_to_string(root().join("README.md")).expect("README.md");
    assert!(text.contains("cargo test --release --workspace"));
    assert!(text.contains("cargo run --release -- demo"));
}
