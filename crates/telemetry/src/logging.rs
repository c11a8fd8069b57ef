//! Destination of the log lines.

use std::io::IsTerminal;
use std::os::unix::fs::MetadataExt;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// A library that logs every message that it receives at INFO. Its warnings are enough.
const CHATTY: &str = "dust_dds";

/// Sends log lines to the journal, with their fields, if stderr goes there. Otherwise sends them to stderr, one
/// line each. It sends none below `level`. A process that has installed its own subscriber keeps it.
pub fn install(level: LevelFilter) {
    let targets = Targets::new().with_default(level).with_target(CHATTY, level.min(LevelFilter::WARN));
    let registry = tracing_subscriber::registry().with(targets);
    let journal = stderr_is_journal().then(|| tracing_journald::layer().ok()).flatten();
    let _ = match journal {
        Some(journal) => registry.with(journal).try_init(),
        None => {
            let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
            registry.with(lines.with_ansi(rt::wants_colour(std::io::stderr().is_terminal())).without_time()).try_init()
        }
    };
}

/// Returns true if stderr goes to the journal. JOURNAL_STREAM names the device and inode of the stream that the
/// service manager connected (systemd.exec(5)). A shell may have inherited the variable, but not the stream.
fn stderr_is_journal() -> bool {
    let Ok(named) = std::env::var("JOURNAL_STREAM") else { return false };
    let stderr = std::fs::metadata("/proc/self/fd/2");
    stderr.is_ok_and(|stderr| named == format!("{}:{}", stderr.dev(), stderr.ino()))
}
