//! One program for the integration tests: it is linked once.

mod live;
mod offline;
mod support;
mod viewers;
