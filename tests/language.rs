//! Plain English as a test: how a doc comment begins, words that hide who acts, and the length of sentences. And the
//! budgets of lines.

use crate::sources;
use std::collections::BTreeMap;

/// A doc comment that begins so names no subject.
const NO_SUBJECT: [&str; 8] = ["Of", "What", "Who", "Whom", "Whose", "Whoever", "Whether", "Whatever"];

/// Returns words or names that say nothing, and better ones.
fn poor(kind: &str) -> BTreeMap<String, String> {
    let mut kinds: BTreeMap<String, _> = toml::from_str(include_str!("language.toml")).expect("two lists");
    kinds.remove(kind).expect("a list")
}

/// Longest sentence, words. A formula counts as none.
const SENTENCE_WORDS_MAX: usize = 30;

/// Budget of lines for each part of the tree: the count of 2026-12-01. Raising one is a decision.
const BUDGETS: [(&str, usize); 3] = [("product", 76_348), ("tools", 28_350), ("tests", 46_943)];

fn rust() -> Vec<(String, String)> {
    let mut all = sources::rust_files();
    assert!(all.len() > 300, "{} files", all.len());
    all.retain(|(name, _)| name != file!());
    all
}

fn documents() -> Vec<(String, String)> {
    let pages = ["README.md", "ARCHITECTURE.md", "SAFETY.md", "SECURITY.md", "CONTRIBUTING.md", "CHANGELOG.md"];
    sources::documents(&pages)
}

/// The text of a line of a doc comment.
fn doc_comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim)
}

/// The paragraphs, list items and table cells of numbered lines, without code. `None` ends a paragraph.
fn paragraphs<'a>(lines: impl Iterator<Item = (usize, Option<&'a str>)>) -> Vec<(usize, String)> {
    let mut all: Vec<(usize, String)> = Vec::new();
    let (mut open, mut code) = (false, false);
    for (number, line) in lines {
        let Some(line) = line else {
            (open, code) = (false, false);
            continue;
        };
        code ^= line.starts_with("```");
        let item = line.starts_with(['-', '*', '#', '|', '<']) || line.starts_with(|c: char| c.is_ascii_digit());
        if code || line.is_empty() || line.starts_with("```") || line.starts_with("<!--") {
            open = false;
        } else if line.starts_with('|') {
            all.extend(line.split('|').map(|cell| (number, cell.trim().to_owned())));
            open = false;
        } else if open && !item {
            let (_, paragraph) = all.last_mut().expect("one is open");
            *paragraph += " ";
            *paragraph += line;
        } else {
            all.push((number, line.to_owned()));
            open = true;
        }
    }
    all
}

fn doc_paragraphs(text: &str) -> Vec<(usize, String)> {
    paragraphs(text.lines().enumerate().map(|(number, line)| (number + 1, doc_comment(line))))
}

fn document_paragraphs(text: &str) -> Vec<(usize, String)> {
    paragraphs(text.lines().enumerate().map(|(number, line)| (number + 1, Some(line.trim()))))
}

/// The text without what stands in backticks.
fn prose(text: &str) -> String {
    text.split('`').enumerate().map(|(n, part)| if n % 2 == 0 { part } else { "X" }).collect()
}

/// Sentences over the longest, with their lengths.
fn long_sentences(paragraph: &str) -> Vec<(usize, String)> {
    let prose = prose(paragraph);
    let sentences = prose.split_inclusive(['.', '!', '?', ':', ';']).fold(vec![String::new()], |mut all, part| {
        let last = all.last_mut().expect("it is never empty");
        // A point inside a number, a name or an abbreviation ends no sentence.
        if last.is_empty() || !part.starts_with(' ') {
            *last += part;
        } else {
            all.push(part.to_owned());
        }
        all
    });
    let formula = |sentence: &str| ["=", "<", ">", "|"].iter().any(|sign| sentence.contains(sign));
    let words = |sentence: &str| sentence.split_whitespace().filter(|word| word.contains(char::is_alphabetic)).count();
    let long = sentences.into_iter().filter(|sentence| words(sentence) > SENTENCE_WORDS_MAX && !formula(sentence));
    long.map(|sentence| (words(&sentence), sentence.trim().to_owned())).collect()
}

