//! Runs the command, and prints its results.

use super::{COSINE_MIN, Cli, Encoder, Index, Library, Match, Words, escaped, read, shown};
use clap::Parser;
use rt::{Exit, Failure};
use std::collections::HashSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

pub fn execute(cli: &Cli) -> ExitCode {
    let outcome = match find(cli) {
        Ok(Some(motion)) if cli.play => {
            let arguments =
                [OsString::from("replay"), motion.into()].into_iter().chain(cli.replay.iter().map(Into::into));
            return crate::play::execute(&mut crate::cli::Cli::parse_from(arguments));
        }
        found => found.map(|motion| motion.is_some()),
    };
    rt::finish("say", outcome)
}

/// Returns the best motion, if there is one. Prints it and the following ones.
fn find(cli: &Cli) -> Result<Option<PathBuf>, Failure> {
    let library = Library::open(&cli.library)?;
    let (found, unknown) = match &cli.encoder {
        Some(path) => (by_meaning(cli, &library, path)?, Vec::new()),
        None => by_words(cli, &library)?,
    };
    let names_nothing = found.is_empty() && unknown.is_empty();
    let (top, found) = (usize::from(cli.top), best(&library, found));
    if cli.json {
        println!("{}", escaped(&format!("{:#}", json(&library, &found, top, &unknown))));
    } else {
        show(&library, &found, top, &unknown);
    }
    if names_nothing {
        let example = &library.captions()[0].text;
        let text = format!(
            "\"{}\" names no movement: words such as \"the\" and \"with\" occur in any caption. Describe what the \
             person does, as in \"{}\"",
            shown(&cli.sentence),
            shown(example)
        );
        return Err(Failure::new(Exit::Failed, text));
    }
    Ok(found.first().map(|best| library.motion(best.caption)))
}

/// Returns the captions that have words of the sentence, and the words that no caption has.
fn by_words(cli: &Cli, library: &Library) -> Result<(Vec<Match>, Vec<String>), Failure> {
    let words = Words::new(&synonyms(cli)?);
    let index = Index::new(library, &words);
    let query = words.split(&cli.sentence);
    let found = index.find(&query);
    Ok((found, query.into_iter().filter(|word| !index.knows(word)).collect()))
}

/// Returns the captions that mean about the same, the nearest first.
fn by_meaning(cli: &Cli, library: &Library, path: &Path) -> Result<Vec<Match>, Failure> {
    let mut found = Encoder::open(path)?.find(library, &cli.sentence)?;
    let nearest = found[0];
    found.retain(|found| found.score >= COSINE_MIN);
    if found.is_empty() {
        let text = format!(
            "no motion of this library is like \"{}\": the nearest, \"{}\", has a cosine of {:.2}, and {COSINE_MIN} is needed; describe what the person does",
            shown(&cli.sentence),
            shown(&library.captions()[nearest.caption].text),
            nearest.score
        );
        return Err(Failure::new(Exit::Failed, text));
    }
    Ok(found)
}

fn synonyms(cli: &Cli) -> Result<String, Failure> {
    let own = cli.library.join("synonyms.txt");
    let path = match &cli.synonyms {
        Some(path) => path,
        None if own.exists() => &own,
        None => return Ok(String::new()),
    };
    read(path)
}

fn best(library: &Library, found: Vec<Match>) -> Vec<Match> {
    let mut seen = HashSet::new();
    found.into_iter().filter(|found| seen.insert(library.captions()[found.caption].file.as_str())).collect()
}

fn json(library: &Library, found: &[Match], top: usize, unknown: &[String]) -> serde_json::Value {
    let one = |found: &Match| {
        let caption = &library.captions()[found.caption];
        serde_json::json!({ "file": caption.file, "caption": caption.text, "score": found.score })
    };
    serde_json::json!({ "found": found.iter().take(top).map(one).collect::<Vec<_>>(), "unknown": unknown })
}

fn show(library: &Library, found: &[Match], top: usize, unknown: &[String]) {
    for found in found.iter().take(top) {
        let caption = &library.captions()[found.caption];
        println!("{:6.2}  {:<24}  {}", found.score, shown(&caption.file), shown(&caption.text));
    }
    if !unknown.is_empty() {
        println!("stems that no caption has: {}", unknown.join(", "));
    }
    if found.is_empty() && !unknown.is_empty() {
        println!("no motion of this library matches");
    }
}
