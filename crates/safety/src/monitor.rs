//! Monitors of the measured robot. They turn measurements into flags for `engage`.

mod feedback;
mod movement;
mod target;

use messages::JOINTS_MAX;
use robot::{Frames, Model};

pub use crate::clearance::{Clearance, Distances};
pub use feedback::{Feedback, Judged, Sample};
pub use movement::{Moved, Movement, rest_band};
pub use target::{TargetSteps, far_behind};

/// Distance outside its limits at which a measured joint counts as outside, rad or m. A command may rest at
/// its limit. The noise of an encoder of 14 bits and a servo's sag lie around it. (TiaGo++ keeps 0.02 rad and
/// more of soft margin.)
pub const OUTSIDE_MARGIN: f64 = 0.005;

/// Rounding of a commanded position, rad or m. The simulated robot's checker uses the same value.
const COMMAND_ROUNDING: f64 = 1e-9;

/// Clearance beyond d_min at which a recovery ends, m. It leaves room to begin the next motion in any direction.
pub const START_MARGIN_M: f64 = 3e-3;

/// Hysteresis: the clearance must rise by this above the threshold before the monitor clears its flag, m. It
/// is ten times the error that the encoders' noise causes at a reach of 0.9 m.
const NEAR_HYSTERESIS_M: f64 = 0.001;

/// Least distance over the checked pairs and obstacles at the measured posture (rad, m). `frames` is working
/// memory. Never allocates.
pub fn measured_clearance(model: &Model, frames: &mut Frames, q_measured: &[f64; JOINTS_MAX]) -> Clearance {
    crate::clearance::clearance(model, frames, q_measured)
}

/// A joint outside its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outside {
    /// Its index.
    pub joint: usize,
    /// Distance beyond the limit, rad or m. It is negative below the lowest position, and NaN if the position is NaN.
    pub by: f64,
}

/// Returns the joint that is measured farthest outside its limits, if the distance is more than noise. NaN is outside.
pub fn outside_limits(model: &Model, q_measured: &[f64; JOINTS_MAX]) -> Option<Outside> {
    farthest(model, q_measured, OUTSIDE_MARGIN)
}

/// Returns the joint that is commanded farthest outside its limits, if there is one. A driver that starts
/// holds the measured position. Neither whole-body control nor the gate follows a target from outside.
pub fn commanded_outside(model: &Model, q_commanded: &[f64; JOINTS_MAX]) -> Option<Outside> {
    farthest(model, q_commanded, COMMAND_ROUNDING)
}

fn farthest(model: &Model, q: &[f64; JOINTS_MAX], margin: f64) -> Option<Outside> {
    let mut worst: Option<Outside> = None;
    for (joint, (limits, q)) in model.limits.iter().zip(q).enumerate() {
        let by = q - q.clamp(limits.q_min, limits.q_max);
        let inside = by.abs() <= margin;
        let worse = worst.is_none_or(|worst| by.is_nan() || by.abs() > worst.by.abs());
        if !inside && worse {
            worst = Some(Outside { joint, by });
        }
    }
    worst
}

/// Returns true if normal engaging may begin from a command at `q` (rad, m). Every joint must be within its
/// limits, and every checked pair d_min and [`START_MARGIN_M`] apart, by this crate's own arithmetic. A
/// recovery ends with such a command.
pub fn clear_to_start(model: &Model, frames: &mut Frames, q: &[f64; JOINTS_MAX]) -> bool {
    let inside = model.limits.iter().zip(q).all(|(limits, q)| limits.contains(*q));
    inside && crate::clearance::clearance(model, frames, q).is_at_least(model.d_min_m + START_MARGIN_M)
}

/// The largest |command - measured| among the revolute or the prismatic joints.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Farthest {
    /// Size of the error, rad or m.
    pub error: f64,
    /// Index of the joint.
    pub joint: usize,
}

