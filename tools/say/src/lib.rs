//! Words to motion, in the simplest complete form: finds the clip of a library whose caption is nearest to a
//! sentence.

pub mod cli;
mod embeddings;
mod index;
mod library;
mod text;
mod words;

pub use embeddings::{EmbeddingError, Embeddings};
pub use index::{Index, Match};
pub use library::{Caption, Library, LibraryError};
pub use text::{escaped, read, shown};
pub use words::Words;
