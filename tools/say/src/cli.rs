//! The command line.

use clap::Parser;
use std::path::PathBuf;

/// Finds the recorded motion that a sentence describes.
#[derive(Debug, Parser)]
#[command(name = "say", version)]
pub struct Cli {
    /// What the person does, for example "wave with the left hand".
    pub sentence: String,
    /// Folder of motions; its captions.tsv has a line FILE<tab>CAPTION for each, or several. A program installed in /usr/bin
    /// defaults to /usr/share/teleopd/motions if that exists.
    #[arg(long, value_name = "DIR", default_value_os_t = pipeline::default_motions())]
    pub library: PathBuf,
    /// Words that mean the same: a line for each meaning, divided by commas (default: synonyms.txt in the library, if it is
    /// there).
    #[arg(long, value_name = "FILE")]
    pub synonyms: Option<PathBuf>,
    /// Folder of a text encoder and the motions' embeddings, instead of words that are the same: model.onnx, tokenizer.json and
    /// motions.npy with a row for each line of captions.tsv.
    #[arg(long, value_name = "DIR", requires = "onnxruntime", conflicts_with = "synonyms")]
    pub embeddings: Option<PathBuf>,
    /// The shared library of onnxruntime, 1.17 or later, that runs the encoder.
    #[arg(long, value_name = "FILE", requires = "embeddings")]
    pub onnxruntime: Option<PathBuf>,
    /// How many motions are shown, 1 to 100.
    #[arg(long, value_name = "K", default_value_t = 5, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub top: u8,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
    /// Has `replay` play the best.
    #[arg(long)]
    pub play: bool,
    /// What else `replay` is told, after --.
    #[arg(last = true, requires = "play", value_name = "REPLAY")]
    pub replay: Vec<String>,
}
