//! The nodes of the way in the message: what the arms in use do after the target.

use crate::arm::{ARMS, ArmModel, Limbs, on_side, xyzw_from_rotation};
use crate::chain::Chain;
use crate::pointing::Blend;
use crate::resample::{Sample, Track};
use crate::surface;
use messages::{HAND_NODES, LIMBS, Stamp, TICK_HZ, WAY_NODE_TICKS, WAY_NODES};
use nalgebra::UnitQuaternion;

/// The last computed way.
#[derive(Clone, Debug, Default)]
pub(crate) struct Way {
    /// The first node, in units of `WAY_NODE_TICKS`. 0 before the first way.
    pub(crate) first: u64,
    /// Number of skeletons for which it was computed.
    skeletons: u64,
    /// The arms in use.
    meant: [bool; ARMS],
    /// Limb rotations, x y z w.
    pub(crate) nodes: [[[f32; 4]; LIMBS]; WAY_NODES],
    /// The same of the hands.
    pub(crate) hands: [[[f32; 4]; ARMS]; HAND_NODES],
    /// Places of hands that touch, and their weights.
    pub(crate) places: [[[f32; 4]; ARMS]; WAY_NODES],
    /// The first node that is predicted.
    pub(crate) seen: u32,
}

/// The person as known so far.
pub(crate) struct Person<'a> {
    /// Both arms.
    pub(crate) tracks: &'a [Track; ARMS],
    /// Both hands.
    pub(crate) blends: [&'a Blend; ARMS],
    /// Number of skeletons so far.
    pub(crate) skeletons: u64,
    /// The arms in use.
    pub(crate) meant: [bool; ARMS],
    /// The robot's left arm. `None` if no hand is brought to where the person's touches.
    pub(crate) robot: Option<(&'a ArmModel, &'a Chain)>,
}

impl Way {
    /// Computes the way of the arms in use: nodes after tick k, with the playhead's present delay. Nodes lie at fixed
    /// instants. They are computed again for a new skeleton, arm or node, and during the crossfade of a restart.
    pub(crate) fn lay(&mut self, person: &Person<'_>, k: u64, playhead: i64, now: Stamp) {
        let Person { tracks, blends, skeletons, meant, robot } = *person;
        let first = k / WAY_NODE_TICKS + 1;
        let known = (self.first, self.skeletons, self.meant) == (first, skeletons, meant);
        if known && !tracks.iter().any(Track::is_fading) {
            return;
        }
        *self = Self { first, skeletons, meant, seen: WAY_NODES as u32, ..Self::default() };
        for arm in (0..ARMS).filter(|&arm| meant[arm]) {
            for i in 0..WAY_NODES {
                let ticks = (i as u64 + 1) * WAY_NODE_TICKS - k % WAY_NODE_TICKS;
                let ahead_ns = ticks * 1_000_000_000 / TICK_HZ;
                let (then, by) = (playhead + ahead_ns as i64, now.plus_ns(ahead_ns));
                let Some((limbs, seen)) = tracks[arm].ahead(then, by) else { continue };
                let needed = i < HAND_NODES || robot.is_some();
                let shown = needed.then(|| tracks[arm].show_ahead(then, by)).flatten();
                let place = robot.zip(shown).and_then(|(robot, shown)| place(robot, arm, &shown, &limbs));
                self.places[i][arm] = place.unwrap_or_default();
                let limbs = [limbs.upper, limbs.fore].map(|limb| single(&on_side(arm, &limb)));
                self.nodes[i][2 * arm..2 * arm + 2].copy_from_slice(&limbs);
                if !seen {
                    self.seen = self.seen.min(i as u32);
                }
                if i < HAND_NODES {
                    let hand = shown.and_then(|shown| hand(arm, &shown, blends[arm]));
                    self.hands[i][arm] = hand.map_or([0.0; 4], |hand| single(&hand));
                }
            }
        }
    }
}

/// Returns the hand of the arm in this sample, with the weight that it has now.
fn hand(arm: usize, sample: &Sample, blend: &Blend) -> Option<UnitQuaternion<f64>> {
    let fore = on_side(arm, &sample.limbs.fore);
    let bend = blend.share(sample.hand.map(|hand| fore.inverse() * on_side(arm, &hand)))?;
    Some(fore * bend)
}

/// Returns the place of a hand that touches, and its weight: the square of its share. With the share itself, dancers' limbs were
/// farther off. Beyond the newest skeleton the hand goes on with the arm's limbs.
fn place((model, chain): (&ArmModel, &Chain), arm: usize, shown: &Sample, limbs: &Limbs) -> Option<[f32; 4]> {
    let (q, share) = shown.touching?;
    let [upper, fore] = [chain.joints[3] - chain.joints[1], chain.hand - chain.joints[3]];
    let on = limbs.upper * upper + limbs.fore * fore - shown.limbs.upper * upper - shown.limbs.fore * fore;
    let at = surface::on_side(arm, chain.hand(model, &q) - chain.joints[0] + on).cast::<f32>();
    Some([at.x, at.y, at.z, (share * share) as f32])
}

fn single(rotation: &UnitQuaternion<f64>) -> [f32; 4] {
    xyzw_from_rotation(rotation).map(|x| x as f32)
}
