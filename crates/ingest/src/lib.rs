//! Path of a client's frame through `ingest`: the lease, conversion to SMPL-22, filter against noise and outliers,
//! validation. Never does IO and never reads a clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod authority;
mod policy;

pub use authority::{Authority, ClientIdentity, Door};
pub use policy::PolicyState;

use layouts::{LastImage, Layouts, Lengths, Lift, Lifter, Map, Noise, NoiseState, Refusal};
use messages::{RawSkeleton, Stamp, skeleton_flag};
use serde::{Deserialize, Serialize};
use skeleton::{Calibration, DropReason, Output};

/// Layouts whose positions are filtered before validation.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "the names say it")]
pub enum Filter {
    None,
    Cameras,
    All,
}

/// Layouts, filter and plausibility bounds of `ingest`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The built-in layouts and those from files.
    pub layouts: Layouts,
    /// Calibrations of the operators, by the client's numbers of the person and the layout.
    pub calibrations: Vec<((u32, u32), Calibration)>,
    /// Network that finds directions in the points of an image.
    pub lifter: Option<Lifter>,
    /// Layouts whose positions are filtered.
    pub filter: Filter,
    /// The person's mirror image is passed on.
    pub mirror: bool,
    /// The filter.
    pub noise: Noise,
    /// Bounds of a plausible person in layouts of motion capture.
    pub measured: skeleton::Config,
    /// Bounds of a plausible person in layouts of cameras.
    pub seen: skeleton::Config,
}

/// State for one client.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// State and counts of the validation.
    pub skeleton: skeleton::State,
    noise: NoiseState,
    lengths: Lengths,
    image: LastImage,
    /// Time at which another person's image arrived, while they do. `Stamp::NONE` otherwise.
    other_since: Stamp,
    /// The person of the last frame that was accepted.
    person: u32,
}

impl State {
    /// Number of joint positions so far that the filter held for a frame because they were outliers.
    pub const fn outliers(&self) -> u64 {
        self.noise.rejected()
    }
}

/// Converts, lifts, filters and checks a frame. A camera's frame gets the lengths of its session. A frame of an unknown layout is
/// dropped and counted like all others. Never allocates, blocks, logs, reads a clock or panics, whatever the bits.
pub fn tick(config: &Config, state: &mut State, now: Stamp, raw: &RawSkeleton) -> Output {
    let map = config.layouts.find(raw.layout);
    let camera = map.is_some_and(Map::camera);
    let mut frame = match config.layouts.convert(raw) {
        Ok(frame) => frame,
        Err(Refusal::Layout) => return state.skeleton.refuse(DropReason::Layout),
        Err(Refusal::Count) => return state.skeleton.refuse(DropReason::Count),
    };
    let bounds = if camera { &config.seen } else { &config.measured };
    let (mut other_ns, mut last) = (Some(bounds.distrust_after_ns), state.image);
    let image = map.and_then(|map| map.image(raw));
    if let Some((lifter, image)) = config.lifter.as_ref().zip(image) {
        let begun = if state.other_since == Stamp::NONE { now } else { state.other_since };
        // The bounds rise until the first image of the other person, and not while that person stays in view.
        if last.is_other(&image, begun, &frame) {
            state.other_since = begun;
            // By then the validation counts the person as another one, too: it goes by the same clock.
            if now.since(state.other_since) <= bounds.distrust_after_ns {
                return state.skeleton.refuse(DropReason::Teleport);
            }
            last = LastImage::default();
        }
        match lifter.apply(&image, state.lengths.over_trunk(), now, &mut last, &mut frame) {
            Lift::Done => other_ns = None,
            Lift::NoTrunk => {}
            Lift::Swapped => return state.skeleton.refuse(DropReason::Teleport),
        }
    }
    if config.filter == Filter::All || camera && config.filter == Filter::Cameras {
        config.noise.filter(&mut state.noise, raw.layout, &mut frame);
    }
    let known = config.calibrations.iter().find(|(of, _)| *of == (raw.operator_id, raw.layout));
    let stored = known.map(|(_, calibration)| calibration);
    if camera && !state.lengths.settle(raw.layout, bounds.confidence_min, other_ns, &mut frame) {
        return state.skeleton.refuse(DropReason::LengthChange);
    }
    let mut out = skeleton::tick(bounds, &mut state.skeleton, now, skeleton::Input { raw: &frame, stored });
    if let Some(skeleton) = &mut out.skeleton {
        skeleton.flags |= if image.is_some() { skeleton_flag::ONE_CAMERA } else { 0 };
        // A refused frame's stamps may lie anywhere, so it leaves no trace.
        (state.image, state.other_since) = (last, Stamp::NONE);
        if skeleton.operator_id != state.person {
            state.lengths = Lengths::default();
        }
        state.person = skeleton.operator_id;
    }
    if config.mirror {
        out.skeleton = out.skeleton.as_ref().map(skeleton::mirror_image);
    }
    out
}
