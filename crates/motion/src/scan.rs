//! Splits a text into words with line numbers. Never copies, never needs UTF-8.

use crate::error::BvhError;

/// Iterates over the words of a file.
#[derive(Clone, Copy)]
pub(crate) struct Scan<'a> {
    text: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Scan<'a> {
    pub(crate) fn new(text: &'a [u8]) -> Self {
        // A byte order mark does not belong to the first word.
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        Self { text, at: 0, line: 1 }
    }

    /// Line of the next word or of the end.
    pub(crate) fn line(&mut self) -> usize {
        self.skip_space();
        self.line
    }

    /// Number of bytes not yet read.
    pub(crate) fn rest(&self) -> usize {
        self.text.len() - self.at
    }

    fn skip_space(&mut self) {
        while let Some(&byte) = self.text.get(self.at) {
            if byte == b'\n' {
                self.line += 1;
            } else if !is_space(byte) {
                break;
            }
            self.at += 1;
        }
    }

    /// Returns the next word, if there is one.
    pub(crate) fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let rest = &self.text[self.at..];
        let length = rest.iter().position(|&byte| is_space(byte)).unwrap_or(rest.len());
        self.at += length;
        (length > 0).then(|| &rest[..length])
    }

    /// Returns the next word. Returns an error at the end of the text.
    pub(crate) fn expect_word(&mut self, expected: &'static str) -> Result<&'a [u8], BvhError> {
        self.word().ok_or(BvhError::Truncated { line: self.line, expected })
    }

    /// Returns the rest of this line, trimmed. Names may contain spaces.
    pub(crate) fn rest_of_line(&mut self) -> &'a [u8] {
        let rest = &self.text[self.at..];
        let length = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        // A brace on the same line belongs to the grammar.
        let length = rest[..length].iter().position(|&b| b == b'{').unwrap_or(length);
        self.at += length;
        rest[..length].trim_ascii()
    }

    /// Expects this word, whatever its case.
    pub(crate) fn expect(&mut self, word: &'static str) -> Result<(), BvhError> {
        let found = self.expect_word(word)?;
        if found.eq_ignore_ascii_case(word.as_bytes()) { Ok(()) } else { Err(self.unexpected(found, word)) }
    }

    /// Expects this word and a colon, which may stand apart, and before a number without a blank.
    pub(crate) fn expect_label(&mut self, label: &'static str) -> Result<(), BvhError> {
        self.skip_space();
        let word = label.trim_end_matches(':');
        let begins =
            self.text[self.at..].get(..word.len()).is_some_and(|text| text.eq_ignore_ascii_case(word.as_bytes()));
        let before = self.at;
        self.at += if begins { word.len() } else { 0 };
        self.skip_space();
        if begins && self.text.get(self.at) == Some(&b':') {
            self.at += 1;
            return Ok(());
        }
        self.at = before;
        let found = self.expect_word(label)?;
        Err(self.unexpected(found, label))
    }

    /// Returns the error for this word, the last one read. A file may have been cut within its last word.
    pub(crate) fn unexpected(&self, found: &[u8], expected: &'static str) -> BvhError {
        if self.rest() == 0 && self.line > 1 {
            return BvhError::Truncated { line: self.line, expected };
        }
        BvhError::Unexpected { line: self.line, found: excerpt(found), expected }
    }

    /// Numbers of the lines that follow and their counts of words. Lines without words are left out.
    pub(crate) fn lines(self) -> impl Iterator<Item = (usize, usize)> + Clone {
        let words = |line: &[u8]| line.split(|&byte| is_space(byte)).filter(|word| !word.is_empty()).count();
        let lines = self.text[self.at..].split(|&byte| byte == b'\n').enumerate();
        lines.map(move |(n, line)| (self.line + n, words(line))).filter(|&(_, words)| words > 0)
    }

    /// Returns the next word as a number, which may be infinite or NaN.
    pub(crate) fn any_number(&mut self, what: &'static str) -> Result<f64, BvhError> {
        let word = self.expect_word(what)?;
        // Some exporters write the decimal comma of their user's language.
        let parse = |text: &str| text.parse().or_else(|_| text.replacen(',', ".", 1).parse::<f64>()).ok();
        let value = std::str::from_utf8(word).ok().and_then(parse);
        value.ok_or_else(|| BvhError::NotANumber { line: self.line, found: excerpt(word), what })
    }

    /// Returns the next word as a finite number of at most `bound`.
    pub(crate) fn number(&mut self, what: &'static str, bound: f64) -> Result<f64, BvhError> {
        let value = self.any_number(what)?;
        if value.is_finite() && value.abs() <= bound {
            Ok(value)
        } else {
            Err(BvhError::OutOfRange { line: self.line, what, value, bound })
        }
    }

    /// Returns the next word as a whole number from `low` to `high`.
    pub(crate) fn count(&mut self, what: &'static str, low: u64, high: u64) -> Result<u64, BvhError> {
        let word = self.expect_word(what)?;
        let value = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
        value.filter(|value| (low..=high).contains(value)).ok_or_else(|| {
            let found = excerpt(word);
            BvhError::NotACount { line: self.line, what, found, low, high }
        })
    }
}

/// Returns true for white space, and for the bytes that fill a file of a disk or end one of DOS.
fn is_space(byte: u8) -> bool {
    byte.is_ascii_whitespace() || matches!(byte, 0 | 0x0b | 0x1a)
}

/// Returns at most 40 characters of a word. Accepts any bytes.
pub(crate) fn excerpt(word: &[u8]) -> String {
    shortened(word, 40)
}

/// Returns at most `most` characters of a word.
pub(crate) fn shortened(word: &[u8], most: usize) -> String {
    String::from_utf8_lossy(word).chars().take(most).map(|c| if c.is_control() { '?' } else { c }).collect()
}