#[test]
fn doc_comments_begin_with_their_subject() {
    let mut wrong = Vec::new();
    for (name, text) in rust() {
        let mut before = false;
        for (number, line) in text.lines().enumerate() {
            let comment = doc_comment(line);
            let first = comment.and_then(|comment| comment.split_whitespace().next()).unwrap_or("");
            if !before && NO_SUBJECT.contains(&first) {
                wrong.push(format!("{name}:{}: {}", number + 1, line.trim()));
            }
            before = comment.is_some();
        }
    }
    assert!(wrong.is_empty(), "say who or what it is:\n{}", wrong.join("\n"));
}

#[test]
fn names_are_nouns_of_the_field() {
    let (mut wrong, names) = (Vec::new(), poor("names"));
    for (name, text) in rust() {
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
            let code = format!(" {}", line.split('"').step_by(2).collect::<Vec<_>>().join(" "));
            for (word, better) in &names {
                let starts = [" ", "(", "|", "."].map(|start| format!("{start}{word}"));
                let named = |start: &str| {
                    code.split(start).skip(1).any(|rest| rest.starts_with([':', '(', ',', '|', ')', ';', '.', ' ']))
                };
                if starts.iter().any(|start| named(start)) {
                    wrong.push(format!("{name}:{}: `{word}`: {better}: {}", number + 1, line.trim()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "names:\n{}", wrong.join("\n"));
}

#[test]
fn comments_and_documents_use_the_words_of_the_field() {
    let (mut wrong, poor_words) = (Vec::new(), poor("words"));
    let mut look = |name: &str, number: usize, text: &str| {
        let prose = prose(text).to_lowercase();
        let words: Vec<_> = prose.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
        for (word, better) in &poor_words {
            let parts: Vec<_> = word.split(' ').collect();
            if words.windows(parts.len()).any(|window| window == parts) {
                wrong.push(format!("{name}:{number}: {word:?}; better: {better}"));
            }
        }
    };
    for (name, text) in rust() {
        for (number, line) in text.lines().enumerate().filter(|(_, line)| line.trim_start().starts_with("//")) {
            look(&name, number + 1, line);
        }
    }
    for (name, text) in documents() {
        document_paragraphs(&text).iter().for_each(|(number, paragraph)| look(&name, *number, paragraph));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn sentences_are_short() {
    let mut wrong = Vec::new();
    let mut look = |name: &str, paragraphs: Vec<(usize, String)>| {
        for (number, paragraph) in paragraphs {
            for (words, sentence) in long_sentences(&paragraph) {
                wrong.push(format!("{name}:{number}: {words} words: {sentence}"));
            }
        }
    };
    rust().iter().for_each(|(name, text)| look(name, doc_paragraphs(text)));
    documents().iter().for_each(|(name, text)| look(name, document_paragraphs(text)));
    assert!(wrong.is_empty(), "over {SENTENCE_WORDS_MAX} words:\n{}", wrong.join("\n"));
}

/// Returns the part of [`BUDGETS`] that a file counts for. Examples and benches count for none.
fn part(name: &str) -> Option<&'static str> {
    match name.split_once('/')?.0 {
        _ if name.starts_with("tests/") || name.contains("/tests/") => Some("tests"),
        "crates" if name.starts_with("crates/teleop") || name.contains("/src/") => Some("product"),
        "tools" if name.contains("/src/") => Some("tools"),
        _ => None,
    }
}

#[test]
fn each_part_stays_within_its_budget_of_lines() {
    let files = rust();
    for (name, most) in BUDGETS {
        let counted = files.iter().filter(|(file, _)| part(file) == Some(name));
        let lines: usize = counted.map(|(_, text)| text.lines().count()).sum();
        assert!(lines <= most, "{name}: {lines} lines, the budget is {most}: remove some, or decide on a new budget");
    }
}
