//! Compares the robot's hands with the person's, and with the best that its wrists could do.
//!
//! The person's hand asks for positions of the wrist's joints, at the robot's own forearm. The *optimum* is the motion that
//! stays nearest to them within the wrist's positions, speeds and accelerations. It looks ahead over the whole series:
//!
//! ```text
//! minimise  sum_i (w_i - h_i)^2,   |w_(i+1) - w_i| <= V dt,   |w_(i+1) - 2 w_i + w_(i-1)| <= A dt^2
//! ```
//!
//! The best that *knows* no more than the robot does is the same, again at each sample, over the following delay ahead.
//! The search of the optimum is the method of multipliers with alternating directions, in pieces of 6 s. It knows no collisions. Beyond the
//! wrist's range, another motion might come nearer to the person by the angle.

use super::play::SAMPLE_TICKS;
use messages::{JointCommand, JointTarget, TICK_S};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Rotation3, UnitQuaternion};
use retarget::rotation_from_xyzw;
use robot::{Frames, JointLimits, Model};

/// A hand counts as free if the best posture of its wrist leaves every pair so much clearance, m: twice what commands keep.
/// Nearer than that, it has to turn away.
const FREE_M: f64 = 0.02;
/// Number of samples before and after it that must be free, too: 0.3 s. A wrist needs as long to turn away by 0.4 rad, and
/// back.
const FREE_SAMPLES: usize = 15;
/// Longest series of the search, samples. Its work grows with the square.
const SERIES_MAX: usize = 300;
/// Steps of the search, and the weight of its multipliers. After these no position of the six clips in the book moves by
/// more than 1 mrad.
const STEPS: usize = 2000;
const MULTIPLIER: f64 = 5.0;
/// Steps of each search that knows only what is ahead. After half of them no mean of the six clips in the book differs by more
/// than 0.1 degrees.
const FORESEE_STEPS: usize = 60;
/// Weight of the second differences beside the first, so that both bounds are of one size.
const SECOND: f64 = 5.0;
/// Time between two samples, s.
const SAMPLE_S: f64 = SAMPLE_TICKS as f64 * TICK_S;

