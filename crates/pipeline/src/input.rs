//! What `ingest` does with a frame: any layout becomes SMPL-22, what trembles is filtered, and that is judged.

use crate::settings::{Filter, IngestSettings};
use layouts::{Layouts, Map, Noise, NoiseState, Refusal};
use messages::{RawSkeleton, Stamp};
use skeleton::{DropReason, Output, State};

/// Which layouts are understood, which are filtered, and which persons are plausible.
#[derive(Clone, Debug)]
pub struct InputConfig {
    /// The built-in layouts and those from files.
    pub layouts: Layouts,
    filter: Filter,
    noise: Noise,
    /// Bounds of a plausible person, of motion capture and of cameras.
    measured: skeleton::Config,
    seen: skeleton::Config,
}

impl InputConfig {
    /// The layouts that were read, the filter of the settings, and the bounds that `skeleton` has; for cameras with the changes
    /// of limbs' lengths that the settings allow.
    pub fn new(settings: &IngestSettings, layouts: Layouts) -> Self {
        let measured = skeleton::Config::default();
        Self {
            layouts,
            filter: settings.filter,
            noise: Noise {
                rest_cutoff_hz: settings.filter_rest_cutoff_hz,
                cutoff_per_m: settings.filter_cutoff_per_m,
                step_max_m: measured.step_max_m,
                confidence_min: measured.confidence_min,
            },
            seen: skeleton::Config {
                length_change_max: settings.camera_length_change_max,
                length_step_max: settings.camera_length_step_max,
                ..measured
            },
            measured,
        }
    }
}

/// Everything remembered of one client.
#[derive(Clone, Copy, Debug, Default)]
pub struct InputState {
    /// What validation remembers, and its counts.
    pub skeleton: State,
    noise: NoiseState,
}

/// Converts a frame, filters it and checks it; a frame of no layout is dropped and counted like all others. Never allocates,
/// blocks, logs, reads a clock or panics, whatever the bits.
pub fn input_tick(config: &InputConfig, state: &mut InputState, now: Stamp, raw: &RawSkeleton) -> Output {
    let camera = config.layouts.find(raw.layout).is_some_and(Map::camera);
    let mut frame = match config.layouts.convert(raw) {
        Ok(frame) => frame,
        Err(Refusal::Layout) => return state.skeleton.refuse(DropReason::Layout),
        Err(Refusal::Count) => return state.skeleton.refuse(DropReason::Count),
    };
    if config.filter == Filter::All || camera && config.filter == Filter::Cameras {
        config.noise.filter(&mut state.noise, raw.layout, &mut frame);
    }
    let bounds = if camera { &config.seen } else { &config.measured };
    skeleton::tick(bounds, &mut state.skeleton, now, skeleton::Input { raw: &frame })
}
