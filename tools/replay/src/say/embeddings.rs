//! Finds the motions that are nearest to a sentence in the embedding space of a text encoder that the user
//! provides.
//!
//! A folder holds `model.onnx`, `tokenizer.json` (as exporters of Hugging Face models name them) and `motions.npy`:
//! - The encoder takes `input_ids` and `attention_mask`, and `token_type_ids` if it has such an input: int64,
//!   [1, n].
//! - Its output is the one named `sentence_embedding`, or else the first: float32, [1, d] or [1, n, d]. For [1,
//!   n, d] the mean over the tokens that the mask shows is taken.
//! - The matrix is [N, d], floats, with a row for each of the N captions in the order of captions.tsv. A row is
//!   the embedding of the motion or of its caption, depending on the training of the encoder.
//!
//! score = e . m / (|e| |m|), the cosine of sentence and row.

use super::text::{regular, unreadable};
use super::{Match, read};
use ort::environment::Environment;
use ort::session::Session;
use ort::value::Tensor;
use rt::{Exit, Failure};
use std::fmt::Display;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tokenizers::{Encoding, Tokenizer};

/// The files of the folder.
const ENCODER: &str = "model.onnx";
const TOKENIZER: &str = "tokenizer.json";
const MOTIONS: &str = "motions.npy";
/// Name of the preferred output.
const OUTPUT: &str = "sentence_embedding";

fn invalid(file: &str, cause: impl Display) -> Failure {
    Failure::new(Exit::DataErr, format!("{file}: {cause}"))
}

/// Returns the error of a vector that is NaN, infinite, or zero.
fn no_direction(file: &str, what: &str) -> Failure {
    invalid(file, format!("{what} has no direction: a number is NaN or infinite, or all are 0"))
}

pub struct Embeddings {
    session: Session,
    tokenizer: Tokenizer,
    /// One unit vector for each caption, one after the other.
    motions: Vec<f64>,
    columns: usize,
    files: [String; 3],
}

impl Embeddings {
    /// Reads the `folder` for a library of this many captions. `runtime` is onnxruntime's shared library, which
    /// runs its own code.
    pub fn open(folder: &Path, runtime: &Path, captions: usize) -> Result<Self, Failure> {
        let paths = [ENCODER, TOKENIZER, MOTIONS].map(|name| folder.join(name));
        let files = paths.each_ref().map(|path| path.display().to_string());
        for path in &paths {
            regular(path)?;
        }
        let (motions, columns) = read_motions(&paths[2], captions)?;
        let tokenizer = Tokenizer::from_bytes(read(&paths[1])?).map_err(|error| invalid(&files[1], error))?;
        let session = Session::builder(&start(runtime)?).and_then(|mut builder| builder.commit_from_file(&paths[0]));
        let session = session.map_err(|error| refused_by_runtime(&files[0], error))?;
        Ok(Self { session, tokenizer, motions, columns, files })
    }

    /// Returns all captions, the nearest first. Of two equally near ones, the earlier in the library comes
    /// first.
    pub fn find(&mut self, sentence: &str) -> Result<Vec<Match>, Failure> {
        let mut embedding = self.embed(sentence)?;
        let [encoder, _, motions] = &self.files;
        if embedding.len() != self.columns {
            let (columns, width) = (self.columns, embedding.len());
            let cause = format!("rows of {columns} numbers; the encoder's embedding has {width}");
            return Err(invalid(motions, cause));
        }
        if !normalise(&mut embedding) {
            return Err(no_direction(encoder, "the sentence's embedding"));
        }
        let rows = self.motions.chunks_exact(self.columns).enumerate();
        let cosine = |row: &[f64]| row.iter().zip(&embedding).map(|(a, b)| a * b).sum();
        let mut found: Vec<_> = rows.map(|(caption, row)| Match { caption, score: cosine(row) }).collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.caption.cmp(&b.caption)));
        Ok(found)
    }

    fn embed(&mut self, sentence: &str) -> Result<Vec<f64>, Failure> {
        let [encoder, tokenizer, _] = &self.files;
        let tokens = self.tokenizer.encode(sentence, true).map_err(|error| invalid(tokenizer, error))?;
        let mask = tokens.get_attention_mask();
        if mask.iter().all(|&mask| mask == 0) {
            return Err(invalid(tokenizer, "finds no token in the sentence"));
        }
        let failed = |error: ort::Error| refused_by_runtime(encoder, error);
        let mut inputs = Vec::new();
        for input in self.session.inputs() {
            let name = input.name().to_owned();
            let Some(values) = values(&tokens, &name) else {
                let known = "the inputs are input_ids, attention_mask, token_type_ids";
                return Err(invalid(encoder, format!("input `{name}` is unknown; {known}")));
            };
            inputs.push((name, Tensor::from_array(([1, tokens.len()], values)).map_err(failed)?));
        }
        let outputs = self.session.run(inputs).map_err(failed)?;
        let named = outputs.iter().find(|(name, _)| *name == OUTPUT).or_else(|| outputs.iter().next());
        let (name, value) = named.ok_or_else(|| invalid(encoder, "onnxruntime reports: the model has no output"))?;
        let (shape, numbers) = value.try_extract_tensor::<f32>().map_err(failed)?;
        let count = tokens.len();
        match **shape {
            [1, width] if width > 0 => Ok(numbers.iter().copied().map(f64::from).collect()),
            [1, rows, width] if rows == count as i64 && width > 0 => Ok(mean(numbers, numbers.len() / count, mask)),
            _ => Err(invalid(
                encoder,
                format!(
                    "output `{name}` has the shape {:?} for {count} tokens; it must be [1, d] or [1, {count}, d]",
                    shape.to_vec()
                ),
            )),
        }
    }
}

