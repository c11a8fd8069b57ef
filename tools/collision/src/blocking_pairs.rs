//! Pairs of capsules that would keep a robot from moving: too close at home, or in most postures.

use crate::error::CollisionError;
use crate::judge::{Judge, Proof};
use crate::plan::Plan;
use crate::prove::{clearance, deciding_joints};
use crate::write::{Named, on_bodies};
use messages::JOINTS_MAX;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use robot::{Capsule, Frames, JointLimits, Model};
use std::collections::HashMap;
use std::sync::Arc;

/// Number of postures of the two joints between neighbours' neighbours that are tried (chosen).
const POSTURES: usize = 400;
/// A pair two joints apart that is too close in more than this share of the postures may be built so (chosen).
const SHARE: f64 = 0.1;
/// A pair two joints apart that is too close in more than this share needs smaller capsules (chosen).
const SHARE_CUT: f64 = 0.5;

/// A pair that is closer than the clearance at home, or in most postures of the two joints between them.
#[derive(Clone, Debug)]
pub struct Near {
    pub pair: [usize; 2],
    pub names: [String; 2],
    home_m: f64,
    surfaces_m: Option<f64>,
    /// Clearance that commands must keep, m.
    needed_m: f64,
    /// Share of the postures in which the capsules are too close. It is absent if more than two joints are between.
    share: Option<f64>,
    /// Least distance of the surfaces in sampled postures, m. It is absent with a proof, and with more joints between.
    least_m: Option<f64>,
    proof: Option<Proof>,
    /// Joints between them, if they are few.
    joints: Vec<String>,
    /// True if these only keep a posture.
    pub keep: bool,
}

impl Near {
    /// Returns true if the pair never meets, so that it needs no check.
    pub fn is_close(&self) -> bool {
        self.proof.is_some()
    }

    /// Returns true if more capsules can help.
    pub fn can_be_cut(&self) -> bool {
        let is_cut = self.home_m < self.needed_m || self.share.is_some_and(|share| share > SHARE_CUT);
        is_cut && !self.is_close() && self.surfaces_m.is_none_or(|distance| distance >= self.needed_m)
    }

    /// Returns true if the capsules are too close at home, and the parts may touch elsewhere.
    pub fn is_blocking(&self) -> bool {
        self.home_m < self.needed_m && !self.is_close()
    }

    /// Says what is near, and by how much.
    pub fn sentence(&self) -> String {
        let mm = 1e3;
        let [a, b] = &self.names;
        let (home, needed) = (self.home_m * mm, self.needed_m * mm);
        let mut text = match self.share {
            Some(share) if share > SHARE => {
                let percent = share * 100.0;
                format!("{a} - {b}: nearer than {needed:.1} mm in {percent:.0} % of all postures, {home:.1} mm at home")
            }
            _ => format!("{a} - {b}: {home:.1} mm at home, must be {needed:.1} mm"),
        };
        if let Some(surfaces) = self.surfaces_m {
            text += &format!(". The surfaces are {:.1} mm apart there", surfaces * mm);
        }
        match &self.proof {
            Some(proof) => text + &format!(". Built close: proved clear by {proof}, so it needs no check"),
            None => {
                if let Some(least) = self.least_m {
                    text += &format!(", and {:.1} mm in the worst sampled posture", least * mm);
                }
                text += ". It stays a checked pair";
                if !self.joints.is_empty() {
                    text += &format!(". Narrow the ranges of {} under [tighten]", self.joints.join(", "));
                    text += if self.keep { ", or list them under [held_rad]" } else { " until they cannot touch" };
                }
                text
            }
        }
    }
}

/// Finds pairs without a reason that are too close at home, or in most postures. It remembers what it found, because
/// proofs are slow.
#[derive(Default)]
pub struct Finder {
    /// The capsules of the last call. They keep the addresses of their contents.
    capsules: Vec<Named>,
    /// Findings about each pair, by the addresses of both contents.
    known: HashMap<[usize; 2], Option<Near>>,
    /// The limits in force of the last call. A finding does not outlive a narrower range between its parts.
    limits: Option<[JointLimits; JOINTS_MAX]>,
}

