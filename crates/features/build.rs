//! Does nothing: without it Cargo would not look at the build-dependencies.

fn main() {}
