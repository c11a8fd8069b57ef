//! Splits text into words: lower case, stems, and one word for all synonyms. Stop words are left out, because
//! they occur in captions of every motion and distinguish none.

use rust_stemmers::{Algorithm, Stemmer};
use std::collections::{HashMap, HashSet};

/// Words that name no movement. Words of direction (up, down, out, over, left, both) stay, because captions
/// differ by them.
const STOP_WORDS: &str = "a about an and any are as at be been being but by can do does for from get gets had has have he her \
    him his how i if in into is it its let lets me my no not of on one or our people person please s she should so some somebody \
    someone t than that the their them then there they this to us was we were what when which while who will with would you your";

pub struct Words {
    stemmer: Stemmer,
    /// Maps each synonym to the first word of its line.
    same: HashMap<String, String>,
    stop: HashSet<&'static str>,
}

impl Words {
    /// Reads `synonyms`: a line for each meaning, with words separated by commas. Text after a `#` is ignored.
    pub fn new(synonyms: &str) -> Self {
        let stop = STOP_WORDS.split_whitespace().collect();
        let mut words = Self { stemmer: Stemmer::create(Algorithm::English), same: HashMap::new(), stop };
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

    /// Returns the words of `text` without stop words, in order.
    pub fn split(&self, text: &str) -> Vec<String> {
        self.stems(text).map(|stem| self.same.get(&stem).cloned().unwrap_or(stem)).collect()
    }

    fn stems<'a>(&'a self, text: &'a str) -> impl Iterator<Item = String> + 'a {
        let words = text.split(|c: char| !c.is_alphanumeric()).map(str::to_lowercase);
        let words = words.filter(|word| !word.is_empty() && !self.stop.contains(word.as_str()));
        words.map(|word| self.stemmer.stem(&word).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_stemmed_and_synonyms_are_merged() {
        let words = Words::new("wave, greet, hello # to somebody\nwash, scrub\n\n# nothing\nscrub, polish");
        assert_eq!(words.split("He's WAVING, waves; greeted"), ["wave", "wave", "wave"]);
        assert_eq!(words.split("the person is with somebody"), [""; 0], "stop words");
        assert_eq!(words.split("both hands up and out"), ["both", "hand", "up", "out"], "directions are none");
        assert_eq!(words.split("scrubbing polished"), ["wash", "wash"], "a chain of lines is one meaning");
        assert_eq!(words.split(" ,.; "), [""; 0]);
    }
}
