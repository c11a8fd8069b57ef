//! Plays motions, and makes them: `replay` with its subcommands `batch`, `keyposes` and `say`.

#![allow(missing_docs, reason = "the library of a program: only the program, tests and other tools use it")]

pub mod batch;
pub mod cli;
pub mod keyposes;
pub mod play;
pub mod say;

use clap::Parser;
use cli::{Cli, Task};
use std::process::ExitCode;

/// Runs the task that the program's name or its first argument chooses.
pub fn main() -> ExitCode {
    if let Some(task) = std::env::args_os().next().and_then(|program| Task::from_link(&program)) {
        return execute(task);
    }
    let mut cli = Cli::parse();
    match cli.task.take() {
        Some(task) => execute(task),
        None => play::execute(&mut cli),
    }
}

fn execute(task: Task) -> ExitCode {
    match task {
        Task::Batch(cli) => batch::execute(&cli),
        Task::Keyposes(cli) => keyposes::execute(cli),
        Task::Say(cli) => say::execute(&cli),
    }
}
