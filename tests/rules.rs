//! Rules of the tree, of its documents and of what is packed. Each module tests one kind.

mod book;
mod commands;
mod docs;
mod known_bugs;
mod language;
mod package;
mod sources;
mod supply;
mod tidy;
