//! All integration tests of `simulate`. They are one program, so that it is linked once.

mod campaign;
mod program;