fn refused_by_runtime(encoder: &str, error: ort::Error) -> Failure {
    invalid(encoder, format!("onnxruntime reports: {error}"))
}

fn values(tokens: &Encoding, name: &str) -> Option<Vec<i64>> {
    let numbers = match name {
        "input_ids" => tokens.get_ids(),
        "attention_mask" => tokens.get_attention_mask(),
        "token_type_ids" => tokens.get_type_ids(),
        _ => return None,
    };
    Some(numbers.iter().copied().map(i64::from).collect())
}

/// Returns the mean of the rows that the mask shows. There is at least one.
fn mean(rows: &[f32], width: usize, mask: &[u32]) -> Vec<f64> {
    let shown = || rows.chunks_exact(width).zip(mask).filter(|(_, mask)| **mask > 0).map(|(row, _)| row);
    let count = shown().count() as f64;
    (0..width).map(|i| shown().map(|row| f64::from(row[i])).sum::<f64>() / count).collect()
}

/// Scales the vector to unit length. Returns false if it has no direction.
fn normalise(vector: &mut [f64]) -> bool {
    let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    vector.iter_mut().for_each(|x| *x /= norm);
    norm.is_finite() && norm > 0.0
}

fn read_motions(path: &Path, captions: usize) -> Result<(Vec<f64>, usize), Failure> {
    let file = path.display().to_string();
    let opened = File::open(path).map_err(|error| unreadable(path, &error))?;
    let array = motion::npy::read_npy(BufReader::new(opened)).map_err(|cause| invalid(&file, cause))?;
    let shape = &array.shape;
    let columns = match shape[..] {
        [rows, columns] if rows == captions && columns > 0 => columns,
        _ => {
            let wanted = format!("it must be [{captions}, d], a row for each caption of captions.tsv");
            return Err(invalid(&file, format!("has the shape {shape:?}; {wanted}")));
        }
    };
    let mut motions = array.values;
    for (row, vector) in motions.chunks_exact_mut(columns).enumerate() {
        if !normalise(vector) {
            return Err(no_direction(&file, &format!("row {row}, counted from 0,")));
        }
    }
    Ok((motions, columns))
}

fn start(runtime: &Path) -> Result<Environment, Failure> {
    let refused = |cause: String| {
        let text = format!("{}: is not onnxruntime (1.17 or later): {cause}", runtime.display());
        Failure::new(Exit::Unavailable, text)
    };
    // A path without a folder would be searched in the system's folders.
    let absolute = std::path::absolute(runtime).map_err(|error| refused(error.to_string()))?;
    regular(&absolute)?;
    let builder = ort::init_from(absolute).map_err(|error| refused(error.to_string()))?;
    // Its messages come back as errors. Nothing goes to the terminal or to its makers.
    let builder = builder.with_telemetry(false).with_logger(std::sync::Arc::new(|_, _, _, _, _| ()));
    builder.build().map_err(|error| refused(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_uses_only_the_tokens_of_the_mask() {
        assert_eq!(mean(&[1.0, 2.0, 3.0, 6.0, 100.0, f32::NAN], 2, &[1, 1, 0]), [2.0, 4.0]);
    }
}
