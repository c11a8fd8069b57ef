//! All integration tests but `led` are one program, so that it is linked once.

mod libraries;
mod link;
mod program;
