//! Words to motion, in the simplest complete form: finds the clip of a library whose caption is nearest to a sentence.

mod cli;
mod encoder;
mod index;
mod library;
mod program;
mod text;
mod words;

pub use cli::Cli;
pub use encoder::{COSINE_MIN, Encoder};
pub use index::{Index, Match};
pub use library::{Caption, Library};
pub use program::execute;
pub use text::{escaped, read, shown};
pub use words::Words;