#[derive(Clone, Copy, Debug)]
pub(crate) struct HandSample {
    k: u64,
    side: usize,
    person: UnitQuaternion<f64>,
    fore: UnitQuaternion<f64>,
    commanded: [f64; 3],
    best: [f64; 3],
    clear: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandError {
    pub command_deg: f64,
    pub optimum_deg: f64,
    /// The same of the best motion that knows the person's hand no farther ahead than the following delay.
    pub known_deg: f64,
    /// The hand could be there without coming near anything.
    pub free: bool,
}

pub(crate) fn samples(model: &Model, target: &JointTarget, command: &JointCommand) -> Vec<HandSample> {
    let of = |(side, hand): (usize, [f64; 4])| {
        let person = rotation_from_xyzw(hand)?;
        let (arm, wrist) = (&model.arms[side], &model.wrists[side]);
        let (_, fore) = arm.limb_rotations(&arm.limb_values(&command.q));
        let fore = turn(&fore);
        let best = wrist.nearest(&(fore.inverse() * person), wrist.home);
        let commanded = wrist.joints.map(|joint| joint.map_or(0.0, |j| command.q[j]));
        let mut there = command.q;
        wrist.with(best).for_each(|(j, q)| there[j] = q);
        let mut frames = Frames::default();
        model.forward(&there, &mut frames);
        let clear = model.clearance(&frames).0 >= FREE_M;
        Some(HandSample { k: command.k, side, person, fore, commanded, best, clear })
    };
    target.human_hands.into_iter().enumerate().filter_map(of).collect()
}

pub(crate) fn errors(model: &Model, samples: &[HandSample], ahead_s: f64) -> Vec<HandError> {
    let of_side = |side: usize| samples.iter().filter(|sample| sample.side == side).copied().collect::<Vec<_>>();
    let sides = [0, 1].map(of_side);
    let series = sides.iter().flat_map(|side| side.chunk_by(|a, b| a.k + SAMPLE_TICKS == b.k));
    series.flat_map(|series| errors_of(model, series, ahead_s)).collect()
}

fn errors_of(model: &Model, series: &[HandSample], ahead_s: f64) -> Vec<HandError> {
    let near = |i: usize| &series[i.saturating_sub(FREE_SAMPLES)..series.len().min(i + FREE_SAMPLES + 1)];
    let free: Vec<bool> = (0..series.len()).map(|i| near(i).iter().all(|sample| sample.clear)).collect();
    let pieces = series.chunks(SERIES_MAX).zip(free.chunks(SERIES_MAX));
    pieces.flat_map(|(piece, free)| errors_of_piece(model, piece, free, ahead_s)).collect()
}

fn errors_of_piece(model: &Model, series: &[HandSample], free: &[bool], ahead_s: f64) -> Vec<HandError> {
    let wrist = &model.wrists[series[0].side];
    let reached = [0, 1, 2].map(|i| {
        let wanted = DVector::from_iterator(series.len(), series.iter().map(|sample| sample.best[i]));
        wrist.joints[i].map_or_else(|| wanted.clone(), |joint| reach(&wanted, &model.limits[joint]))
    });
    let known = [0, 1, 2].map(|i| {
        let wanted: Vec<f64> = series.iter().map(|sample| sample.best[i]).collect();
        let ahead = (ahead_s / SAMPLE_S).round() as usize;
        wrist.joints[i].map_or_else(|| wanted.clone(), |joint| foresee(&wanted, ahead, &model.limits[joint]))
    });
    let off = |sample: &HandSample, q: [f64; 3]| {
        (sample.fore * turn(&wrist.rotation(q))).angle_to(&sample.person).to_degrees()
    };
    let error = |(i, sample): (usize, &HandSample)| HandError {
        command_deg: off(sample, sample.commanded),
        optimum_deg: off(sample, reached.each_ref().map(|q| q[i])),
        known_deg: off(sample, known.each_ref().map(|q| q[i])),
        free: free[i],
    };
    series.iter().enumerate().map(error).collect()
}

/// Returns the positions of one joint that come nearest to `wanted`, rad. `wanted` lies within the range, so they do.
fn reach(wanted: &DVector<f64>, limits: &JointLimits) -> DVector<f64> {
    let n = wanted.len();
    let bounds = |i: usize| {
        if i + 1 < n { limits.v_max * SAMPLE_S } else { SECOND * limits.a_max * SAMPLE_S * SAMPLE_S }
    };
    // Rows: n - 1 first differences, then n - 2 second ones.
    let rows = (n - 1) + n.saturating_sub(2);
    let mut differences = DMatrix::zeros(rows, n);
    for i in 0..n - 1 {
        (differences[(i, i)], differences[(i, i + 1)]) = (-1.0, 1.0);
    }
    for i in 0..n.saturating_sub(2) {
        let row = n - 1 + i;
        (differences[(row, i)], differences[(row, i + 1)], differences[(row, i + 2)]) = (SECOND, -2.0 * SECOND, SECOND);
    }
    let system = DMatrix::identity(n, n) + differences.transpose() * &differences * MULTIPLIER;
    let Some(factor): Option<Cholesky<f64, Dyn>> = system.cholesky() else { return wanted.clone() };
    let inverse = factor.inverse();
    let mut reached = wanted.clone();
    let (mut allowed, mut excess) = (DVector::zeros(rows), DVector::zeros(rows));
    for _ in 0..STEPS {
        reached = &inverse * (wanted + differences.tr_mul(&(&allowed - &excess)) * MULTIPLIER);
        let moved = &differences * &reached + &excess;
        allowed = DVector::from_fn(rows, |i, _| moved[i].clamp(-bounds(i), bounds(i)));
        excess = moved - &allowed;
    }
    reached
}

/// Returns the positions of one joint that come nearest to the next `ahead` positions of `wanted`, rad, again at each
/// sample. Speeds ahead keep the limit, and the next one keeps the acceleration, too.
fn foresee(wanted: &[f64], ahead: usize, limits: &JointLimits) -> Vec<f64> {
    let (v_max, change) = (limits.v_max, limits.a_max * SAMPLE_S);
    let (mut at, mut speed) = (wanted.first().copied().unwrap_or_default(), 0.0_f64);
    let mut out = Vec::with_capacity(wanted.len());
    for i in 0..wanted.len() {
        out.push(at);
        let next = &wanted[(i + 1).min(wanted.len())..(i + 1 + ahead).min(wanted.len())];
        let mut speeds: Vec<f64> = vec![speed; next.len()];
        // Projected gradient on the speeds. 2 / (n dt)^2 is below the inverse of the matrix's largest eigenvalue.
        let rate = 2.0 / (next.len() as f64 * SAMPLE_S).powi(2);
        for _ in 0..FORESEE_STEPS {
            let mut reached = at;
            let mut off: Vec<f64> = next
                .iter()
                .zip(&speeds)
                .map(|(wanted, speed)| {
                    reached += speed * SAMPLE_S;
                    reached - wanted
                })
                .collect();
            for j in (1..off.len()).rev() {
                off[j - 1] += off[j];
            }
            for (speed, slope) in speeds.iter_mut().zip(&off) {
                *speed = (*speed - rate * slope * SAMPLE_S).clamp(-v_max, v_max);
            }
            if let Some(first) = speeds.first_mut() {
                *first = first.clamp(speed - change, speed + change);
            }
        }
        speed = speeds.first().copied().unwrap_or_default();
        at += speed * SAMPLE_S;
    }
    out
}

fn turn(matrix: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*matrix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_motion_is_reached_and_step_is_met_halfway_at_full_speed() {
        let toml = include_str!("../../../../config/robots/tiago_dual.toml");
        let urdf = include_str!("../../../../config/robots/tiago_dual.urdf");
        let model = Model::from_text("toml", toml, "urdf", urdf).expect("the shipped robot");
        let limits = &model.limits[model.wrists[0].joints[0].expect("a wrist")];
        let slow = DVector::from_fn(100, |i, _| 0.3 * (i as f64 * SAMPLE_S).sin());
        assert!((reach(&slow, limits) - &slow).amax() < 1e-3);
        let step = DVector::from_fn(100, |i, _| if i < 50 { -0.5 } else { 0.5 });
        let reached = reach(&step, limits);
        let speeds: Vec<f64> = (1..100).map(|i| (reached[i] - reached[i - 1]) / SAMPLE_S).collect();
        let fastest = speeds.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let hardest = speeds.windows(2).fold(0.0, |most: f64, v| most.max((v[1] - v[0]).abs() / SAMPLE_S));
        println!("{fastest:.3} rad/s, {hardest:.2} rad/s^2, {:.3} and {:.3} rad", reached[49], reached[50]);
        assert!(fastest < limits.v_max * 1.01 && hardest < limits.a_max * 1.02, "{fastest} {hardest}");
        assert!(fastest > limits.v_max * 0.9, "it hurries: {fastest}");
        assert!((reached[49] + reached[50]).abs() < 0.01, "as late as early: {} {}", reached[49], reached[50]);
    }
}
