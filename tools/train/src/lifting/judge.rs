//! Measures how far directions are from the truth on images whose truth is known.

use super::people::{Pair, Pairs};
use super::view::{directions, lengths, turned};
use layouts::{LENGTHS, Lifter};
use std::fmt;

/// Bounds of the turns of the shoulders that are judged apart, degrees.
pub const TURNED_DEG: [f64; 2] = [30.0, 60.0];

/// Errors of the four limbs of the arms, relative to the trunk, degrees.
#[derive(Clone, Debug, Default)]
pub struct Judged {
    /// Mean over all images.
    pub mean_deg: f64,
    /// Means of people who are turned by less than the first bound, by less than the second, and by more. NaN for none.
    pub turned_deg: [f64; 3],
    /// Mean of each clip.
    pub clips: Vec<(String, f64)>,
    /// Mean of what was expected.
    pub expected_deg: f64,
    /// Correlation of the ranks of error and doubt.
    pub rank: f64,
    /// Mean of the half in which the network is surest, and of the other.
    pub halves_deg: [f64; 2],
}

/// Judges a lifter, or, without one, the landmarker's own points in space.
pub fn judge(pairs: &Pairs, lifter: Option<&Lifter>) -> Judged {
    let mut rows: Vec<(f64, f64, f64)> = Vec::new();
    let mut judged = Judged::default();
    for (name, images) in &pairs.clips {
        let before = rows.len();
        let known = typical(images);
        for pair in images {
            let truth = directions(&pair.truth);
            let lifted = lifter.map(|lifter| lifter.lift(&pair.found, Some(known)));
            let (own, expected) = match lifted {
                None => (directions(&pair.world), [0.0; 4]),
                Some(Some(lifted)) => (lifted.directions, [0, 1, 2, 3].map(|i| lifted.expected_rad(i).to_degrees())),
                Some(None) => continue,
            };
            let turn = turned(&pair.truth).abs().to_degrees();
            let error = |i: usize| own[i].dot(&truth[i]).clamp(-1.0, 1.0).acos().to_degrees();
            rows.extend((0..4).map(|i| (error(i), expected[i].min(90.0), turn)));
        }
        judged.clips.push((name.clone(), mean(rows[before..].iter().map(|row| row.0))));
    }
    let [near, far] = TURNED_DEG;
    let between = |low: f64, high: f64| mean(rows.iter().filter(|row| (low..high).contains(&row.2)).map(|row| row.0));
    judged.turned_deg = [between(0.0, near), between(near, far), between(far, 181.0)];
    judged.mean_deg = mean(rows.iter().map(|row| row.0));
    judged.expected_deg = mean(rows.iter().map(|row| row.1));
    let (errors, doubts): (Vec<f64>, Vec<f64>) = rows.iter().map(|row| (row.0, row.1)).unzip();
    judged.rank = correlation(&ranks(&errors), &ranks(&doubts));
    rows.sort_by(|a, b| a.1.total_cmp(&b.1));
    let half = rows.len() / 2;
    judged.halves_deg = [&rows[..half], &rows[half..]].map(|rows| mean(rows.iter().map(|row| row.0)));
    judged
}

/// The lengths that a session would learn: the median of the landmarker's.
fn typical(images: &[Pair]) -> [f64; LENGTHS] {
    std::array::from_fn(|i| {
        let mut all: Vec<f64> = images.iter().map(|pair| lengths(&pair.world)[i]).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(1.0)
    })
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    order.into_iter().enumerate().for_each(|(rank, at)| ranks[at] = rank as f64);
    ranks
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a.iter().copied()), mean(b.iter().copied()));
    let product = |a: &[f64], b: &[f64], mean_a: f64, mean_b: f64| -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum()
    };
    product(a, b, mean_a, mean_b) / (product(a, a, mean_a, mean_a) * product(b, b, mean_b, mean_b)).sqrt()
}

impl Judged {
    /// For the manifest.
    pub fn table(&self) -> toml::Table {
        let rounded = |value: f64| toml::Value::Float((value * 100.0).round() / 100.0);
        let all = [
            ("mean_deg", rounded(self.mean_deg)),
            ("turned_deg", self.turned_deg.map(rounded).to_vec().into()),
            ("expected_deg", rounded(self.expected_deg)),
            ("rank_correlation", rounded(self.rank)),
            ("surer_and_other_half_deg", self.halves_deg.map(rounded).to_vec().into()),
        ];
        all.map(|(name, value)| (name.to_owned(), value)).into_iter().collect()
    }
}

impl fmt::Display for Judged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c] = self.turned_deg;
        let [sure, unsure] = self.halves_deg;
        write!(f, "{:.2} deg (turned {a:.1} / {b:.1} / {c:.1})", self.mean_deg)?;
        write!(f, ", expected {:.1}, rank {:.2}, halves {sure:.1} / {unsure:.1}", self.expected_deg, self.rank)
    }
}
