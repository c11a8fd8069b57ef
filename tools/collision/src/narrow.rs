//! Narrower ranges of joints, with which two parts that are built close never touch.

use crate::blocking_pairs::{Near, postures};
use crate::judge::{HULL_JOINTS_MAX, Judge};
use crate::plan::Plan;
use crate::prove::deciding_joints;
use crate::write::Named;
use robot::Model;

/// Narrower ranges leave at least this between the surfaces in the sampled postures, m (chosen): proofs are then quick.
const APART_M: f64 = 2e-3;
/// Range around home and the T-pose that a joint keeps, on either side, rad or m (chosen).
const KEPT: f64 = 0.05;
/// Range around home of a joint that keeps a posture, on either side, rad or m (chosen). It is halved for each proof that fails.
const STILL: f64 = 0.2;
/// Share of its range that a joint loses more for each proof that fails, and the number of proofs (chosen).
const STEP_SHARE: f64 = 0.05;
const STEPS: usize = 6;
/// Number of parts of a rad or metre to which a range is rounded inward.
const PARTS: f64 = 1e4;

/// Returns the model with narrower ranges, in which the pair never touches, or touches everywhere. `None` if no such ranges
/// contain home and T-pose. Both arms get them if they mirror each other.
pub fn narrow(model: &Model, plan: &Plan, capsules: &[Named], near: &Near) -> Option<Model> {
    let [first, second] = near.pair;
    let body = |index: usize| model.link_body(&capsules[index].link).map(|(body, _)| body);
    let (of_a, of_b) = deciding_joints(model, body(first)?, body(second)?);
    let joints: Vec<usize> = of_a.into_iter().chain(of_b).collect();
    if joints.is_empty() || joints.len() > HULL_JOINTS_MAX {
        return None;
    }
    let whole: Vec<[f64; 2]> = joints.iter().map(|j| [model.limits[*j].q_min, model.limits[*j].q_max]).collect();
    let judge = Judge::new(model, plan, capsules);
    let keep = judge.keep_posture(first, second);
    let t_pose = model.t_pose();
    let core = |j: &usize| {
        let (home, t_pose) = (model.home[*j], t_pose[*j]);
        [home.min(t_pose) - KEPT, home.max(t_pose) + KEPT]
    };
    let cores: Vec<[f64; 2]> = joints.iter().map(core).collect();
    let near_m = |frames: &_| judge.distance_m(first, second, frames, [f64::NEG_INFINITY, APART_M]).unwrap_or(0.0);
    let touching = postures(model, &joints).filter(|(_, frames)| !keep && near_m(frames) <= APART_M);
    let touching: Vec<Vec<f64>> = touching.map(|(q, _)| joints.iter().map(|j| q[*j]).collect()).collect();
    let cut = widest(&touching, &whole, &cores)?;
    (0..STEPS).find_map(|step| {
        let mut trial = model.clone();
        for (i, j) in joints.iter().enumerate() {
            let more = step as f64 * STEP_SHARE * (cut[i][1] - cut[i][0]);
            let inward = |end: usize| if cut == whole || cut[i][end] != whole[i][end] { more } else { 0.0 };
            let still = STILL * 0.5_f64.powi(step as i32);
            let range = if keep {
                [model.home[*j] - still, model.home[*j] + still]
            } else {
                [(cut[i][0] + inward(0)).min(cores[i][0]), (cut[i][1] - inward(1)).max(cores[i][1])]
            };
            set_range(&mut trial, *j, range);
        }
        let judge = Judge::new(&trial, plan, capsules);
        let proved = judge.prove_close(first, second).is_some();
        (proved || keep && judge.prove_overlap(first, second)).then_some(trial)
    })
}

/// Returns the widest ranges that contain the cores and none of these positions. Each end of a range that is cut loses all
/// positions on its side of the core.
fn widest(positions: &[Vec<f64>], whole: &[[f64; 2]], cores: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    let cut = |ends: usize| {
        let mut ranges = whole.to_vec();
        for (i, range) in ranges.iter_mut().enumerate() {
            for q in positions.iter().map(|q| q[i]) {
                if ends >> (2 * i) & 1 == 1 && q < cores[i][0] {
                    range[0] = range[0].max(q);
                } else if ends >> (2 * i + 1) & 1 == 1 && q > cores[i][1] {
                    range[1] = range[1].min(q);
                }
            }
        }
        let inside = |q: &Vec<f64>| q.iter().zip(&ranges).all(|(q, range)| *q > range[0] && *q < range[1]);
        let share = |(range, whole): (&[f64; 2], &[f64; 2])| (range[1] - range[0]) / (whole[1] - whole[0]);
        let left: f64 = ranges.iter().zip(whole).map(share).product();
        (!positions.iter().any(inside)).then_some((left, ranges))
    };
    let all = (0..1 << (2 * whole.len())).filter_map(cut);
    all.reduce(|most, next| if next.0 > most.0 { next } else { most }).map(|(_, ranges)| ranges)
}

/// Narrows the range of a joint, and that of the same joint of an arm that mirrors this one.
fn set_range(model: &mut Model, joint: usize, [low, high]: [f64; 2]) {
    let mut both = vec![(joint, [low, high])];
    let [left, right] = [0, 1].map(|side| model.arms[side].range());
    for ((l, r), sign) in left.zip(right).zip(model.arms[1].joint_signs()).filter(|_| model.mirrored) {
        let mirrored = if sign > 0.0 { [low, high] } else { [-high, -low] };
        both.extend([(l, r), (r, l)].iter().filter(|(own, _)| *own == joint).map(|(_, other)| (*other, mirrored)));
    }
    for (j, [low, high]) in both {
        let limits = &mut model.limits[j];
        let (low, high) = ((low * PARTS).ceil() / PARTS, (high * PARTS).floor() / PARTS);
        limits.q_min = if low > limits.q_min + 1.0 / PARTS { low } else { limits.q_min };
        limits.q_max = if high < limits.q_max - 1.0 / PARTS { high } else { limits.q_max };
    }
}
