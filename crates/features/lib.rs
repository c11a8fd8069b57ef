//! A list of dependencies and their features; it has no code. Cargo builds a crate once for each set of features that is asked
//! of it. Every program depends on this list, so all of them ask for the same sets, and no crate is built twice.
//! `tests/supply.rs` compares each program's sets with the workspace's.
