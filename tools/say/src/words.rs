//! Words of a text: small letters, stems, and one word for those that mean the same.

use rust_stemmers::{Algorithm, Stemmer};
use std::collections::HashMap;

/// What makes words of a text.
pub struct Words {
    stemmer: Stemmer,
    /// The first of a line of synonyms stands for all of them.
    same: HashMap<String, String>,
}

impl Words {
    /// `synonyms`: a line for each meaning, its words divided by commas; what follows a `#` is a remark.
    pub fn new(synonyms: &str) -> Self {
        let mut words = Self { stemmer: Stemmer::create(Algorithm::English), same: HashMap::new() };
        let lines = synonyms.lines().map(|line| line.split('#').next().unwrap_or_default());
        for line in lines {
            let mut stems = line.split(',').flat_map(|word| words.stems(word)).collect::<Vec<_>>().into_iter();
            let Some(first) = stems.next() else { continue };
            // A word of two lines belongs to the first.
            let first = words.same.get(&first).cloned().unwrap_or(first);
            for stem in stems {
                words.same.entry(stem).or_insert_with(|| first.clone());
            }
        }
        words
    }

    /// The words of `text`, in order.
    pub fn of(&self, text: &str) -> Vec<String> {
        self.stems(text).map(|stem| self.same.get(&stem).cloned().unwrap_or(stem)).collect()
    }

    fn stems<'a>(&'a self, text: &'a str) -> impl Iterator<Item = String> + 'a {
        let words = text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
        words.map(|word| self.stemmer.stem(&word.to_lowercase()).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_stems_and_synonyms_are_one() {
        let words = Words::new("wave, greet, hello # to somebody\nwash, scrub\n\n# nothing\nscrub, polish");
        assert_eq!(words.of("He's WAVING, waves; greeted"), ["he", "s", "wave", "wave", "wave"]);
        assert_eq!(words.of("scrubbing polished"), ["wash", "wash"], "a chain of lines is one meaning");
        assert_eq!(words.of(" ,.; "), [""; 0]);
    }
}