/// Largest |command - measured| of the revolute (rad) and of the prismatic joints (m). A sound servo lags behind the
/// command by v times its known lag (s), and that is no error. A lag of zero gives the plain difference. NaN stays NaN.
pub fn tracking_error(
    model: &Model,
    q_command: &[f64; JOINTS_MAX],
    v_command: &[f64; JOINTS_MAX],
    q_measured: &[f64; JOINTS_MAX],
    servo_lag_s: f64,
) -> (Farthest, Farthest) {
    let (mut angle_rad, mut length_m) = (Farthest::default(), Farthest::default());
    for j in 0..model.count {
        let error = (q_command[j] - servo_lag_s * v_command[j] - q_measured[j]).abs();
        let greatest = if model.prismatic[j] { &mut length_m } else { &mut angle_rad };
        if error.is_nan() {
            let nothing = Farthest { error, joint: j };
            return (nothing, nothing);
        }
        if error > greatest.error {
            *greatest = Farthest { error, joint: j };
        }
    }
    (angle_rad, length_m)
}

/// Decides with hysteresis whether the measured posture is near a collision. The fault table sets the debounce.
#[derive(Clone, Copy, Debug, Default)]
pub struct Near {
    near: bool,
}

impl Near {
    /// Creates the state in which nothing is near.
    pub const fn new() -> Self {
        Self { near: false }
    }

