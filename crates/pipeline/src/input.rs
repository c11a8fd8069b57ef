//! Path of a frame through `ingest`: conversion to SMPL-22, filter against noise and outliers, validation.

use crate::operators::Operators;
use crate::settings::{Filter, IngestSettings};
use layouts::{Layouts, Map, Noise, NoiseState, Refusal};
use messages::{RawSkeleton, Stamp};
use skeleton::{DropReason, Output, State};

/// Longest motion of a joint in a 30th of a second that the filter smooths, m: 4.5 m/s. After a longer one the
/// filter restarts at the new position. Few movements are that fast, and none of them needs smoothing.
const FILTER_STEP_M: f64 = 0.15;

/// Layouts, filter and plausibility bounds of `ingest`.
#[derive(Clone, Debug)]
pub struct InputConfig {
    /// The built-in layouts and those from files.
    pub layouts: Layouts,
    /// Calibrations of the operators.
    pub operators: Operators,
    filter: Filter,
    noise: Noise,
    /// Bounds of a plausible person, for motion capture and for cameras.
    measured: skeleton::Config,
    seen: skeleton::Config,
}

impl InputConfig {
    /// Combines the layouts, the settings' filter and the bounds of `skeleton`. For cameras the settings give the
    /// allowed changes of a limb's length.
    pub fn new(settings: &IngestSettings, layouts: Layouts, operators: Operators) -> Self {
        let measured = skeleton::Config::default();
        Self {
            layouts,
            operators,
            filter: settings.filter,
            noise: Noise {
                rest_cutoff_hz: settings.filter_rest_cutoff_hz,
                cutoff_per_m: settings.filter_cutoff_per_m,
                outliers_mad: settings.filter_outliers_mad,
                step_max_m: FILTER_STEP_M,
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

    /// Explains a drop reason, with the bounds of motion capture, to help find the error in a client.
    pub const fn meaning(reason: DropReason) -> &'static str {
        match reason {
            DropReason::Layout => "the layout's number is unknown",
            DropReason::Count => "the number of joints differs from the layout's, or a flag is unknown",
            DropReason::Mirrored => "the frame is mirrored, and its layout does not allow that",
            DropReason::NoOrigin => "header.origin, the time at which the person was seen, is 0",
            DropReason::Future => "header.origin lies in the future; it is CLOCK_MONOTONIC of this machine, ns",
            DropReason::Old => "header.origin is more than 100 ms ago; it is CLOCK_MONOTONIC of this machine, ns",
            DropReason::SessionChanged => "the session changed; its first frame is never used",
            DropReason::OperatorChanged => "operator_id changed; the first frame of another person is never used",
            DropReason::Duplicate => "header.origin or header.sequence equals the previous frame's",
            DropReason::Backwards => "header.origin or header.sequence went backwards",
            DropReason::NotFinite => "a number is NaN or infinite",
            DropReason::OutOfRange => {
                "a coordinate is beyond 100 m, a joint more than 1.5 m from the pelvis, or a confidence not 0 to 1 \
                 (are the units those of the layout?)"
            }
            DropReason::NotUnit => "a quaternion or a hinge is not of length 1",
            DropReason::TrunkLost => "shoulders or hips are below a confidence of 0.5",
            DropReason::Size => {
                "hips to shoulders are not 0.29 to 0.73 m, or an upper arm or a forearm is not 0.3 to 0.9 of that \
                 (are the units and the order of the joints those of the layout?)"
            }
            DropReason::NotUpright => "the trunk is not upright at the start (is the up axis the layout's?)",
            DropReason::Chirality => "left and right are swapped, or the person is mirrored",
            DropReason::Teleport => {
                "a shoulder went faster than 7 m/s, an elbow faster than 10 m/s, or a wrist faster than 12 m/s, \
                 relative to the hips"
            }
            DropReason::LengthStep => "a limb changed its length from one frame to the next",
            DropReason::LengthChange => "a limb's length differs from that in the session's first second",
            DropReason::Frozen => "the same numbers repeat: the tracker is stuck",
        }
    }
}

/// State for one client.
#[derive(Clone, Copy, Debug, Default)]
pub struct InputState {
    /// State and counts of the validation.
    pub skeleton: State,
    noise: NoiseState,
}

impl InputState {
    /// Number of joint positions so far that the filter held for a frame because they were outliers.
    pub const fn outliers(&self) -> u64 {
        self.noise.rejected()
    }
}

/// Converts, filters and checks a frame. A frame of an unknown layout is dropped and counted like all others.
/// Never allocates, blocks, logs, reads a clock or panics, whatever the bits.
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
    let stored = config.operators.find(raw.operator_id, raw.layout);
    let bounds = if camera { &config.seen } else { &config.measured };
    skeleton::tick(bounds, &mut state.skeleton, now, skeleton::Input { raw: &frame, stored })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drop_reason_texts_give_bounds_in_force() {
        let bounds = skeleton::Config::default();
        let [low, high] = bounds.trunk_m;
        let [arm_low, arm_high] = bounds.arm_per_trunk;
        let [shoulder, elbow, wrist] = bounds.speed_max_m_per_s;
        for (reason, said) in [
            (DropReason::Old, format!("{} ms", bounds.age_max_ns / 1_000_000)),
            (DropReason::OutOfRange, format!("{} m", bounds.coordinate_max_m)),
            (DropReason::OutOfRange, format!("{} m", bounds.reach_max_m)),
            (DropReason::TrunkLost, format!("{}", bounds.confidence_min)),
            (DropReason::Size, format!("{low} to {high} m")),
            (DropReason::Size, format!("{arm_low} to {arm_high} of that")),
            (DropReason::Teleport, format!("a shoulder went faster than {shoulder} m/s")),
            (DropReason::Teleport, format!("an elbow faster than {elbow} m/s")),
            (DropReason::Teleport, format!("a wrist faster than {wrist} m/s")),
        ] {
            let meaning = InputConfig::meaning(reason);
            assert!(meaning.contains(&said), "{reason:?}: {said}: {meaning}");
        }
    }
}
