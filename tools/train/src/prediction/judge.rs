//! Measures how far predictions are from the person's later motion, on clips that were not used for training.

use super::data::{Recording, Seen, history};
use nalgebra::UnitQuaternion;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use retarget::{AGES_S, Extrapolation, Limbs, Prediction, limb_error_deg};

/// Judged times after the newest frame, s.
pub const JUDGED_S: [f64; 6] = [0.06, 0.1, 0.16, 0.2, 0.3, 0.4];
/// Shortest time over which a rate of turning is measured, s. The stage uses the same.
const RATE_OVER_S: f64 = 0.03;
/// Time between two judged instants, s.
const STEP_S: f64 = 1.0 / 30.0;
const SEED: u64 = 5;

#[derive(Clone, Copy, Debug)]
pub struct Condition {
    pub name: &'static str,
    pub rate_hz: f64,
    pub noise_deg: f64,
}

pub const CONDITIONS: [Condition; 4] = [
    Condition { name: "60_hz", rate_hz: 60.0, noise_deg: 0.0 },
    Condition { name: "60_hz_half_a_degree_of_noise", rate_hz: 60.0, noise_deg: 0.5 },
    Condition { name: "20_hz", rate_hz: 20.0, noise_deg: 0.0 },
    Condition { name: "240_hz_half_a_degree_of_noise", rate_hz: 240.0, noise_deg: 0.5 },
];

/// One angle at each of `JUDGED_S`.
type Degrees = [f64; JUDGED_S.len()];

/// Mean angles between prediction and person over limbs and instants, degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Means {
    pub name: &'static str,
    /// Errors of each of `KINDS`.
    pub deg: [Degrees; 3],
}

/// Judged predictions: every limb stays where it is, or continues its last turning with a decaying rate, or does what
/// was learnt.
const KINDS: [&str; 3] = ["stays_deg", "fades_deg", "learnt_deg"];

/// Judges every instant that has half a second before it and all of `JUDGED_S` after it.
pub fn judge(recordings: &[Recording], prediction: &Prediction, condition: &Condition) -> Means {
    let of = |recording: &Recording| of_one(recording, prediction, condition);
    let all: Vec<([Degrees; 3], f64)> = recordings.par_iter().map(of).collect();
    let count: f64 = all.iter().map(|(_, count)| count).sum();
    let mean = |kind: usize| std::array::from_fn(|i| all.iter().map(|(sums, _)| sums[kind][i]).sum::<f64>() / count);
    Means { name: condition.name, deg: [0, 1, 2].map(mean) }
}

/// Returns the sums of the errors of each kind, and their number.
fn of_one(recording: &Recording, prediction: &Prediction, condition: &Condition) -> ([Degrees; 3], f64) {
    let mut rng = Pcg64::new(u128::from(SEED), 0x10d6e);
    let (mut sums, mut count) = ([Degrees::default(); 3], 0.0);
    let (first_s, last_s) = (AGES_S[AGES_S.len() - 1], recording.end_s() - JUDGED_S[JUDGED_S.len() - 1]);
    let steps = ((last_s - first_s) / STEP_S).max(0.0) as usize;
    for at_s in (0..steps).map(|i| first_s + i as f64 * STEP_S) {
        let noise_rad = condition.noise_deg.to_radians();
        let turn = UnitQuaternion::identity();
        let seen = Seen { at_s, rate_hz: condition.rate_hz, speed: 1.0, turn, noise_rad };
        let frames = seen.frames(recording, &mut rng);
        for own in 0..2 {
            let newest = frames[0][own];
            let over = (RATE_OVER_S * condition.rate_hz).ceil();
            let before = (&frames[over as usize][own], (over / condition.rate_hz * 1e9) as i64);
            let [learnt] = prediction.turns(&[history(&frames, condition.rate_hz, own)]);
            let fades = Extrapolation::fading(&newest, Some(before));
            let kinds = [Extrapolation::default(), fades, learnt.map_or(fades, |turns| Extrapolation::learnt(&turns))];
            for (i, ahead_s) in JUDGED_S.iter().enumerate() {
                let person: Limbs = seen.after(recording, *ahead_s)[own];
                for (sums, kind) in sums.iter_mut().zip(&kinds) {
                    let there = kind.at(&newest, (ahead_s * 1e9) as i64);
                    sums[i] += limb_error_deg(&there, &person).iter().sum::<f64>() / 2.0;
                }
            }
            count += 1.0;
        }
    }
    (sums, count)
}

impl Means {
    pub fn table(&self) -> toml::Table {
        let rounded = |degrees: &Degrees| degrees.map(|deg| (deg * 1e3).round() / 1e3).to_vec().into();
        let ahead_ms = JUDGED_S.map(|ahead_s| (ahead_s * 1e3).round()).to_vec().into();
        let rows = KINDS.iter().zip(&self.deg).map(|(name, degrees)| ((*name).to_owned(), rounded(degrees)));
        std::iter::once(("ahead_ms".to_owned(), ahead_ms)).chain(rows).collect()
    }
}
