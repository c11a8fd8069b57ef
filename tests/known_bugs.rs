//! Tests that every known bug is a patch that applies to the tree. `.ci/known_bugs` builds each, and the
//! simulation must find it.

use crate::sources::root;
use std::process::Command;

const DOCUMENTS: [&str; 6] =
    ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SAFETY.md", "CHANGELOG.md", "docs/src/evidence.md"];
/// Most lines that a patch removes and adds. A bug is small.
const CHANGED_MAX: usize = 12;

/// Returns the patches by name. Their folder contains nothing else.
fn patches() -> Vec<(String, String)> {
    let entries = std::fs::read_dir(root().join("tests/known_bugs")).expect("the folder of the patches");
    let mut found: Vec<_> = entries
        .map(|entry| {
            let path = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            let stem = name.strip_suffix(".patch").unwrap_or_else(|| panic!("{name} is no patch"));
            assert!(stem.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{name}: words and underscores");
            (name, std::fs::read_to_string(&path).expect("text"))
        })
        .collect();
    found.sort();
    found
}

#[test]
fn every_patch_of_a_known_bug_applies_to_the_tree() {
    // git compares the ceiling below with real paths.
    let root = root().canonicalize().expect("the tree");
    let mut refused = vec![];
    for (name, _) in patches() {
        let mut git = Command::new("git");
        git.args(["apply", "--check", &format!("tests/known_bugs/{name}")]).current_dir(&root);
        // Stops git from using a repository above a tree that has none.
        git.env("GIT_CEILING_DIRECTORIES", root.parent().unwrap_or(&root));
        for variable in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_PREFIX"] {
            git.env_remove(variable);
        }
        let output = git.output().unwrap_or_else(|error| panic!("git: {error}"));
        if !output.status.success() {
            refused.push(String::from_utf8_lossy(&output.stderr).into_owned());
        }
    }
    assert!(refused.is_empty(), "adapt these to the code, so that they still hold the bug:\n{}", refused.concat());
}

/// A patch starts with one sentence that describes the bug. It names a similar public bug, if one is known. If
/// another layer hides the bug from the simulation, it names the test or the fault that finds it. Then follows a small change
/// of one file.
#[test]
fn every_patch_of_a_known_bug_is_described_and_small() {
    for (name, text) in patches() {
        let (header, diff) = text.split_once("\n\ndiff --git a/crates/").unwrap_or_else(|| panic!("{name}: no header"));
        let (what, like) = header.split_once('\n').map_or((header, None), |(what, like)| (what, Some(like)));
        assert!(what.ends_with('.') && what.split(' ').count() >= 4, "{name}: {what:?} is no sentence");
        for like in like.iter().flat_map(|like| like.lines()) {
            let found = ["; found by `cargo test ", "; found by `simulate --fault "];
            if let Some((why, test)) = found.iter().find_map(|by| like.split_once(by)) {
                assert!(why.split(' ').count() >= 4 && test.ends_with("`."), "{name}: {like:?}");
                continue;
            }
            let issue = like.strip_prefix("Resembles ").and_then(|like| like.strip_suffix('.'));
            let (project, number) = issue.and_then(|issue| issue.split_once('#')).unwrap_or_default();
            let named = project.split('/').filter(|part| !part.is_empty()).count() == 2;
            assert!(named && number.parse::<u32>().is_ok(), "{name}: {like:?} names no public bug");
        }
        assert_eq!(diff.matches("\n+++ ").count(), 1, "{name}: a bug is in one file");
        let changed = diff.lines().skip_while(|line| !line.starts_with("@@"));
        let changed = changed.filter(|line| line.starts_with(['+', '-'])).count();
        assert!((1..=CHANGED_MAX).contains(&changed), "{name} changes {changed} lines");
    }
}

/// A number before "bugs" or "known bugs" must be the number of patches.
#[test]
fn documents_give_the_right_number_of_known_bugs() {
    let count = patches().len();
    let mut counts = 0;
    for name in DOCUMENTS {
        let text = std::fs::read_to_string(root().join(name)).expect(name);
        let words: Vec<_> = text.split_whitespace().map(|word| word.trim_end_matches([',', '.', ':'])).collect();
        for (at, _) in words.iter().enumerate().filter(|(_, word)| **word == "bugs") {
            let before = at.checked_sub(1).map(|at| if words[at] == "known" { at.saturating_sub(1) } else { at });
            if let Some(number) = before.and_then(|at| words[at].parse::<usize>().ok()) {
                assert_eq!(number, count, "{name}: the patches in tests/known_bugs");
                counts += 1;
            }
        }
    }
    assert!(counts > 0, "no document says how many known bugs there are");
}
