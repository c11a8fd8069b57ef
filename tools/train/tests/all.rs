//! All integration tests of `train`. They are one program, so that it is linked once.

mod clips;
mod gradients;
mod lifting;
mod training;
