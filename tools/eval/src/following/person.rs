//! The person over time: the limb rotations of the skeletons that `ingest` passes on, each at its origin, with
//! slerp between them.

use crate::clips::Human;
use messages::{SMPL_JOINTS, Skeleton, Stamp, skeleton_flag};
use nalgebra::Vector3;
use retarget::contact::{Correction, Memory, PersonGeometry};
use retarget::{ArmModel, Limbs};

/// The place of a hand that touches, m, and its share from 0 to 1.
pub type Place = Option<(Vector3<f64>, f64)>;

#[derive(Clone, Debug)]
pub struct Hands {
    origins: Vec<Stamp>,
    places: Vec<[Place; 2]>,
}

impl Hands {
    pub fn at(&self, at: Stamp, side: usize) -> Place {
        let after = self.origins.partition_point(|origin| *origin <= at);
        self.places.get(after.saturating_sub(1))?[side]
    }
}

/// One person's limbs and joints, in the order of their origins.
#[derive(Clone, Debug, Default)]
pub struct Person {
    origins: Vec<Stamp>,
    limbs: Vec<Human>,
    positions: Vec<[[f32; 3]; SMPL_JOINTS]>,
}

impl Person {
    /// Adds a skeleton. One that lacks a limb, or is not newer than the last, is ignored.
    pub fn add(&mut self, skeleton: &Skeleton) {
        let origin = skeleton.header.origin;
        let newer = self.origins.last().is_none_or(|last| origin > *last);
        let limbs =
            Limbs::from_message(&skeleton.limbs).filter(|_| skeleton.flags & skeleton_flag::ALL == skeleton_flag::ALL);
        if let Some(limbs) = limbs.filter(|_| newer) {
            self.origins.push(origin);
            self.limbs.push(limbs);
            self.positions.push(skeleton.positions);
        }
    }

    /// Returns the limbs at `at`, both arms as left arms. Before or after all skeletons, those of the first or
    /// last one.
    pub fn at(&self, at: Stamp) -> Option<Human> {
        let after = self.origins.partition_point(|origin| *origin <= at);
        let last = self.limbs.last()?;
        let (Some(before), Some(next)) = (after.checked_sub(1), self.limbs.get(after)) else {
            return Some(if after == 0 { self.limbs[0] } else { *last });
        };
        let (from, to) = (self.origins[before], self.origins[after]);
        let share = at.since(from) as f64 / to.since(from) as f64;
        Some([0, 1].map(|arm| self.limbs[before][arm].slerp(&next[arm], share)))
    }

    /// Returns the person whose limbs bring the robot's hands to where this person's touch, and the places of these hands.
    pub fn touching(&self, arms: &[ArmModel; 2], correction: &Correction) -> (Self, Hands) {
        let (mut out, mut memory, mut before) = (self.clone(), Memory::default(), None);
        let place = |side: usize, (q, share)| (correction.robot[side].chain.hand_center(&arms[side], &q), share);
        let skeletons = out.limbs.iter_mut().zip(&self.positions).zip(&self.origins);
        let hands = skeletons.map(|((limbs, positions), origin)| {
            let seen = limbs.map(Some);
            let elapsed_s = before.replace(*origin).map_or(0.0, |before| origin.since(before) as f64 * 1e-9);
            let Some(geometry) = PersonGeometry::measure(positions, &seen) else { return [None; 2] };
            let touching = correction.apply(arms.each_ref(), &geometry, (&seen, &[None; 2]), elapsed_s, &mut memory);
            *limbs = [0, 1].map(|side| touching[side].unwrap_or(limbs[side]));
            [0, 1].map(|side| memory.postures()[side].map(|posture| place(side, posture)))
        });
        let hands = Hands { origins: self.origins.clone(), places: hands.collect() };
        (out, hands)
    }

    pub fn seen(&self) -> impl Iterator<Item = (Stamp, &[[f32; 3]; SMPL_JOINTS])> {
        self.origins.iter().copied().zip(&self.positions)
    }

    pub fn last(&self) -> Option<Stamp> {
        self.origins.last().copied()
    }

    pub fn positions(&self, at: Stamp) -> Option<&[[f32; 3]; SMPL_JOINTS]> {
        let after = self.origins.partition_point(|origin| *origin <= at);
        self.positions.get(after.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    fn skeleton(at_ms: u64, angle: f32, flags: u32) -> Skeleton {
        let mut skeleton = Skeleton { flags, ..Skeleton::ZERO };
        skeleton.header.origin = Stamp(at_ms * 1_000_000);
        skeleton.limbs = [[(0.5 * angle).sin(), 0.0, 0.0, (0.5 * angle).cos()]; messages::LIMBS];
        skeleton
    }

    #[test]
    fn limbs_between_two_valid_skeletons_are_interpolated() {
        let mut person = Person::default();
        assert_eq!(person.at(Stamp(5)), None);
        for (at_ms, angle, flags) in [
            (100, 0.0, skeleton_flag::ALL),
            (120, 9.0, 0),
            (140, 0.4, skeleton_flag::ALL),
            (130, 9.0, skeleton_flag::ALL),
        ] {
            person.add(&skeleton(at_ms, angle, flags));
        }
        for (at_ms, angle) in [(50, 0.0), (100, 0.0), (110, 0.1), (130, 0.3), (140, 0.4), (900, 0.4)] {
            let limbs = person.at(Stamp(at_ms * 1_000_000)).expect("a person");
            for limb in limbs.iter().flat_map(|arm| [arm.upper, arm.fore]) {
                assert!((limb.angle() - angle).abs() < 1e-6, "{at_ms} ms: {}", limb.angle());
            }
        }
    }
}
