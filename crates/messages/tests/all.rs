//! All integration tests of `messages`. They are one program, so that it is linked once.

mod clients;
mod layout;
