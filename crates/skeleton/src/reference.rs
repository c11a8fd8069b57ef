//! Reference for a person's limbs: the hinges of the elbows, and the lean of the upright trunk.

use crate::hinge::Calibrator;
use crate::limbs::TORSO_LEAN_RAD;
use crate::person::Person;
use messages::{CalibrationSource, HingeCalibration, LIMBS, Layout, Stamp, calibration_flag};

/// Time in which a new valid estimate gains its full weight, s, and in which a lost one loses it. The momentary
/// and the estimated hinge are at most 90 degrees apart. That makes 45 degrees/s, slower than a forearm turns.
const BLEND_S: f64 = 2.0;
/// Time constant with which an estimate forgets, s (assumption). If a tracker slips on an arm, the estimate
/// follows within a minute. An arm that rests for ten keeps its previous estimate.
const MEMORY_S: f64 = 60.0;
/// Longest time between two frames that counts, s: the period of a source of 20 Hz and one lost frame.
const PERIOD_MAX_S: f64 = 0.1;
/// Largest difference between a stored length and the person's, as a share. Assumption: a fifth separates a child
/// from an adult and one layout from another. It does not separate two adults.
const LENGTH_DIFFERENCE_MAX: f64 = 0.2;
/// Largest lean in a calibration, rad: 20 degrees, three and a half times that of a motion capture's T-pose.
pub const LEAN_MAX_RAD: f64 = 0.35;

/// Measurements of one operator who held still and bent their elbows, for one layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Elbow hinges in the frames of SMPL-22. No bit is set if the layout has no rotations.
    pub hinges: HingeCalibration,
    /// Lengths of the limbs, m. Zero where unknown.
    pub lengths_m: [f64; LIMBS],
    /// Lean of the line from the hips to the shoulders when the person stands upright, rad, positive to the back.
    pub torso_lean_rad: f64,
}

/// Hinges, each with its weight against the momentary plane, and the trunk's lean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    pub(crate) hinges: HingeCalibration,
    pub(crate) weight: [f64; LIMBS],
    pub(crate) torso_lean_rad: f64,
}

impl Reference {
    /// Takes these hinges with full weight, and the default lean.
    pub(crate) fn of(hinges: HingeCalibration) -> Self {
        Self { hinges, weight: [1.0; LIMBS], torso_lean_rad: TORSO_LEAN_RAD }
    }
}

/// Learns one person's hinges while they move, and chooses the hinges to use.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Learnt {
    calibrator: Calibrator,
    /// The last valid estimate of each limb, and its weight.
    hinges: HingeCalibration,
    weight: [f64; LIMBS],
    newest: Stamp,
    /// True if the stored calibration fits this person. `None` before that is decided.
    stored_fits: Option<bool>,
    source: CalibrationSource,
}

impl Default for Learnt {
    fn default() -> Self {
        Self {
            calibrator: Calibrator::new(),
            hinges: HingeCalibration::ZERO,
            weight: [0.0; LIMBS],
            newest: Stamp::NONE,
            stored_fits: None,
            source: CalibrationSource::None,
        }
    }
}

impl Learnt {
    /// Returns the reference for the limbs of this frame: the client's hinges, else the operator's stored ones,
    /// else those learnt so far. `lengths_m` are the person's.
    pub(crate) fn next(
        &mut self,
        origin: Stamp,
        person: &Person,
        lengths_m: [Option<f64>; LIMBS],
        stored: Option<&Calibration>,
    ) -> Reference {
        self.learn(origin, person);
        if person.calibration.flags != 0 {
            self.source = CalibrationSource::Client;
            return Reference::of(person.calibration);
        }
        let stored = stored.filter(|stored| *self.stored_fits.get_or_insert_with(|| stored.fits(lengths_m)));
        if let Some(stored) = stored {
            self.source = CalibrationSource::Stored;
            let torso_lean_rad = stored.torso_lean_rad.clamp(-LEAN_MAX_RAD, LEAN_MAX_RAD);
            return Reference { torso_lean_rad, ..Reference::of(stored.hinges) };
        }
        let online = self.weight.iter().all(|&weight| weight >= 0.5);
        self.source = if online { CalibrationSource::Online } else { CalibrationSource::None };
        Reference { weight: self.weight, ..Reference::of(self.hinges) }
    }

    fn learn(&mut self, origin: Stamp, person: &Person) {
        let period_s = (origin.since(self.newest) as f64 * 1e-9).min(PERIOD_MAX_S);
        let share = period_s / BLEND_S;
        self.newest = origin;
        if !person.has_rotations {
            return;
        }
        self.calibrator.fade(1.0 - period_s / MEMORY_S);
        self.calibrator.add(&person.positions, &person.rotations, person.usable);
        let estimate = self.estimate();
        for limb in 0..LIMBS {
            let valid = estimate.flags & calibration_flag::LIMB[limb] != 0;
            let weight = &mut self.weight[limb];
            if valid {
                self.hinges.hinge[limb] = estimate.hinge[limb];
                self.hinges.flags |= calibration_flag::LIMB[limb];
            }
            *weight = (*weight + if valid { share } else { -share }).clamp(0.0, 1.0);
        }
    }

    /// Source of the newest frame's hinges.
    pub(crate) const fn source(&self) -> CalibrationSource {
        self.source
    }

    /// Returns the estimate of all frames so far, for the arms whose rotations move with them.
    pub(crate) fn estimate(&self) -> HingeCalibration {
        let mut estimate = self.calibrator.estimate();
        for (arm, carried) in self.calibrator.carried().into_iter().enumerate() {
            if !carried {
                estimate.flags &= !(calibration_flag::LIMB[2 * arm] | calibration_flag::LIMB[2 * arm + 1]);
            }
        }
        estimate
    }
}

impl Calibration {
    /// An empty calibration.
    pub const NONE: Self =
        Self { hinges: HingeCalibration::ZERO, lengths_m: [0.0; LIMBS], torso_lean_rad: TORSO_LEAN_RAD };

    /// Returns true if no limb's length contradicts that this calibration is the person's.
    fn fits(&self, lengths_m: [Option<f64>; LIMBS]) -> bool {
        self.lengths_m.iter().zip(lengths_m).all(|(&stored_m, seen_m)| {
            let difference_m = seen_m.map_or(0.0, |seen_m| (seen_m - stored_m).abs());
            stored_m == 0.0 || difference_m <= LENGTH_DIFFERENCE_MAX * stored_m
        })
    }
}
