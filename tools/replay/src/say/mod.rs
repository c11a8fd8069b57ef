//! Words to motion, in the simplest complete form: finds the clip of a library whose caption is nearest to a
//! sentence.

mod cli;
#[cfg(feature = "embeddings")]
mod embeddings;
mod index;
mod library;
mod program;
mod text;
mod words;

pub use cli::Cli;
#[cfg(feature = "embeddings")]
pub use embeddings::Embeddings;
pub use index::{Index, Match};
pub use library::{Caption, Library};
pub use program::execute;
pub use text::{escaped, read, shown};
pub use words::Words;
