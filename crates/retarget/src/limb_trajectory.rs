//! Limb trajectory of a target: the person's limbs, hands and hand places at the nodes after tick k.
//!
//! ```text
//! t_i   = (first + i) * TRAJECTORY_NODE_TICKS / TICK_HZ,   first = floor(k / TRAJECTORY_NODE_TICKS) + 1
//! place = p(q) + (U_i - U) u + (F_i - F) f
//!
//! p(q)     hand position of the touching posture q, from the first joint, torso frame, m
//! U, F     rotations of upper arm and forearm in the sample; U_i, F_i those at node i
//! u, f     upper arm and forearm with hand of the robot at the reference posture, m
//! ```
//!
//! Nodes up to the newest skeleton are measured. Later nodes are extrapolated.

use crate::arm::{ARMS, ArmModel};
use crate::contact::Proportions;
use crate::kinematic_chain::KinematicChain;
use crate::pointing::Blend;
use crate::resample::{Sample, Track};
use messages::{HAND_NODES, LIMBS, Stamp, TICK_HZ, TRAJECTORY_NODE_TICKS, TRAJECTORY_NODES};
use nalgebra::UnitQuaternion;
use robot::Limbs;
use robot::limbs::{on_side, place_on_side, xyzw_from_rotation};

/// The trajectory of the last update.
#[derive(Clone, Debug, Default)]
pub(crate) struct LimbTrajectory {
    /// The first node, in units of `TRAJECTORY_NODE_TICKS`. 0 before the first trajectory.
    pub(crate) first: u64,
    /// Number of skeletons at the last update.
    skeletons: u64,
    /// The arms in use.
    in_use: [bool; ARMS],
    /// Limb rotations, x y z w.
    pub(crate) nodes: [[[f32; 4]; LIMBS]; TRAJECTORY_NODES],
    /// Hand rotations, x y z w.
    pub(crate) hands: [[[f32; 4]; ARMS]; HAND_NODES],
    /// Places of touching hands, and their weights: x y z (m), weight.
    pub(crate) places: [[[f32; 4]; ARMS]; TRAJECTORY_NODES],
    /// Number of measured nodes.
    pub(crate) measured: u32,
}

/// Tracks of the person up to now.
pub(crate) struct Person<'a> {
    /// Both arms.
    pub(crate) tracks: &'a [Track; ARMS],
    /// Both hands.
    pub(crate) blends: [&'a Blend; ARMS],
    /// Number of skeletons so far.
    pub(crate) skeletons: u64,
    /// The arms in use.
    pub(crate) in_use: [bool; ARMS],
    /// The robot's arms. `None` without contact correction.
    pub(crate) robot: Option<(&'a [ArmModel; ARMS], &'a [Proportions; ARMS])>,
}

impl LimbTrajectory {
    /// Updates the nodes after tick `k`, with the present delay of `playhead`. Nodes lie at fixed instants. So they change only
    /// for a new skeleton, arm or node, and during the crossfade of a restart.
    pub(crate) fn update(&mut self, person: &Person<'_>, k: u64, playhead: i64, now: Stamp) {
        let Person { tracks, blends, skeletons, in_use, robot } = *person;
        let first = k / TRAJECTORY_NODE_TICKS + 1;
        let unchanged = (self.first, self.skeletons, self.in_use) == (first, skeletons, in_use);
        if unchanged && !tracks.iter().any(Track::is_fading) {
            return;
        }
        *self = Self { first, skeletons, in_use, measured: TRAJECTORY_NODES as u32, ..Self::default() };
        for arm in (0..ARMS).filter(|&arm| in_use[arm]) {
            for i in 0..TRAJECTORY_NODES {
                let ticks = (i as u64 + 1) * TRAJECTORY_NODE_TICKS - k % TRAJECTORY_NODE_TICKS;
                let ahead_ns = ticks * 1_000_000_000 / TICK_HZ;
                let (then, by) = (playhead + ahead_ns as i64, now.plus_ns(ahead_ns));
                let Some((limbs, measured)) = tracks[arm].ahead(then, by) else { continue };
                let needed = i < HAND_NODES || robot.is_some();
                let shown = needed.then(|| tracks[arm].show_ahead(then, by)).flatten();
                let robot = robot.map(|(models, robot)| (&models[arm], &robot[arm].chain));
                let place = robot.zip(shown).and_then(|(robot, shown)| place(robot, arm, &shown, &limbs));
                self.places[i][arm] = place.unwrap_or_default();
                let limbs = [limbs.upper, limbs.fore].map(|limb| single(&on_side(arm, &limb)));
                self.nodes[i][2 * arm..2 * arm + 2].copy_from_slice(&limbs);
                if !measured {
                    self.measured = self.measured.min(i as u32);
                }
                if i < HAND_NODES {
                    let hand = shown.and_then(|shown| hand_rotation(arm, &shown, blends[arm]));
                    self.hands[i][arm] = hand.map_or([0.0; 4], |hand| single(&hand));
                }
            }
        }
    }
}

/// Returns the hand rotation of the arm in this sample, at its present blend weight.
fn hand_rotation(arm: usize, sample: &Sample, blend: &Blend) -> Option<UnitQuaternion<f64>> {
    let fore = on_side(arm, &sample.limbs.fore);
    let bend = blend.share(sample.hand.map(|hand| fore.inverse() * on_side(arm, &hand)))?;
    Some(fore * bend)
}

/// Returns the place of a touching hand (m) and its weight, the square of its share. With the share itself, dancers' limbs were
/// farther off. Beyond the newest skeleton the hand moves with the arm's limbs.
fn place((model, chain): (&ArmModel, &KinematicChain), arm: usize, shown: &Sample, limbs: &Limbs) -> Option<[f32; 4]> {
    let (q, share) = shown.touching?;
    let [upper, fore] = [chain.joints[3] - chain.joints[1], chain.hand - chain.joints[3]];
    let moved = limbs.upper * upper + limbs.fore * fore - shown.limbs.upper * upper - shown.limbs.fore * fore;
    let at = place_on_side(arm, chain.hand_center(model, &q) - chain.joints[0] + moved).cast::<f32>();
    Some([at.x, at.y, at.z, (share * share) as f32])
}

fn single(rotation: &UnitQuaternion<f64>) -> [f32; 4] {
    xyzw_from_rotation(rotation).map(|x| x as f32)
}
