//! Nothing but a list. Cargo builds a crate anew for each set of features that the chosen packages ask for together. Every
//! program depends on this list, so each of them asks for the same sets, and what one built serves all. `tests/tidy.rs`
//! compares each program's sets with the workspace's.
