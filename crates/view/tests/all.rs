//! One program for all tests, so that it is linked once.

mod frames;
mod headset;
mod look;
mod meshes;
mod page;
mod recording_view;
mod shares;
mod sight;
