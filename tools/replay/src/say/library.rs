//! A folder of motions and their captions.

use super::text::read;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Name of the file of captions in the folder.
const CAPTIONS: &str = "captions.tsv";

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caption {
    pub file: String,
    pub text: String,
}

/// Returns the failure of a file, with a place in it or none.
pub(crate) fn invalid(file: &str, cause: &str) -> Failure {
    Failure::new(Exit::DataErr, format!("{file}{cause}"))
}

#[derive(Clone, Debug)]
pub struct Library {
    folder: PathBuf,
    captions: Vec<Caption>,
}

impl Library {
    pub fn open(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join(CAPTIONS);
        let file = path.display().to_string();
        let text = read(&path)?;
        Ok(Self { folder: folder.to_owned(), ..Self::from_text(&file, &text)? })
    }

    /// Reads the text of a `file` of captions, for motions in the current folder. Empty lines and lines that
    /// begin with `#` are ignored.
    pub fn from_text(file: &str, text: &str) -> Result<Self, Failure> {
        let mut captions = Vec::new();
        for (n, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
        {
            let parts = line.split_once('\t').map(|(motion, text)| (motion.trim(), text.trim()));
            let inside = |motion: &str| {
                Path::new(motion).components().all(|part| matches!(part, std::path::Component::Normal(_)))
            };
            match parts {
                Some((motion, text)) if !motion.is_empty() && !text.is_empty() && inside(motion) => {
                    captions.push(Caption { file: motion.to_owned(), text: text.to_owned() });
                }
                _ => {
                    let rule = "must be FILE<tab>CAPTION; the file lies in the folder of the captions";
                    return Err(invalid(file, &format!(", line {}: {rule}", n + 1)));
                }
            }
        }
        if captions.is_empty() {
            return Err(invalid(file, ": no caption; write lines of FILE<tab>CAPTION"));
        }
        Ok(Self { folder: PathBuf::new(), captions })
    }

    pub fn captions(&self) -> &[Caption] {
        &self.captions
    }

    pub fn motion(&self, caption: usize) -> PathBuf {
        self.folder.join(&self.captions[caption].file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_caption_line_is_refused_by_its_number() {
        for text in [
            "a.bvh\twaves\nb.bvh",
            "a.bvh\twaves\n\tno file",
            "a.bvh\twaves\nb.bvh\t ",
            "# x\n../b.bvh\tclaps",
            "\n/b.bvh\tclaps",
        ] {
            let error = Library::from_text("captions.tsv", text).expect_err(text).to_string();
            assert!(error.starts_with("captions.tsv, line 2: "), "{text}: {error}");
        }
        let empty = Library::from_text("captions.tsv", "# nothing\n").expect_err("it has no caption");
        assert_eq!(empty.to_string(), "captions.tsv: no caption; write lines of FILE<tab>CAPTION");
        let good = Library::from_text("captions.tsv", "# remark\n\na.bvh\twaves\r\nsub/b.bvh\t claps\ttwice ")
            .expect("is good");
        let texts: Vec<_> = good.captions().iter().map(|caption| caption.text.as_str()).collect();
        assert_eq!(texts, ["waves", "claps\ttwice"]);
        assert_eq!(good.motion(1), Path::new("sub/b.bvh"));
    }
}
