//! Okapi BM25 over the captions of a library.
//!
//! score(query, d) = sum over the query's words w of idf(w) f (k1 + 1) / (f + k1 (1 - b + b |d| / mean |d|)).
//! Here f is the frequency of w in caption d, and idf(w) = ln(1 + (N - n + 0.5) / (n + 0.5)), with w in n of N
//! captions. (S. Robertson and H. Zaragoza, The Probabilistic Relevance Framework: BM25 and Beyond, 2009, with
//! the idf that is never negative.)

use super::{Library, Words};
use std::collections::HashMap;

/// Saturation k1 of repeated words. Like `B` it has the usual value.
const K1: f64 = 1.2;
/// Discount b of long captions.
const B: f64 = 0.75;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    pub caption: usize,
    /// Score. Larger is better: more than zero by words, -1 to 1 by an encoder.
    pub score: f64,
}

pub struct Index {
    /// Captions that have a word, and its frequency in each.
    postings: HashMap<String, Vec<(usize, f64)>>,
    lengths: Vec<f64>,
    mean_length: f64,
}

impl Index {
    pub fn new(library: &Library, words: &Words) -> Self {
        let mut postings: HashMap<String, Vec<(usize, f64)>> = HashMap::new();
        let mut lengths = Vec::new();
        for (caption, entry) in library.captions().iter().enumerate() {
            let text = words.split(&entry.text);
            lengths.push(text.len() as f64);
            for word in text {
                let at = postings.entry(word).or_default();
                match at.last_mut() {
                    Some((last, count)) if *last == caption => *count += 1.0,
                    _ => at.push((caption, 1.0)),
                }
            }
        }
        let mean_length = lengths.iter().sum::<f64>() / (lengths.len() as f64).max(1.0);
        Self { postings, lengths, mean_length }
    }

    /// Returns the captions that have a word of `query`, the best first. Of two equally good ones, the earlier
    /// in the library comes first.
    pub fn find(&self, query: &[String]) -> Vec<Match> {
        let mut scores: HashMap<usize, f64> = HashMap::new();
        for word in query {
            let Some(postings) = self.postings.get(word) else { continue };
            let (all, with) = (self.lengths.len() as f64, postings.len() as f64);
            let idf = (1.0 + (all - with + 0.5) / (with + 0.5)).ln();
            for &(caption, count) in postings {
                let length = self.lengths[caption] / self.mean_length;
                let part = idf * count * (K1 + 1.0) / (count + K1 * (1.0 - B + B * length));
                *scores.entry(caption).or_default() += part;
            }
        }
        let mut found: Vec<_> = scores.into_iter().map(|(caption, score)| Match { caption, score }).collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.caption.cmp(&b.caption)));
        found
    }

    pub fn knows(&self, word: &str) -> bool {
        self.postings.contains_key(word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_scores_match_the_bm25_formula() {
        let library = Library::from_text("captions.tsv", "a\twave wave hand\nb\thand\nc\tclap\n").expect("is good");
        let words = Words::new("");
        let index = Index::new(&library, &words);
        let found = index.find(&words.split("waving hands"));
        // The mean length is 5 / 3. "wave" is in one of three captions, "hand" in two.
        let (idf_wave, idf_hand) = ((1.0_f64 + 2.5 / 1.5).ln(), (1.0_f64 + 1.5 / 2.5).ln());
        let at = |f: f64, length: f64| f * 2.2 / (f + 1.2 * (0.25 + 0.75 * length / (5.0 / 3.0)));
        let expected = [(0, idf_wave * at(2.0, 3.0) + idf_hand * at(1.0, 3.0)), (1, idf_hand * at(1.0, 1.0))];
        assert_eq!(found.len(), 2);
        for (found, (caption, score)) in found.iter().zip(expected) {
            assert_eq!(found.caption, caption);
            assert!((found.score - score).abs() < 1e-12, "{found:?} {score}");
        }
        assert!(index.find(&words.split("fly")).is_empty() && index.find(&[]).is_empty());
        assert!(index.knows("clap") && !index.knows("fly"));
    }
}
