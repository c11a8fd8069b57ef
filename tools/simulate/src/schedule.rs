//! Draws from a seed which faults occur, when and for how long. Prints them and reads them as text.

use crate::kinds::{KIND_COUNT, KINDS, by_name};
use messages::TICK_HZ;
use rand::{RngExt, SeedableRng, seq::SliceRandom};
use rand_pcg::Pcg64Mcg;

/// The last ticks of every run have no faults. Within these 5 s the operator must engage the robot again.
pub const QUIET_TICKS: u64 = 5 * TICK_HZ;

/// A run whose robot still recovers at the end goes on for as long as this at most: 20 s. An arm that was found
/// folded into the body turns by up to 1.5 rad, at 0.09 rad/s.
pub const RECOVERY_TICKS: u64 = 20 * TICK_HZ;

/// The shortest run: some ticks with faults before the quiet ones.
pub const TICKS_MIN: u64 = QUIET_TICKS + TICK_HZ / 2;

/// Mean number of ticks between two storms, if the run is long enough. The operator needs 2 s to come back, and
/// engaging takes 1 to 3 s.
const BETWEEN_STORMS: u64 = 4500;

/// Largest number of episodes in a storm.
const STORM_MAX: usize = 8;

/// Operator faults during an undisturbed engagement. Every second seed begins with one of these alone.
const ALONE: [&str; 3] = ["estop-engaging", "estop", "release"];
/// First and last tick of that fault. In a run that begins at rest, the first enable is refused, because the
/// input must be steady for 0.5 s. The fault comes after the operator has enabled.
const ALONE_TICKS: (u64, u64) = (1250, 1850);

/// One fault for some time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Episode {
    /// Index in [`KINDS`].
    pub kind: usize,
    pub start: u64,
    /// Length, ticks.
    pub ticks: u64,
    /// Parameter that decides everything else about the episode, so that an episode does not depend on the others.
    pub param: u64,
}

/// Draws the faults of a run of `ticks` ticks from these kinds. They come in storms of 1 to 8 episodes, with
/// time to recover between storms. The kinds in `deal` come first, so that a campaign meets all kinds. After
/// them, a third of the seeds draws only kinds of `deal`, and a third only one of these.
pub fn draw(seed: u64, ticks: u64, kinds: &[usize], deal: &[usize]) -> Vec<Episode> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed ^ 0x5eed);
    let end = ticks.saturating_sub(QUIET_TICKS);
    let between = (end / 5).clamp(400, BETWEEN_STORMS);
    // Two of three seeds draw few kinds, and draw those often. Among many kinds, one can hide the effect of another.
    let drawn = match rng.random_range(0..3) {
        0 if !deal.is_empty() => std::slice::from_ref(&deal[rng.random_range(0..deal.len())]),
        1 if !deal.is_empty() => deal,
        _ => kinds,
    };
    let mut deck: Vec<usize> = drawn.iter().flat_map(|&kind| std::iter::repeat_n(kind, 1 + KINDS[kind].more)).collect();
    deck.shuffle(&mut rng);
    let mut next = deal.iter().copied().chain(deck.into_iter().cycle());
    let mut episodes = Vec::new();
    let mut at = rng.random_range(0..between / 2);
    let mut deals = deal.len();
    let first = by_name(ALONE[(seed / 2 % 3) as usize]).filter(|kind| seed % 2 == 1 && kinds.contains(kind));
    if let Some(kind) = first.filter(|_| ALONE_TICKS.1 < end) {
        let (start, param) = (ALONE_TICKS.0, rng.random::<u64>() >> 32);
        episodes.push(Episode { kind, start, ticks: ALONE_TICKS.1 - start, param });
        at += ALONE_TICKS.1;
    }
    while at < end && !kinds.is_empty() {
        // Half of the storms consist of one fault alone.
        let size = if rng.random::<bool>() { 1 } else { rng.random_range(2..=STORM_MAX) };
        // Dealt kinds come in the first storm, because later storms may lie beyond the end.
        let due = std::mem::take(&mut deals);
        let size = size.max(due);
        for n in 0..size {
            let Some(kind) = next.next() else { break };
            let start = at + rng.random_range(0..between / 4);
            let (low, high) = KINDS[kind].ticks;
            // Short episodes are as frequent as long ones.
            let (low, high) = (f64::from(low), f64::from(high));
            let share = rng.random::<f64>();
            // A dealt episode has the longest duration of its kind, so that it has a chance to act.
            let ticks = (low * (high / low).powf(if n < due { 1.0 } else { share })) as u64;
            let ticks = ticks.min(end.saturating_sub(start));
            let param = rng.random::<u64>() >> 32;
            if ticks > 0 {
                episodes.push(Episode { kind, start, ticks, param });
            }
        }
        at += rng.random_range(between / 2..between + between / 2);
    }
    episodes.sort_by_key(|episode| (episode.start, episode.kind, episode.param));
    episodes
}

/// The three kinds that a seed deals first.
pub fn dealt(seed: u64, kinds: &[usize]) -> Vec<usize> {
    let count = kinds.len() as u64;
    if count == 0 { vec![] } else { (0..3).map(|i| kinds[((seed.wrapping_mul(3) + i) % count) as usize]).collect() }
}

/// Formats a schedule as `--faults` takes it.
pub fn to_text(episodes: &[Episode]) -> String {
    let one = |e: &Episode| format!("{}@{}+{}:{:x}", KINDS[e.kind].name, e.start, e.ticks, e.param);
    if episodes.is_empty() { "none".into() } else { episodes.iter().map(one).collect::<Vec<_>>().join(",") }
}

/// Reads the text of [`to_text`]. The error says which part is wrong.
pub fn from_text(text: &str) -> Result<Vec<Episode>, String> {
    if text == "none" {
        return Ok(vec![]);
    }
    text.split(',').map(one).collect()
}

fn one(part: &str) -> Result<Episode, String> {
    let wrong = || format!("{part}: must be name@start+ticks:parameter");
    let (name, rest) = part.split_once('@').ok_or_else(wrong)?;
    let (start, rest) = rest.split_once('+').ok_or_else(wrong)?;
    let (ticks, param) = rest.split_once(':').ok_or_else(wrong)?;
    let kind = by_name(name).ok_or_else(|| format!("{name}: no such fault; there are {KIND_COUNT}, see --list"))?;
    let start = start.parse().map_err(|_| wrong())?;
    let ticks = ticks.parse().map_err(|_| wrong())?;
    let param = u64::from_str_radix(param, 16).map_err(|_| wrong())?;
    Ok(Episode { kind, start, ticks, param })
}
