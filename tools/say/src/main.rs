//! The command line program of the library.

use clap::Parser;
use rt::{Exit, Failure};
use say::cli::Cli;
use say::{EmbeddingError, Embeddings, Index, Library, LibraryError, Match, Words, shown};
use std::collections::HashSet;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// Names of the player: in a build folder, and as installed.
const PLAYERS: [&str; 2] = ["replay", "teleop-replay"];

fn main() -> ExitCode {
    rt::abort_on_panic();
    let cli = Cli::parse();
    let outcome = match find(&cli) {
        Ok(Some(motion)) if cli.play => Err(Failure::new(Exit::Unavailable, play(&motion, &cli.replay))),
        found => found.map(|motion| motion.is_some()),
    };
    rt::finish("say", outcome)
}

/// Returns the best motion, if there is one. Prints it and the following ones.
fn find(cli: &Cli) -> Result<Option<PathBuf>, Failure> {
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
        return Err(Failure::new(Exit::Failed, text));
    }
    Ok(found.first().map(|best| library.motion(best.caption)))
}

/// Returns the captions that have words of the sentence, and the words that no caption has.
fn by_words(cli: &Cli, library: &Library) -> Result<(Vec<Match>, Vec<String>), Failure> {
    let words = Words::new(&synonyms(cli)?);
    let index = Index::new(library, &words);
    let query = words.of(&cli.sentence);
    let found = index.find(&query);
    Ok((found, query.into_iter().filter(|word| !index.knows(word)).collect()))
}

/// Returns all captions, by the space of an encoder.
fn by_embeddings(cli: &Cli, library: &Library, folder: &Path, runtime: &Path) -> Result<Vec<Match>, Failure> {
    let embeddings = Embeddings::open(folder, runtime, library.captions().len());
    embeddings.and_then(|mut embeddings| embeddings.find(&cli.sentence)).map_err(|error| match error {
        EmbeddingError::File(error) => refused(error),
        EmbeddingError::Runtime { .. } => Failure::new(Exit::Unavailable, error),
        _ => Failure::new(Exit::DataErr, error),
    })
}

fn synonyms(cli: &Cli) -> Result<String, Failure> {
    let own = cli.library.join("synonyms.txt");
    let path = match &cli.synonyms {
        Some(path) => path,
        None if own.exists() => &own,
        None => return Ok(String::new()),
    };
    say::read(path).map_err(refused)
}

fn refused(error: LibraryError) -> Failure {
    let exit = if matches!(error, LibraryError::Read { .. }) { Exit::NoInput } else { Exit::DataErr };
    Failure::new(exit, error)
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
