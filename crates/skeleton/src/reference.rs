//! Reference for a person's limbs: the hinges of the elbows, and the lean of the upright trunk.

use crate::geometry::stored;
use crate::hinge::Calibrator;
use crate::limbs::TORSO_LEAN_RAD;
use crate::person::Person;
use messages::{CalibrationSource, HingeCalibration, LIMBS, Layout, Smpl, Stamp, calibration_flag};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3, Vector4};

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
/// Smallest number of frames for a mean head: half a second at 20 Hz, the slowest source.
const HEAD_FRAMES_MIN: u32 = 10;
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
    /// Directions of the straight hands in the wrist joints' frames.
    pub(crate) hands: [Option<Vector3<f64>>; 2],
    pub(crate) torso_lean_rad: f64,
}

impl Reference {
    /// Takes these hinges with full weight, no hands, and the default lean.
    pub(crate) fn from_hinges(hinges: HingeCalibration) -> Self {
        Self { hinges, weight: [1.0; LIMBS], hands: [None; 2], torso_lean_rad: TORSO_LEAN_RAD }
    }
}

/// Learns one person's hinges while they move, and chooses the hinges to use.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Learnt {
    calibrator: Calibrator,
    /// The last valid estimate of each limb, and its weight.
    hinges: HingeCalibration,
    weight: [f64; LIMBS],
    newest: Stamp,
    /// True if the stored calibration fits this person. `None` before that is decided.
    stored_fits: Option<bool>,
    source: CalibrationSource,
    head: Head,
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
        // Straight hands are always learnt, because no calibration has them.
        let hands = self.calibrator.hands();
        if person.calibration.flags != 0 {
            self.source = CalibrationSource::Client;
            return Reference { hands, ..Reference::from_hinges(person.calibration) };
        }
        let stored = stored.filter(|stored| *self.stored_fits.get_or_insert_with(|| stored.fits(lengths_m)));
        if let Some(stored) = stored {
            self.source = CalibrationSource::Stored;
            let torso_lean_rad = stored.torso_lean_rad.clamp(-LEAN_MAX_RAD, LEAN_MAX_RAD);
            return Reference { torso_lean_rad, hands, ..Reference::from_hinges(stored.hinges) };
        }
        let online = self.weight.iter().all(|&weight| weight >= 0.5);
        self.source = if online { CalibrationSource::Online } else { CalibrationSource::None };
        Reference { weight: self.weight, hands, ..Reference::from_hinges(self.hinges) }
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

    /// Returns the head's rotation in the torso frame as a difference from its mean so far, x y z w. `torso`: axes of the
    /// torso frame. `None` if the head is not visible, or the client's rotations do not move with the person.
    pub(crate) fn head(&mut self, person: &Person, torso: &Matrix3<f64>) -> Option<[f32; 4]> {
        let seen = person.has_rotations && person.has(Smpl::Head as usize);
        if !seen || !self.calibrator.carried().contains(&true) {
            return None;
        }
        self.head.turn(person.rotations[Smpl::Head as usize], torso)
    }

    /// Forgets how the head looked. Another person's looks ahead differently.
    pub(crate) fn forget_head(&mut self) {
        self.head = Head::default();
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

/// Mean rotation of a head in the torso frame. Rest poses differ between exporters, and people look ahead on average.
#[derive(Clone, Copy, Debug, Default)]
struct Head {
    /// Sum of the quaternions x y z w, each with the sign that is nearer to the sum.
    sum: Vector4<f64>,
    frames: u32,
}

impl Head {
    /// Adds a rotation x y z w in the world. Returns its difference from the mean.
    fn turn(&mut self, rotation: [f32; 4], torso: &Matrix3<f64>) -> Option<[f32; 4]> {
        let [x, y, z, w] = rotation.map(f64::from);
        let world_from_head = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)?;
        let torso = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*torso));
        let head = torso.inverse() * world_from_head;
        let coords = if head.coords.dot(&self.sum) < 0.0 { -head.coords } else { head.coords };
        self.sum += coords;
        self.frames = self.frames.saturating_add(1);
        let mean = UnitQuaternion::try_new(Quaternion::from(self.sum), 0.5)?;
        (self.frames >= HEAD_FRAMES_MIN).then(|| stored(&(head * mean.inverse())))
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
