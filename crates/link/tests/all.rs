//! All integration tests of `link`. They are one program, so they are linked once.

mod codec;
mod ends;
mod world;
