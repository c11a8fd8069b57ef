//! All integration tests are one program, so that it is linked once.

mod batch;
mod interpolation;
mod links;
mod live;
mod messages;
mod motions;
mod offline;
mod sentences;
