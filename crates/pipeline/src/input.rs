//! What `ingest` does with a frame: any layout becomes SMPL-22, and that is judged.

use layouts::{Layouts, Refusal};
use messages::{RawSkeleton, Stamp};
use skeleton::{DropReason, Output, State};

/// Which layouts are understood, and which persons are plausible.
#[derive(Clone, Debug, Default)]
pub struct InputConfig {
    /// The built-in layouts and those from files.
    pub layouts: Layouts,
    /// Bounds of a plausible person.
    pub skeleton: skeleton::Config,
}

impl InputConfig {
    /// The layouts that were read, and the bounds that `skeleton` has.
    pub fn new(layouts: Layouts) -> Self {
        Self { layouts, skeleton: skeleton::Config::default() }
    }
}

/// Converts a frame and checks it; a frame of no layout is dropped and counted like all others. Never allocates, blocks, logs,
/// reads a clock or panics, whatever the bits.
pub fn input_tick(config: &InputConfig, state: &mut State, now: Stamp, raw: &RawSkeleton) -> Output {
    match config.layouts.convert(raw) {
        Ok(raw) => skeleton::tick(&config.skeleton, state, now, skeleton::Input { raw: &raw }),
        Err(Refusal::Layout) => state.refuse(DropReason::Layout),
        Err(Refusal::Count) => state.refuse(DropReason::Count),
    }
}
