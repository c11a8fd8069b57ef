//! All integration tests of `eval`. They are one program, so that it is linked once.

mod command;
mod following;
mod methods;
mod metrics;
mod refusals;
