//! Runs the task that this program's name or its first argument chooses.

use clap::Parser;
use replay::cli::{Cli, Task};
use replay::{batch, keyposes, play, say};
use std::process::ExitCode;

fn main() -> ExitCode {
    rt::abort_on_panic();
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
