//! Errors before a process is ready.

/// Returned when the set-up fails. Each text says what was requested and what the system answered.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum RtError {
    /// A signal handler could not be installed.
    #[error("signal {signal}: the handler could not be installed: {source}")]
    Signal { signal: i32, source: std::io::Error },
    /// The service manager's socket is named but cannot be used.
    #[error("NOTIFY_SOCKET = \"{socket}\": {source}; the service manager would never see READY=1")]
    NotifySocket { socket: String, source: std::io::Error },
}
