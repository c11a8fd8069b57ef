//! Measures the error of the expectation of the person. The expectation is the limb trajectory in each target that brings a
//! new skeleton, beyond that skeleton. It is compared with the person's later motion.

use super::judge::{limbs_deg, mean};
use super::person::Person;
use crate::clips::Human;
use messages::{JointTarget, Stamp, TRAJECTORY_NODE_TICKS, deadline};
use retarget::Limbs;

/// Judged times beyond the newest skeleton, ms.
pub const AHEAD_MS: [u64; 3] = [50, 100, 200];

/// Expectation at the time when a skeleton was the newest one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    pub origin: Stamp,
    /// The limbs at each of `AHEAD_MS` after it. None beyond the trajectory.
    pub limbs: [Option<Human>; AHEAD_MS.len()],
}

impl Expectation {
    /// Extracts the expectation of a target. Node n of its trajectory is for the person `delay_ns` before the node's
    /// tick.
    pub fn new(target: &JointTarget, delay_ns: u64) -> Self {
        let origin = target.header.origin;
        let at = |i: u64| deadline((target.trajectory_first + i) * TRAJECTORY_NODE_TICKS).0.saturating_sub(delay_ns);
        let limbs = AHEAD_MS.map(|ahead_ms| {
            let wanted = origin.0 + ahead_ms * 1_000_000;
            let next = (1..u64::from(target.trajectory_nodes)).find(|&i| at(i) >= wanted && at(i - 1) <= wanted)?;
            // An arm without a trajectory has zeros there, which are no rotation.
            let [from, to] = [next - 1, next].map(|i| Limbs::from_message(target.limb_trajectory.get(i as usize)?));
            let share = (wanted - at(next - 1)) as f64 / (at(next) - at(next - 1)) as f64;
            let (from, to) = (from?, to?);
            Some([0, 1].map(|arm| from[arm].slerp(&to[arm], share)))
        });
        Self { origin, limbs }
    }
}

/// Returns the mean angle of four limbs between the expectation and the person's later motion, degrees, at each
/// of `AHEAD_MS`. None if no expectation has a later skeleton.
pub fn errors_deg(expected: &[Expectation], person: &Person) -> [Option<f64>; AHEAD_MS.len()] {
    std::array::from_fn(|i| {
        let error = |expected: &Expectation| {
            let then = Stamp(expected.origin.0 + AHEAD_MS[i] * 1_000_000);
            let seen = person.last().is_some_and(|last| then <= last);
            Some(limbs_deg(&expected.limbs[i]?, &person.at(then).filter(|_| seen)?))
        };
        mean(&expected.iter().filter_map(error).collect::<Vec<_>>())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{LIMBS, Layout, Skeleton, TRAJECTORY_NODES, skeleton_flag};

    fn limbs(angle: f64) -> [[f32; 4]; LIMBS] {
        let (sin, cos) = (0.5 * angle).sin_cos();
        [[0.0, 0.0, sin as f32, cos as f32]; LIMBS]
    }

    #[test]
    fn trajectory_is_compared_with_the_person_at_its_own_times() {
        // The person turns at 1 rad/s. From the newest skeleton on, 3 s after the beginning, the trajectory has 2
        // rad/s.
        let (delay_ns, newest_ns) = (120_000_000, 3_000_000_000);
        let mut person = Person::default();
        for i in 0..200_u64 {
            let mut skeleton = Skeleton { flags: skeleton_flag::ALL, ..Skeleton::ZERO };
            skeleton.header.origin = Stamp(2_500_000_000 + i * 10_000_000);
            skeleton.limbs = limbs(skeleton.header.origin.0 as f64 * 1e-9 - 3.0);
            person.add(&skeleton);
        }
        let mut target = JointTarget::ZERO;
        target.header.origin = Stamp(newest_ns);
        target.trajectory_nodes = TRAJECTORY_NODES as u32;
        target.trajectory_first = messages::tick_at(Stamp(newest_ns)) / TRAJECTORY_NODE_TICKS + 1;
        for i in 0..TRAJECTORY_NODES {
            let at_ns = deadline((target.trajectory_first + i as u64) * TRAJECTORY_NODE_TICKS).0 - delay_ns;
            let ahead_s = (at_ns as f64 - newest_ns as f64) * 1e-9;
            target.limb_trajectory[i] = limbs(if ahead_s > 0.0 { 2.0 * ahead_s } else { ahead_s });
        }
        let found = errors_deg(&[Expectation::new(&target, delay_ns)], &person);
        for (found, ahead_ms) in found.into_iter().zip(AHEAD_MS) {
            let want = (ahead_ms as f64 * 1e-3).to_degrees();
            assert!(found.is_some_and(|deg| (deg - want).abs() < 0.05), "{ahead_ms} ms: {found:?}, want {want}");
        }
        // An arm without a trajectory, and a person who leaves before, give no figure.
        target.limb_trajectory.iter_mut().for_each(|limbs| limbs[3] = [0.0; 4]);
        assert_eq!(errors_deg(&[Expectation::new(&target, delay_ns)], &person), [None; 3]);
        target.header.origin = Stamp(4_400_000_000);
        assert_eq!(errors_deg(&[Expectation::new(&target, delay_ns)], &person), [None; 3]);
    }
}
