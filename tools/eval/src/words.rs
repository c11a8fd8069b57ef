//! Measures how well `replay say` finds the caption that a sentence means: the share of sentences for which a right caption is the
//! first (recall at 1), and is among the first five captions that differ (recall at 5); and what nonsense finds.

use crate::cli::Cli;
use crate::run::write_json;
use ::report::print;
use replay::say::{COSINE_MIN, Encoder, Index, Library, Match, Words, read};
use rt::Failure;
use serde_json::json;
use std::collections::HashSet;
use std::fmt;
use std::path::Path;

const SENTENCES: &str = include_str!("../words.tsv");
/// Captions that `say` shows.
const SHOWN: usize = 5;

/// A sentence, and what a right caption has. Nothing is right for nonsense.
struct Asked<'a> {
    right: Vec<&'a str>,
    sentence: &'a str,
}

fn asked() -> impl Iterator<Item = Asked<'static>> {
    let lines = SENTENCES.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_once('\t'));
    lines.map(|(right, sentence)| Asked { right: right.split('|').filter(|it| !it.is_empty()).collect(), sentence })
}

impl Asked<'_> {
    fn is_right(&self, caption: &str) -> bool {
        let caption = caption.to_lowercase();
        self.right.iter().any(|right| caption.contains(right))
    }
}

type Find<'a> = Box<dyn Fn(&str) -> Result<Vec<Match>, Failure> + 'a>;

/// A way to search, and the least score of an answer that `say` shows.
struct Method<'a> {
    name: &'static str,
    score_min: f64,
    find: Find<'a>,
}

/// Returns the rank of the first right caption among those that differ, from 1. `None` beyond those that are shown.
fn rank(library: &Library, found: &[Match], asked: &Asked<'_>) -> Option<usize> {
    let mut seen = HashSet::new();
    let texts = found.iter().map(|found| library.captions()[found.caption].text.as_str());
    let mut shown = texts.filter(|text| seen.insert(text.to_lowercase())).take(SHOWN);
    shown.position(|text| asked.is_right(text)).map(|position| position + 1)
}

fn library(captions: &Path) -> Result<Library, Failure> {
    // Lists of whole databases have motions that nobody described.
    let text = read(captions)?;
    let described = text.lines().filter(|line| line.split_once('\t').is_none_or(|(_, text)| !text.trim().is_empty()));
    let text: String = described.map(|line| format!("{line}\n")).collect();
    Library::from_text(&captions.display().to_string(), &text)
}

pub fn run(cli: &Cli, captions: &Path) -> Result<(), Failure> {
    let library = library(captions)?;
    let words = Words::new("");
    let index = Index::new(&library, &words);
    let encoder = cli.encoder.as_deref().map(Encoder::open).transpose()?;
    let by_words = Box::new(|sentence: &str| Ok(index.find(&words.split(sentence))));
    let mut methods = vec![Method { name: "equal words", score_min: 0.0, find: by_words }];
    if let Some(encoder) = &encoder {
        let find = Box::new(|sentence: &str| encoder.find(&library, sentence));
        methods.push(Method { name: "all-MiniLM-L6-v2", score_min: COSINE_MIN, find });
    }
    let mut rows = Vec::new();
    for Method { name, score_min, find } in methods {
        let (mut ranks, mut firsts, mut nonsense) = (Vec::new(), Vec::new(), Vec::new());
        for asked in asked() {
            let mut found = find(asked.sentence)?;
            let first = found.first().map_or(0.0, |first| first.score);
            if asked.right.is_empty() {
                nonsense.push(first);
                continue;
            }
            if !library.captions().iter().any(|caption| asked.is_right(&caption.text)) {
                continue;
            }
            found.retain(|found| found.score >= score_min);
            let rank = rank(&library, &found, &asked);
            if rank == Some(1) {
                firsts.push(first);
            }
            ranks.push(rank);
        }
        let recall = |most: usize| {
            ranks.iter().filter(|rank| rank.is_some_and(|rank| rank <= most)).count() as f64 / ranks.len() as f64
        };
        if ranks.is_empty() {
            let text = format!("{}: no caption is one that the sentences mean", captions.display());
            return Err(Failure::new(rt::Exit::DataErr, text));
        }
        firsts.sort_by(f64::total_cmp);
        nonsense.sort_by(f64::total_cmp);
        rows.push(json!({
            "method": name, "sentences": ranks.len(), "recall_at_1": recall(1), "recall_at_5": recall(SHOWN),
            "right_first": firsts, "nonsense": nonsense,
        }));
    }
    print(&fmt::from_fn(|f| {
        writeln!(
            f,
            "{} captions of {}, sentences that mean one of them: {}",
            library.captions().len(),
            captions.display(),
            rows[0]["sentences"]
        )?;
        writeln!(f, "{:<20}{:>11}{:>11}  scores: right first / nonsense", "", "recall at 1", "at 5")?;
        rows.iter().try_for_each(|row| {
            let range = |key: &str| {
                let all: Vec<f64> = row[key].as_array().into_iter().flatten().filter_map(|it| it.as_f64()).collect();
                format!("{:.2} to {:.2}", all.first().unwrap_or(&f64::NAN), all.last().unwrap_or(&f64::NAN))
            };
            let share = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            let (one, five) = (share("recall_at_1"), share("recall_at_5"));
            let name = row["method"].as_str().unwrap_or_default();
            writeln!(f, "{name:<20}{one:>11.2}{five:>11.2}  {} / {}", range("right_first"), range("nonsense"))
        })?;
        writeln!(f, "least cosine of an answer: {COSINE_MIN}")
    }));
    write_json(cli, &json!({ "captions": captions.display().to_string(), "methods": rows }))
}
