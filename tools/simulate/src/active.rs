//! The episodes in force at a tick, and how often each kind has fired.

use crate::kinds::{Fault, KIND_COUNT, KINDS};
use crate::schedule::Episode;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

#[derive(Clone, Debug)]
pub struct Active {
    pub episode: Episode,
    pub fault: Fault,
    /// Random number generator of this episode alone.
    pub rng: Pcg64Mcg,
    pub age: u64,
    /// Severity, 0 to 1.
    pub strength: f64,
    /// Scratch value for the stage that applies the fault.
    pub note: u64,
}

impl Active {
    /// Returns true if the fault acts this time. It acts on a share of the occasions, between 0.2 and 1, that
    /// grows with its strength.
    pub fn acts(&mut self) -> bool {
        let share = 0.2 + 0.8 * self.strength;
        self.rng.random::<f64>() < share
    }

    /// Elapsed share of the episode, 0 to 1.
    pub fn progress(&self) -> f64 {
        self.age as f64 / self.episode.ticks.max(1) as f64
    }
}

#[derive(Clone, Debug)]
pub struct Faults {
    episodes: Vec<Episode>,
    next: usize,
    pub active: Vec<Active>,
    /// Occasions on which a fault reached its stage, by kind.
    pub fired: [u64; KIND_COUNT],
}

impl Faults {
    pub fn new(episodes: &[Episode]) -> Self {
        let mut episodes = episodes.to_vec();
        episodes.sort_by_key(|episode| (episode.start, episode.kind, episode.param));
        Self { episodes, next: 0, active: Vec::new(), fired: [0; KIND_COUNT] }
    }

    /// Advances to tick `k`. Returns true if any episode began or ended.
    pub fn advance(&mut self, k: u64) -> bool {
        let before = self.active.len();
        self.active.retain_mut(|active| {
            active.age = k - active.episode.start;
            active.age < active.episode.ticks
        });
        let mut changed = self.active.len() != before;
        while let Some(episode) = self.episodes.get(self.next).filter(|episode| episode.start <= k) {
            let mut rng = Pcg64Mcg::seed_from_u64(episode.param);
            let strength = rng.random::<f64>();
            let fault = KINDS[episode.kind].fault;
            self.active.push(Active { episode: *episode, fault, rng, age: 0, strength, note: 0 });
            self.next += 1;
            changed = true;
        }
        changed
    }

    pub fn count(&mut self, kind: usize, count: u64) {
        self.fired[kind] += count;
    }

    /// Calls `act` on every active fault that `wanted` maps to `Some`. The fault counts as fired each time
    /// `act` returns true.
    pub fn each<T>(&mut self, wanted: impl Fn(Fault) -> Option<T>, mut act: impl FnMut(&mut Active, T) -> bool) {
        for active in &mut self.active {
            if let Some(of) = wanted(active.fault)
                && act(active, of)
            {
                self.fired[active.episode.kind] += 1;
            }
        }
    }
}
