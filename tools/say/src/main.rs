//! The command line program of the library.

use clap::Parser;
use say::cli::Cli;
use say::{EmbeddingError, Embeddings, Index, Library, LibraryError, Match, Words, shown};
use std::collections::HashSet;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Exit code if no motion was found.
const EX_FAILED: u8 = 1;
/// Exit codes of sysexits(3).
const EX_DATAERR: u8 = 65;
const EX_NOINPUT: u8 = 66;
const EX_UNAVAILABLE: u8 = 69;

/// Names of the player: in a build folder, and as installed.
const PLAYERS: [&str; 2] = ["replay", "teleop-replay"];

fn main() -> ExitCode {
    let cli = Cli::parse();
    match find(&cli) {
        Ok(Some(motion)) if cli.play => fail(EX_UNAVAILABLE, &play(&motion, &cli.replay)),
        Ok(Some(_)) => ExitCode::SUCCESS,
        Ok(None) => ExitCode::FAILURE,
        Err((code, text)) => fail(code, &text),
    }
}

fn fail(code: u8, text: &str) -> ExitCode {
    eprintln!("say: {text}");
    ExitCode::from(code)
}

/// Returns the best motion, if there is one. Prints it and the following ones.
fn find(cli: &Cli) -> Result<Option<PathBuf>, (u8, String)> {
    let library = Library::open(&cli.library).map_err(refused)?;
    let (found, unknown) = match (&cli.embeddings, &cli.onnxruntime) {
        (Some(folder), Some(runtime)) => (by_embeddings(cli, &library, folder, runtime)?, Vec::new()),
        _ => by_words(cli, &library)?,
    };
    let names_nothing = found.is_empty() && unknown.is_empty();
    let (top, found) = (usize::from(cli.top), best(&library, found));
    if cli.json {
        println!("{}", say::escaped(&format!("{:#}", json(&library, &found, top, &unknown))));
    } else {
        show(&library, &found, top, &unknown);
    }
    if names_nothing {
        let example = &library.captions()[0].text;
        let text = format!(
            "\"{}\" names no movement: words such as \"the\" and \"with\" occur in any caption. Describe what the \
             person does, as in \"{}\"",
            shown(&cli.sentence),
            shown(example)
        );
        return Err((EX_FAILED, text));
    }
    Ok(found.first().map(|best| library.motion(best.caption)))
}

/// Returns the captions that have words of the sentence, and the words that no caption has.
fn by_words(cli: &Cli, library: &Library) -> Result<(Vec<Match>, Vec<String>), (u8, String)> {
    let words = Words::new(&synonyms(cli)?);
    let index = Index::new(library, &words);
    let query = words.of(&cli.sentence);
    let found = index.find(&query);
    Ok((found, query.into_iter().filter(|word| !index.knows(word)).collect()))
}

/// Returns all captions, by the space of an encoder.
fn by_embeddings(cli: &Cli, library: &Library, folder: &Path, runtime: &Path) -> Result<Vec<Match>, (u8, String)> {
    let embeddings = Embeddings::open(folder, runtime, library.captions().len());
    embeddings.and_then(|mut embeddings| embeddings.find(&cli.sentence)).map_err(|error| match error {
        EmbeddingError::File(error) => refused(error),
        EmbeddingError::Runtime { .. } => (EX_UNAVAILABLE, error.to_string()),
        _ => (EX_DATAERR, error.to_string()),
    })
}

fn synonyms(cli: &Cli) -> Result<String, (u8, String)> {
    let own = cli.library.join("synonyms.txt");
    let path = match &cli.synonyms {
        Some(path) => path,
        None if own.exists() => &own,
        None => return Ok(String::new()),
    };
    say::read(path).map_err(refused)
}

fn refused(error: LibraryError) -> (u8, String) {
    (if matches!(error, LibraryError::Read { .. }) { EX_NOINPUT } else { EX_DATAERR }, error.to_string())
}

/// Keeps the best caption of every motion.
fn best(library: &Library, found: Vec<Match>) -> Vec<Match> {
    let mut seen = HashSet::new();
    found.into_iter().filter(|found| seen.insert(library.captions()[found.caption].file.as_str())).collect()
}

fn json(library: &Library, found: &[Match], top: usize, unknown: &[String]) -> serde_json::Value {
    let one = |found: &Match| {
        let caption = &library.captions()[found.caption];
        serde_json::json!({ "file": caption.file, "caption": caption.text, "score": found.score })
    };
    serde_json::json!({ "found": found.iter().take(top).map(one).collect::<Vec<_>>(), "unknown": unknown })
}

fn show(library: &Library, found: &[Match], top: usize, unknown: &[String]) {
    for found in found.iter().take(top) {
        let caption = &library.captions()[found.caption];
        println!("{:6.2}  {:<24}  {}", found.score, shown(&caption.file), shown(&caption.text));
    }
    if !unknown.is_empty() {
        println!("stems that no caption has: {}", unknown.join(", "));
    }
    if found.is_empty() && !unknown.is_empty() {
        println!("no motion of this library matches");
    }
}

/// Replaces this process by `replay`, so that ending `say` also ends the player. Returns the error if that
/// fails.
fn play(motion: &Path, arguments: &[String]) -> String {
    match player() {
        Ok(player) => format!("{}: {}", player.display(), Command::new(&player).arg(motion).args(arguments).exec()),
        Err(why) => why,
    }
}

fn player() -> Result<PathBuf, String> {
    let own = std::env::current_exe().map_err(|error| error.to_string())?;
    let folder = own.parent().unwrap_or(Path::new("/"));
    let missing = || {
        format!("{}: the program `replay` is missing; build it with cargo build --release -p replay", folder.display())
    };
    PLAYERS.map(|name| folder.join(name)).into_iter().find(|path| path.is_file()).ok_or_else(missing)
}
