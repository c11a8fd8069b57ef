//! All integration tests of `motion` but those that count allocations: one program, so that it is linked once.

mod arrays;
mod bounds;
mod builtin;
mod bvh;
mod clips;
mod recordings;
mod rigs;
mod writers;
