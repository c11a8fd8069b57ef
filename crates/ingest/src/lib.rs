//! Path of a client's frame through `ingest`: the lease, conversion to SMPL-22, filter against noise and outliers,
//! validation. Never does IO and never reads a clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

mod authority;

pub use authority::{Authority, ClientIdentity, Door};

use layouts::{Layouts, Map, Noise, NoiseState, Refusal};
use messages::{RawSkeleton, Stamp};
use serde::{Deserialize, Serialize};
use skeleton::{Calibration, DropReason, Output};

/// Longest motion of a joint in a 30th of a second that the filter smooths, m: 4.5 m/s. After a longer one the
/// filter restarts at the new position. Few movements are that fast, and none of them needs smoothing.
const FILTER_STEP_M: f64 = 0.15;

/// Layouts whose positions are filtered before validation.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Filter {
    /// No layout.
    None,
    /// Layouts of cameras.
    Cameras,
    /// Every layout.
    All,
}

/// Settings of the filter, and the bounds of `skeleton` that they change for cameras.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Layouts whose positions are filtered.
    pub filter: Filter,
    /// Cut-off of the filter at rest, Hz.
    pub rest_cutoff_hz: f64,
    /// Growth of the cut-off with the joint's speed, Hz per m/s.
    pub cutoff_per_m: f64,
    /// Threshold of outliers, in scaled median deviations.
    pub outliers_mad: f64,
    /// Largest change of a limb's length in all, as a share.
    pub camera_length_change_max: f64,
    /// Largest change of a limb's length from frame to frame, as a share.
    pub camera_length_step_max: f64,
}

/// Layouts, filter and plausibility bounds of `ingest`.
#[derive(Clone, Debug)]
pub struct Config {
    /// The built-in layouts and those from files.
    pub layouts: Layouts,
    /// Calibrations of the operators, by the client's numbers of the person and the layout.
    pub calibrations: Vec<((u32, u32), Calibration)>,
    filter: Filter,
    noise: Noise,
    /// Bounds of a plausible person, for motion capture and for cameras.
    measured: skeleton::Config,
    seen: skeleton::Config,
}

impl Config {
    /// Combines the layouts, the options and the bounds of `skeleton`.
    pub fn new(options: &Options, layouts: Layouts, calibrations: Vec<((u32, u32), Calibration)>) -> Self {
        let measured = skeleton::Config::default();
        Self {
            layouts,
            calibrations,
            filter: options.filter,
            noise: Noise {
                rest_cutoff_hz: options.rest_cutoff_hz,
                cutoff_per_m: options.cutoff_per_m,
                outliers_mad: options.outliers_mad,
                step_max_m: FILTER_STEP_M,
                confidence_min: measured.confidence_min,
            },
            seen: skeleton::Config {
                length_change_max: options.camera_length_change_max,
                length_step_max: options.camera_length_step_max,
                ..measured
            },
            measured,
        }
    }
}

/// State for one client.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// State and counts of the validation.
    pub skeleton: skeleton::State,
    noise: NoiseState,
}

impl State {
    /// Number of joint positions so far that the filter held for a frame because they were outliers.
    pub const fn outliers(&self) -> u64 {
        self.noise.rejected()
    }
}

/// Converts, filters and checks a frame. A frame of an unknown layout is dropped and counted like all others.
/// Never allocates, blocks, logs, reads a clock or panics, whatever the bits.
pub fn tick(config: &Config, state: &mut State, now: Stamp, raw: &RawSkeleton) -> Output {
    let camera = config.layouts.find(raw.layout).is_some_and(Map::camera);
    let mut frame = match config.layouts.convert(raw) {
        Ok(frame) => frame,
        Err(Refusal::Layout) => return state.skeleton.refuse(DropReason::Layout),
        Err(Refusal::Count) => return state.skeleton.refuse(DropReason::Count),
    };
    if config.filter == Filter::All || camera && config.filter == Filter::Cameras {
        config.noise.filter(&mut state.noise, raw.layout, &mut frame);
    }
    let known = config.calibrations.iter().find(|(of, _)| *of == (raw.operator_id, raw.layout));
    let stored = known.map(|(_, calibration)| calibration);
    let bounds = if camera { &config.seen } else { &config.measured };
    skeleton::tick(bounds, &mut state.skeleton, now, skeleton::Input { raw: &frame, stored })
}
