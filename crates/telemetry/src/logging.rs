//! Where log lines go.

use std::io::IsTerminal;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// Sends log lines to the journal with their fields where the service manager connected one (JOURNAL_STREAM,
/// systemd.exec(5)), else to stderr, one line each. A process that has installed its own keeps it.
pub fn install() {
    let registry = tracing_subscriber::registry().with(LevelFilter::INFO);
    let journal = std::env::var_os("JOURNAL_STREAM").and_then(|_| tracing_journald::layer().ok());
    let _ = match journal {
        Some(journal) => registry.with(journal).try_init(),
        None => {
            let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false);
            registry.with(lines.with_ansi(std::io::stderr().is_terminal()).without_time()).try_init()
        }
    };
}