    /// Judges a clearance, m. NaN counts as near.
    pub fn update(&mut self, model: &Model, clearance_m: f64) -> bool {
        let threshold = model.d_measured_min_m + if self.near { NEAR_HYSTERESIS_M } else { 0.0 };
        self.near = clearance_m < threshold || clearance_m.is_nan();
        self.near
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clearance::tests::shipped as model;
    use rand::{RngExt, SeedableRng};

    /// TIAGo++: the joints of its left arm.
    const LEFT_ARM: std::ops::Range<usize> = 3..10;
    /// TIAGo++: its lift.
    const TORSO: usize = 0;

    #[test]
    fn joint_outside_limits_beyond_noise_is_named() {
        let model = model();
        assert_eq!(outside_limits(&model, &model.home), None);
        for (past, outside) in [(0.0, false), (0.0049, false), (0.0051, true), (f64::NAN, true)] {
            for j in 0..JOINTS_MAX {
                let mut q = model.home;
                q[j] = model.limits[j].q_max + past;
                let named = |q: &[f64; JOINTS_MAX]| outside_limits(&model, q).map(|outside| outside.joint);
                assert_eq!(named(&q), outside.then_some(j), "joint {j} at {past}");
                q[j] = model.limits[j].q_min - past;
                assert_eq!(named(&q), outside.then_some(j), "joint {j} at {past}");
                // The worst joint is named, with its side.
                q[JOINTS_MAX - 1 - j] = model.limits[JOINTS_MAX - 1 - j].q_max + 0.5;
                let worst = outside_limits(&model, &q).expect("is outside");
                assert!(past.is_nan() || (worst.joint, worst.by > 0.4) == (JOINTS_MAX - 1 - j, true), "{worst:?}");
            }
        }
    }

    #[test]
    fn command_outside_limits_beyond_rounding_is_named() {
        let model = model();
        assert_eq!(commanded_outside(&model, &model.home), None);
        for j in 0..JOINTS_MAX {
            for (past, outside) in [(0.5e-9, false), (2e-9, true), (0.1, true)] {
                for (limit, side) in [(model.limits[j].q_max, 1.0), (model.limits[j].q_min, -1.0)] {
                    let mut q = model.home;
                    q[j] = limit + side * past;
                    let found = commanded_outside(&model, &q);
                    assert_eq!(found.map(|outside| outside.joint), outside.then_some(j), "joint {j} by {past}");
                    assert!(found.is_none_or(|found| (found.by - side * past).abs() < 1e-12), "{found:?}");
                }
            }
        }
    }

    #[test]
    fn motion_may_begin_only_within_limits_and_with_clearance() {
        let model = model();
        let mut frames = Frames { base_from_body: [robot::Pose::identity(); JOINTS_MAX + 1] };
        assert!(clear_to_start(&model, &mut frames, &model.home));
        let mut outside = model.home;
        outside[0] = model.limits[0].q_max + 1e-6;
        assert!(!clear_to_start(&model, &mut frames, &outside));
        // Goes from home towards postures that collide, to the point where the clearance is d_min and 3 mm.
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut met = 0;
        while met < 20 {
            let end = model.limits.map(|limits| rng.random_range(limits.q_min..=limits.q_max));
            let at = |t: f64| core::array::from_fn(|j| model.home[j] + t * (end[j] - model.home[j]));
            let mut room = |t: f64| measured_clearance(&model, &mut frames, &at(t)).distance_m - model.d_min_m;
            if room(1.0) > 0.0 {
                continue;
            }
            let (mut clear, mut close) = (0.0, 1.0);
            for _ in 0..60 {
                let half = (clear + close) / 2.0;
                *(if room(half) >= 0.003 { &mut clear } else { &mut close }) = half;
            }
            assert!(clear_to_start(&model, &mut frames, &at(clear)), "{clear} of the way");
            assert!(!clear_to_start(&model, &mut frames, &at(close)), "{close} of the way");
            met += 1;
        }
    }

    #[test]
    fn collision_near_has_hysteresis() {
        let model = model();
        let mut near = Near::new();
        let least = model.d_measured_min_m;
        let (below, between, above) = (least - 1e-6, least + NEAR_HYSTERESIS_M / 2.0, least + NEAR_HYSTERESIS_M + 1e-6);
        for (clearance, expected) in [
            (least, false),
            (between, false),
            (below, true),
            (between, true),
            (above, false),
            (f64::NAN, true),
            (above, false),
        ] {
            assert_eq!(near.update(&model, clearance), expected, "{clearance}");
        }
    }

    #[test]
    fn tracking_error_is_greatest_by_kind_and_nan_stays() {
        let model = model();
        let (q, still) = (model.home, [0.0; JOINTS_MAX]);
        let (lift, turn) = (TORSO, LEFT_ARM.start);
        let (angle_rad, _) = tracking_error(&model, &q, &still, &q, 0.0);
        assert_eq!(angle_rad, Farthest::default(), "where none is behind, none is blamed");
        let mut measured = q;
        measured[lift] += 0.02;
        measured[turn] -= 0.3;
        let (angle_rad, length_m) = tracking_error(&model, &q, &still, &measured, 0.0);
        assert!((angle_rad.error - 0.3).abs() < 1e-12 && (length_m.error - 0.02).abs() < 1e-12);
        assert_eq!((angle_rad.joint, length_m.joint), (turn, lift));
        // A servo that lags by 30 ms is 0.3 rad behind a command of 10 rad/s, and this is no error.
        let mut v = still;
        v[turn] = 10.0;
        assert!(tracking_error(&model, &q, &v, &measured, 0.03).0.error < 1e-12);
        measured[turn] = f64::NAN;
        let nothing = tracking_error(&model, &q, &still, &measured, 0.0);
        assert!([nothing.0, nothing.1].iter().all(|farthest| farthest.error.is_nan() && farthest.joint == turn));
    }

    #[test]
    fn measured_clearance_matches_robot_model() {
        let model = model();
        let mut frames = Frames { base_from_body: [robot::Pose::identity(); JOINTS_MAX + 1] };
        let own = measured_clearance(&model, &mut frames, &model.home);
        let (other, pair) = model.clearance(&frames);
        assert!((own.distance_m - other).abs() < 1e-9);
        assert_eq!(own.pair, [model.pairs[pair].a as u32, model.pairs[pair].b as u32]);
        let mut q = model.home;
        q[5] = f64::INFINITY;
        assert!(measured_clearance(&model, &mut frames, &q).distance_m.is_nan());
    }
}
