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
    /// Folder of a text encoder and the motions' embeddings. They replace the search by equal words. It has
    /// model.onnx, tokenizer.json and motions.npy with a row for each line of captions.tsv.
    #[arg(long, value_name = "DIR", requires = "onnxruntime", conflicts_with = "synonyms")]
    pub embeddings: Option<PathBuf>,
    /// Shared library of onnxruntime, 1.17 or later, which runs the encoder.
    #[arg(long, value_name = "FILE", requires = "embeddings")]
    pub onnxruntime: Option<PathBuf>,
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
