//! Words to motion, in the simplest whole form: the clip of a library whose caption is nearest to a sentence.

pub mod cli;
mod index;
mod library;
mod words;

pub use index::{Index, Match};
pub use library::{Caption, Library, LibraryError};
pub use words::Words;
