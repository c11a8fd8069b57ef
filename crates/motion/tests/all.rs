//! All integration tests of `motion` except those that measure memory. They are one program, so that it is linked
//! once.

mod arrays;
mod bounds;
mod builtin;
mod bvh;
mod clips;
mod recordings;
mod rigs;
mod writers;
