//! Shrinks a failing schedule.

use crate::oracle::Violation;
use crate::schedule::Episode;

/// Largest number of runs. Each is at most as long as the failing one.
const TRIES_MAX: usize = 300;

/// Leaves out halves, then quarters, down to single episodes, and shortens the rest, as long as a promise is
/// still broken. Any promise counts: a smaller schedule that breaks another one is as good a finding. `fails`
/// runs a schedule.
pub fn smallest(
    episodes: &[Episode],
    violation: &Violation,
    fails: impl Fn(&[Episode]) -> Option<Violation>,
) -> (Vec<Episode>, Violation) {
    let mut tries = 0;
    let mut best = (episodes.to_vec(), violation.clone());
    let mut attempt = |best: &mut (Vec<Episode>, Violation), some: Vec<Episode>| {
        tries += 1;
        let found = if tries > TRIES_MAX { None } else { fails(&some) };
        let smaller = found.is_some();
        if let Some(violation) = found {
            *best = (some, violation);
        }
        smaller
    };
    // Episodes that begin after the failure have no part in it.
    let before: Vec<_> = best.0.iter().copied().filter(|episode| episode.start <= violation.tick).collect();
    attempt(&mut best, before);
    let mut size = best.0.len().div_ceil(2);
    while size > 0 {
        let mut at = 0;
        while at < best.0.len() {
            let mut without = best.0.clone();
            without.drain(at..(at + size).min(without.len()));
            if !attempt(&mut best, without) {
                at += size;
            }
        }
        size /= 2;
    }
    for n in 0..best.0.len() {
        while best.0[n].ticks > 1 {
            let mut shorter = best.0.clone();
            shorter[n].ticks /= 2;
            if !attempt(&mut best, shorter) {
                break;
            }
        }
    }
    best
}
