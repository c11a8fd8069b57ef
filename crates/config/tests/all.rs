//! All integration tests of `config`. They are one program, so that it is linked once.

mod choice;
mod weights;
