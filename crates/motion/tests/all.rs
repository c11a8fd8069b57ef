//! All integration tests of `motion`. They are one program, so they are linked once.

mod arrays;
mod bounds;
mod builtin;
mod bvh;
mod estimates;
mod messages;
mod options;
mod reader;
mod recordings;
mod rigs;
mod writers;
