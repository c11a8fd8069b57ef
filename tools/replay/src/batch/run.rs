//! Processes the whole folder: the files, their order, the threads, and the outcome of each file.

use super::certified;
use super::cli::{Cli, Method};
use super::failed;
use super::manifest::{Entry, Manifest, sha256_file};
use super::output::Writer;
use indicatif::ProgressBar;
use messages::JOINTS_MAX;
use poses::postures::Postures;
use poses::retargeted::{Rate, Retargeted};
use rayon::ThreadPoolBuilder;
use rayon::iter::{ParallelBridge, ParallelIterator};
use robot::Model;
use rt::{Exit, Failure, Shutdown};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Rows between two checks for Ctrl-C: some 20 ms.
const ROWS_PER_CHECK: usize = 512;

/// Largest number of rows of a file: ten hours at 1500 Hz.
const ROWS_MAX: usize = 54_000_000;

enum Outcome {
    /// Made, with this number of postures of both arms, and the reader's warnings.
    Made(u64, Vec<String>),
    Finished,
    Interrupted,
}

#[derive(Debug, Default)]
pub struct Summary {
    pub made: usize,
    pub postures: u64,
    pub finished: usize,
    /// Files without a result, and the reasons, sorted by path.
    pub failed: Vec<(PathBuf, Failure)>,
    /// Files of a readable extension without motion, and the reasons.
    pub no_motion: Vec<(PathBuf, &'static str)>,
    /// Doubts of the readers about the files made now, sorted by path.
    pub warned: Vec<(PathBuf, String)>,
    /// True if Ctrl-C ended it. The next run makes the unfinished files.
    pub interrupted: bool,
}

struct Job {
    input: PathBuf,
    output: PathBuf,
    key: String,
    bytes: u64,
}

/// Row of a trajectory: time, s, and joints, rad or m. Or the number of its frame and what failed.
pub(super) type RowResult = Result<(f64, [f64; JOINTS_MAX]), (usize, &'static str)>;

pub(super) struct Shared<'a> {
    pub(super) cli: &'a Cli,
    /// The settings of `--certified`.
    pub(super) loaded: Option<config::Loaded>,
    model: &'a Model,
    postures: &'a Postures,
    options_sha256: String,
    manifest: Manifest,
    shutdown: &'a Shutdown,
}

/// Retargets every motion file of `input` into `out`. A file that fails is listed, and the others are still
/// processed.
pub fn run(cli: &Cli, shutdown: &Shutdown, progress: &ProgressBar) -> Result<Summary, Failure> {
    let (input, out) = (cli.input.as_path(), cli.out.as_path());
    let (model, postures) = load(cli)?;
    let listing = motion::list(input, cli.recursive).map_err(|error| poses::error::failure(&error))?;
    if listing.files.is_empty() {
        let hint = if cli.recursive { "" } else { " (--recursive looks into its folders)" };
        let text =
            format!("--input {}: no .bvh, .npy, .npz or .mcap in it{hint}; give another folder", input.display());
        return Err(Failure::new(Exit::NoInput, text));
    }
    std::fs::create_dir_all(out).map_err(failed(out, "create the folder"))?;
    apart(cli, input, out)?;
    let mut summary = Summary { no_motion: listing.skipped, ..Summary::default() };
    let jobs = plan(cli, input, out, listing.files, &mut summary);
    let settings = || config::load(&cli.config, config::Overrides::robot(Some(&cli.robot)));
    let loaded = cli.certified.then(settings).transpose().map_err(Failure::with(Exit::Config))?;
    let options_sha256 = options_sha256(cli, &model, loaded.as_ref().map(|loaded| loaded.hash))?;
    let manifest = Manifest::open(out)?;
    let shared = Shared { cli, loaded, model: &model, postures: &postures, options_sha256, manifest, shutdown };
    progress.set_length(jobs.iter().map(|job| job.bytes).sum());
    let outcomes = in_parallel(cli.threads().min(jobs.len()), jobs.len(), |i| {
        let outcome = make(&shared, &jobs[i]);
        progress.inc(jobs[i].bytes);
        outcome
    });
    for (job, outcome) in jobs.into_iter().zip(outcomes) {
        match outcome {
            Ok(Outcome::Made(postures, warnings)) => {
                summary.made += 1;
                summary.postures += postures;
                summary.warned.extend(warnings.into_iter().map(|warning| (job.input.clone(), warning)));
            }
            Ok(Outcome::Finished) => summary.finished += 1,
            Ok(Outcome::Interrupted) => summary.interrupted = true,
            Err(error) => summary.failed.push((job.input, error)),
        }
    }
    summary.failed.sort_by(|a, b| a.0.cmp(&b.0));
    summary.warned.sort();
    Ok(summary)
}

fn load(cli: &Cli) -> Result<(Model, Postures), Failure> {
    let refused = Failure::with(Exit::Config);
    let (model, _) = cli.robot.shipped_file().and_then(|file| config::load_model(&file)).map_err(refused)?;
    let weights = match cli.method {
        // The stages of --certified have the weights of the settings.
        _ if cli.certified => None,
        Method::Network => Some(config::load_weights(&cli.weights(), &model).map_err(refused)?),
        Method::ClosedForm => None,
    };
    let postures = Postures::new(&model, weights, cli.refine_steps);
    Ok((model, postures))
}

/// Rejects outputs that the next run would read as inputs.
fn apart(cli: &Cli, input: &Path, out: &Path) -> Result<(), Failure> {
    let real = |path: &Path| path.canonicalize().map_err(failed(path, "resolve"));
    let (real_input, real_out) = (real(input)?, real(out)?);
    if real_out == real_input || (cli.recursive && real_out.starts_with(&real_input)) {
        let text = format!(
            "--out {} lies in --input {}, so its files would be read as motions; give another --out",
            out.display(),
            input.display()
        );
        return Err(Failure::new(Exit::CantCreate, text));
    }
    Ok(())
}

/// Returns inputs with their outputs. The largest comes first, so that no core waits for it at the end.
fn plan(cli: &Cli, input: &Path, out: &Path, files: Vec<PathBuf>, summary: &mut Summary) -> Vec<Job> {
    let mut taken: HashMap<PathBuf, PathBuf> = HashMap::new();
    let mut jobs = Vec::new();
    for file in files {
        let relative = file.strip_prefix(input).unwrap_or(&file).with_extension(cli.format.name());
        let output = out.join(&relative);
        if let Some(other) = taken.get(&output) {
            let (file_name, out, other) = (file.display(), output.display(), other.display());
            let text = format!("{file_name}: its output {out} is already that of {other}; rename one of them");
            summary.failed.push((file, Failure::new(Exit::Failed, text)));
            continue;
        }
        taken.insert(output.clone(), file.clone());
        let bytes = std::fs::metadata(&file).map_or(0, |metadata| metadata.len());
        jobs.push(Job { input: file, output, key: relative.to_string_lossy().into_owned(), bytes });
    }
    jobs.sort_by_key(|job| std::cmp::Reverse(job.bytes));
    jobs
}

/// Returns one hash of everything except the motion file that affects a result.
fn options_sha256(cli: &Cli, model: &Model, settings: Option<u64>) -> Result<String, Failure> {
    let rate = match cli.rate {
        Rate::Source => "source".to_owned(),
        Rate::Hz(hz) => hz.to_string(),
    };
    let mut text = format!(
        "{} {settings:?} {:?} {rate} {:?} {} {} {} {:?} {:?} {:016x}",
        env!("CARGO_PKG_VERSION"),
        cli.format,
        cli.method,
        cli.refine_steps,
        cli.calibration.name(),
        cli.load.mirror,
        cli.load.up,
        cli.load.frame_rate_hz,
        model.hash,
    );
    let named = [&cli.load.mean, &cli.load.std, &cli.load.map];
    let mut files: Vec<PathBuf> = named.into_iter().flatten().cloned().collect();
    if cli.method == Method::Network && !cli.certified {
        let with = |extension: &str| PathBuf::from(format!("{}.{extension}", cli.weights().display()));
        files.extend([with("toml"), with("safetensors")]);
    }
    for file in files {
        text += " ";
        text += &sha256_file(&file)?;
    }
    Ok(retarget::sha256_hex(text.as_bytes()))
}

/// Runs `count` jobs on `threads` threads. Each thread takes the next job.
fn in_parallel<T: Send>(threads: usize, count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let pool = ThreadPoolBuilder::new().num_threads(threads.max(1)).build().expect("the system gives threads");
    let mut all: Vec<(usize, T)> = pool.install(|| (0..count).par_bridge().map(|i| (i, job(i))).collect());
    all.sort_unstable_by_key(|&(i, _)| i);
    all.into_iter().map(|(_, result)| result).collect()
}

fn make(shared: &Shared<'_>, job: &Job) -> Result<Outcome, Failure> {
    if shared.shutdown.requested() {
        return Ok(Outcome::Interrupted);
    }
    let cli = shared.cli;
    let input_sha256 = sha256_file(&job.input)?;
    if !cli.overwrite && job.output.exists() {
        let output_sha256 = sha256_file(&job.output)?;
        match shared.manifest.get(&job.key, &output_sha256) {
            None => {
                let name = job.output.display();
                let text =
                    format!("{name}: was not written by this tool, or was changed since; --overwrite replaces it");
                return Err(Failure::new(Exit::Failed, text));
            }
            Some(entry) if entry.input_sha256 == input_sha256 && entry.options_sha256 == shared.options_sha256 => {
                return Ok(Outcome::Finished);
            }
            Some(_) => {}
        }
    }
    let motion = motion::load_with(&job.input, &cli.load).map_err(|error| poses::error::failure(&error))?;
    let interrupted = || shared.shutdown.requested();
    let count = if cli.certified {
        let Some((count, rows)) = certified::commands(shared, &job.input, &job.output, &motion, interrupted)? else {
            return Ok(Outcome::Interrupted);
        };
        let rate_hz = f64::from(messages::TICK_HZ as u32);
        written(shared, job, rate_hz, count, rows)?
    } else {
        let trajectory = Retargeted::new(shared.postures, &motion, cli.calibration, cli.rate);
        written(shared, job, trajectory.rate_hz(), trajectory.rows(), trajectory)?
    };
    let Some((mut writer, postures)) = count else { return Ok(Outcome::Interrupted) };
    let output_sha256 = writer.seal()?;
    let (output, options_sha256) = (job.key.clone(), shared.options_sha256.clone());
    // The line comes first. A run that is killed between the two leaves a line too many, but never an unknown
    // file.
    shared.manifest.add(&Entry { output, input_sha256, options_sha256, output_sha256, postures })?;
    writer.move_in_place()?;
    let mut warnings = motion.guesses.warnings;
    warnings.extend(motion.guesses.lost.map(|why| format!("is damaged or truncated: {why}; the rest was written")));
    Ok(Outcome::Made(postures, warnings))
}

/// Writes the rows beside their place, and returns the writer and their number. `None` after Ctrl-C.
fn written(
    shared: &Shared<'_>,
    job: &Job,
    rate_hz: f64,
    count: usize,
    rows: impl Iterator<Item = RowResult>,
) -> Result<Option<(Writer, u64)>, Failure> {
    let file = job.input.display();
    if count > ROWS_MAX {
        let text = format!(
            "{file}: {count} rows at {rate_hz} Hz, at most {ROWS_MAX} are written; give a lower --rate, or split it"
        );
        return Err(Failure::new(Exit::Failed, text));
    }
    let mut writer = Writer::create(&job.output, shared.cli.format, count, rate_hz, &shared.model.joint_names)?;
    for (i, row) in rows.enumerate() {
        let (time_s, q) =
            row.map_err(|(frame, cause)| Failure::new(Exit::Failed, format!("{file}: frame {frame}: {cause}")))?;
        writer.row(time_s, &q)?;
        if i % ROWS_PER_CHECK == 0 && shared.shutdown.requested() {
            return Ok(None);
        }
    }
    Ok(Some((writer, count as u64)))
}
