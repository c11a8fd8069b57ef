//! What a person's limbs are measured against: where the elbows' hinges lie, and how upright the trunk is.

use crate::hinge::Calibrator;
use crate::limbs::TORSO_LEAN_RAD;
use crate::person::Person;
use messages::{CalibrationSource, HingeCalibration, LIMBS, Layout, Stamp, calibration_flag};

/// An estimate that has just become valid counts fully after so long, s, and one that has ceased to be counts for so long: the
/// hinge of the moment and the estimated one are at most 90 degrees apart, which makes 45 degrees/s, slower than a forearm
/// turns.
const BLEND_S: f64 = 2.0;
/// Time constant with which an estimate forgets, s (assumption): a tracker that slips on an arm is followed within a minute, and
/// an arm that rests for ten keeps what it showed before.
const MEMORY_S: f64 = 60.0;
/// Longest time between two frames that counts, s: the period of a source of 20 Hz and one lost frame.
const PERIOD_MAX_S: f64 = 0.1;
/// A stored length may differ from that of the person by this share (assumption: a fifth tells a child from an adult and one
/// layout from another; two adults it does not).
const LENGTH_DIFFERENCE_MAX: f64 = 0.2;
/// Largest lean that a calibration may give, rad: 20 degrees, three and a half times that of a T-pose of motion capture.
pub const LEAN_MAX_RAD: f64 = 0.35;

/// What was measured of one operator while they held still and bent their elbows, for one layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Elbow hinges in the frames of SMPL-22; none where the layout has no rotations.
    pub hinges: HingeCalibration,
    /// Lengths of the limbs, m; zero where unknown.
    pub lengths_m: [f64; LIMBS],
    /// How far the line from the hips to the shoulders leans back when the person stands upright, rad.
    pub torso_lean_rad: f64,
}

/// Hinges, each with the share by which it counts against the plane of the moment, and the trunk's lean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference {
    pub(crate) hinges: HingeCalibration,
    pub(crate) weight: [f64; LIMBS],
    pub(crate) torso_lean_rad: f64,
}

impl Reference {
    /// These hinges, and the trunk of everybody.
    pub(crate) fn of(hinges: HingeCalibration) -> Self {
        Self { hinges, weight: [1.0; LIMBS], torso_lean_rad: TORSO_LEAN_RAD }
    }
}

/// Learns one person's hinges while they move, and decides whose are used.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Learnt {
    calibrator: Calibrator,
    /// The last valid estimate of each limb, and how much it counts.
    hinges: HingeCalibration,
    weight: [f64; LIMBS],
    newest: Stamp,
    /// Whether the stored calibration is this person's, once that is decided.
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
    /// What the limbs of this frame are measured against: the client's hinges, else the operator's, else those learnt from the
    /// frames so far. `lengths_m` are the person's.
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

    /// Where the hinges of the newest frame came from.
    pub(crate) const fn source(&self) -> CalibrationSource {
        self.source
    }

    /// The estimate of all frames so far, of the arms whose rotations move with them.
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
    /// Nothing known.
    pub const NONE: Self =
        Self { hinges: HingeCalibration::ZERO, lengths_m: [0.0; LIMBS], torso_lean_rad: TORSO_LEAN_RAD };

    /// Whether no limb contradicts that this is the person's.
    fn fits(&self, lengths_m: [Option<f64>; LIMBS]) -> bool {
        self.lengths_m.iter().zip(lengths_m).all(|(&stored_m, seen_m)| {
            let difference_m = seen_m.map_or(0.0, |seen_m| (seen_m - stored_m).abs());
            stored_m == 0.0 || difference_m <= LENGTH_DIFFERENCE_MAX * stored_m
        })
    }
}
