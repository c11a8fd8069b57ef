//! Looks for postures in which pairs meet that a robot file leaves out as proved clear. It cannot prove anything. It
//! finds a robot file that was edited by hand, or whose ranges were widened after the proof.

use crate::collision::{AllowedPair, AllowedReason};
use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::model::Model;
use crate::segment::segment_distance;
use messages::JOINTS_MAX;

/// Pairs with at most this many joints between them may have been proved by the hulls inside. Their capsules may meet.
/// `collision` has the same bound.
const HULL_JOINTS_MAX: usize = 3;

/// A pair that no sample found nearer than this is not looked at further, m (chosen).
const NEAR_M: f64 = 0.3;
/// Number of the nearest samples from which the search goes on (chosen).
const STARTS: usize = 4;
/// First step of the search, as a share of a joint's range. It is halved down to the last (chosen).
const STEP_SHARES: [f64; 2] = [0.25, 0.01];

impl Model {
    /// Checks the pairs that are left out as proved clear in so many postures, the same in each call. From the nearest
    /// ones it goes on to nearer ones. It skips pairs with three joints or less between them. Checks in the same postures that
    /// pairs listed as overlapping are never farther apart than the clearance.
    pub fn check_proved_clear(&self, postures: u64) -> Result<(), RobotError> {
        self.check_overlaps(postures)?;
        let proved = self.allowed.iter().filter(|pair| pair.reason == AllowedReason::ProvedClear);
        let joined = proved.map(|pair| (pair, self.joints_between(pair)));
        let pairs: Vec<_> = joined.filter(|(_, joints)| joints.len() > HULL_JOINTS_MAX).collect();
        let mut nearest = vec![[(f64::INFINITY, 0); STARTS]; pairs.len()];
        let mut frames = Frames::default();
        for index in 0..postures {
            self.forward(&self.posture(index), &mut frames);
            for ((pair, _), nearest) in pairs.iter().zip(&mut nearest) {
                insert(nearest, (self.apart_m(pair, &frames), index));
            }
        }
        for ((pair, joints), nearest) in pairs.iter().zip(nearest) {
            let starts = nearest.into_iter().filter(|(apart_m, _)| *apart_m < NEAR_M);
            let mut found = starts.map(|(apart_m, index)| self.nearer_m(pair, joints, apart_m, index, &mut frames));
            if let Some(apart_m) = found.find(|apart_m| !(*apart_m > 0.0)) {
                let [a, b] = [pair.a, pair.b].map(|at| self.capsules[at].name.as_str());
                let key = format!("collision.allowed.proved_clear: `{a}` and `{b}`");
                let bound = "must stay apart in every posture within the limits: fit again with `collision fit`, or take \
                             the pair out of the table";
                let value = format!("overlap of {:.1} mm", -apart_m * 1e3);
                return Err(RobotError::value(&self.texts.toml_name, key, value, bound));
            }
        }
        Ok(())
    }

    /// Checks the pairs that are left out because the maker's shapes overlap. Capsules contain these shapes, so one posture in
    /// which the capsules are apart refutes it.
    fn check_overlaps(&self, postures: u64) -> Result<(), RobotError> {
        let listed = self.allowed.iter().filter(|pair| pair.reason == AllowedReason::OverlapAsPublished);
        let mut frames = Frames::default();
        for pair in listed {
            let joints = self.joints_between(pair).len();
            let apart_m = (0..postures).map(|index| {
                self.forward(&self.posture(index), &mut frames);
                self.apart_m(pair, &frames)
            });
            let most_m = apart_m.fold(f64::NEG_INFINITY, f64::max);
            if joints > HULL_JOINTS_MAX || !(most_m <= self.d_min_m) {
                let [a, b] = [pair.a, pair.b].map(|at| self.capsules[at].name.as_str());
                let key = format!("collision.allowed.overlap_as_published: `{a}` and `{b}`");
                let value = format!("{joints} joints between them, up to {:.1} mm apart", most_m * 1e3);
                let bound = format!(
                    "at most {HULL_JOINTS_MAX} joints and {:.1} mm: take the pair out of the table, or fit again with \
                     `collision fit`",
                    self.d_min_m * 1e3
                );
                return Err(RobotError::value(&self.texts.toml_name, key, value, bound));
            }
        }
        Ok(())
    }

    /// Distance of two capsules' surfaces, m.
    fn apart_m(&self, pair: &AllowedPair, frames: &Frames) -> f64 {
        let (a, b) = (&self.capsules[pair.a], &self.capsules[pair.b]);
        let ([a0, a1], [b0, b1]) = (a.ends(frames), b.ends(frames));
        segment_distance(&a0, &a1, &b0, &b1).distance_m - a.radius_m - b.radius_m
    }

    /// Moves one of these joints after the other from a posture, as long as the pair comes nearer, in ever smaller steps.
    /// Returns the least distance, m.
    fn nearer_m(&self, pair: &AllowedPair, joints: &[usize], apart_m: f64, index: u64, frames: &mut Frames) -> f64 {
        let (mut q, mut least_m, mut share) = (self.posture(index), apart_m, STEP_SHARES[0]);
        while share > STEP_SHARES[1] && least_m > 0.0 {
            let start_m = least_m;
            for (&joint, sign) in joints.iter().flat_map(|joint| [(joint, -1.0), (joint, 1.0)]) {
                let (limits, before) = (&self.limits[joint], q[joint]);
                let step = sign * share * (limits.q_max - limits.q_min);
                q[joint] = (before + step).clamp(limits.q_min, limits.q_max);
                self.forward(&q, frames);
                let apart_m = self.apart_m(pair, frames);
                if apart_m < least_m {
                    least_m = apart_m;
                } else {
                    q[joint] = before;
                }
            }
            if !(least_m < start_m) {
                share *= 0.5;
            }
        }
        least_m
    }

    /// A posture within the limits in force. Every second joint of every second posture stands at an end.
    fn posture(&self, index: u64) -> [f64; JOINTS_MAX] {
        std::array::from_fn(|j| {
            let bits = mixed(index.wrapping_mul(JOINTS_MAX as u64).wrapping_add(j as u64));
            let share = unit(bits);
            let at_end = index % 2 == 1 && bits & 1 == 1;
            let limits = &self.limits[j];
            limits.q_min + if at_end { share.round() } else { share } * (limits.q_max - limits.q_min)
        })
    }

    /// Joints that decide how the two bodies of a pair lie to each other.
    fn joints_between(&self, pair: &AllowedPair) -> Vec<usize> {
        let chain = |at: usize| -> Vec<usize> {
            std::iter::successors(Some(self.capsules[at].body), |body| self.parent_body(*body)).collect()
        };
        let (from_a, from_b) = (chain(pair.a), chain(pair.b));
        let alone = from_a.iter().filter(|body| !from_b.contains(body));
        alone.chain(from_b.iter().filter(|body| !from_a.contains(body))).map(|body| body - 1).collect()
    }
}

/// Keeps the nearest samples, the nearest first.
fn insert(nearest: &mut [(f64, u64); STARTS], sample: (f64, u64)) {
    let at = nearest.partition_point(|known| known.0 <= sample.0);
    if at < STARTS {
        nearest[at..].rotate_right(1);
        nearest[at] = sample;
    }
}

/// A number in [0, 1).
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

/// Mixes the bits of a number (SplitMix64, Steele, Lea and Flood 2014).
fn mixed(index: u64) -> u64 {
    let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