impl Finder {
    pub fn find(&mut self, model: &Model, plan: &Plan, capsules: &[Named]) -> Result<Vec<Near>, CollisionError> {
        let bodies = on_bodies(model, capsules)?;
        let bare = Plan { close: Vec::new(), ..plan.clone() };
        let judge = Judge::new(model, &bare, capsules);
        let mut frames = Frames::default();
        model.forward(&model.home, &mut frames);
        let pairs: Vec<[usize; 2]> = (0..bodies.len()).flat_map(|b| (0..b).map(move |a| [a, b])).collect();
        let limits = self.limits.replace(model.limits).unwrap_or(model.limits);
        let stays = |[a, b]: [usize; 2]| {
            let (of_a, of_b) = deciding_joints(model, bodies[a].body, bodies[b].body);
            of_a.iter().chain(&of_b).all(|j| limits[*j] == model.limits[*j])
        };
        let known = |key: &[usize; 2], pair| self.known.get(key).filter(|_| stays(pair)).cloned();
        let look = |&pair: &[usize; 2]| {
            let key = pair.map(|index| Arc::as_ptr(&capsules[index].content) as usize);
            let names = pair.map(|index| capsules[index].name.clone());
            let same = |near: Near| Near { pair, names: names.clone(), ..near };
            (key, known(&key, pair).unwrap_or_else(|| near(&judge, &bodies, &frames, pair)).map(same))
        };
        let found: Vec<_> = pairs.par_iter().map(look).collect();
        let all = found.iter().filter_map(|(_, near)| near.clone()).collect();
        self.known = found.into_iter().collect();
        self.capsules = capsules.to_vec();
        Ok(all)
    }
}

fn near(judge: &Judge<'_>, bodies: &[Capsule], frames: &Frames, pair: [usize; 2]) -> Option<Near> {
    let ([first, second], model) = (pair, judge.model());
    let (a, b) = (&bodies[first], &bodies[second]);
    let next = |a: usize, b: usize| a == b || model.parent_body(a) == Some(b);
    if next(a.body, b.body) || next(b.body, a.body) {
        return None;
    }
    let (of_a, of_b) = deciding_joints(model, a.body, b.body);
    let joints: Vec<usize> = of_a.into_iter().chain(of_b).collect();
    let share = (joints.len() == 2).then(|| near_share(model, a, b, &joints));
    let home_m = clearance(frames, a, b);
    if home_m >= model.d_min_m && share.is_none_or(|share| share <= SHARE) || judge.decide(first, second).is_some() {
        return None;
    }
    // For parts that keep a posture, this is what has just failed.
    let keep = judge.keep_posture(first, second);
    let proof = if keep { None } else { judge.prove_close(first, second) };
    let surfaces_m = judge.distance_m(first, second, frames, [f64::NEG_INFINITY, f64::INFINITY]);
    let unknown = proof.is_none() && joints.len() == 2;
    let least_m = unknown.then(|| {
        let nearer = |least_m: f64, (_, frames)| {
            judge.distance_m(first, second, &frames, [f64::NEG_INFINITY, least_m]).map_or(least_m, |m| m.min(least_m))
        };
        postures(model, &joints).fold(f64::INFINITY, nearer)
    });
    let names = [a.name.clone(), b.name.clone()];
    let few = joints.into_iter().filter(|_| keep || share.is_some());
    let joints = few.map(|j| model.joint_names[j].clone()).collect();
    Some(Near { pair, names, home_m, surfaces_m, needed_m: model.d_min_m, share, least_m, proof, joints, keep })
}

/// Returns the share of the joints' postures in which two capsules are closer than the clearance.
fn near_share(model: &Model, a: &Capsule, b: &Capsule, joints: &[usize]) -> f64 {
    let closer = postures(model, joints).filter(|(_, frames)| clearance(frames, a, b) < model.d_min_m).count();
    closer as f64 / POSTURES as f64
}

/// Returns random postures of these joints. The others are at home.
pub(crate) fn postures<'a>(
    model: &'a Model,
    joints: &'a [usize],
) -> impl Iterator<Item = ([f64; JOINTS_MAX], Frames)> + 'a {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
    (0..POSTURES).map(move |_| {
        let (mut q, mut frames) = (model.home, Frames::default());
        for j in joints {
            q[*j] = rng.random_range(model.limits[*j].q_min..model.limits[*j].q_max);
        }
        model.forward(&q, &mut frames);
        (q, frames)
    })
}
