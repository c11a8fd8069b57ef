//! A first plan, made from the robot alone: which links share capsules, and how many. A person may edit it.
//!
//! - Every link that has shapes is fitted by itself, on both sides. Nothing is mirrored, because arms whose joints
//!   mirror may have the same elbow twice.
//! - Links that stand still relative to each other share capsules where those are hardly larger.
//! - A joint beyond the end of an arm that nothing commands belongs to a hand. It is swept over its range. Others
//!   (legs) stand where the robot file holds them.
//! - A capsule much larger than the hull inside is cut in two, where that saves a lot.
//! - So is a capsule that is too close to another at home, or in most postures of the two joints between them. If
//!   they are built so close, the pair is called close.
//! - If no cut helps, the joints between them get narrower ranges, with which the pair never touches.

use crate::blocking_pairs::{Finder, Near};
use crate::error::CollisionError;
use crate::fit::{Shape, rough_capsule};
use crate::narrow::narrow;
use crate::plan::{Finger, Group, Part, Plan};
use crate::scene::{Posture, Scene, has_shapes};
use crate::split::Splitter;
use crate::write::{Named, named};
use nalgebra::Vector3;
use rayon::prelude::*;
use robot::{CAPSULES_MAX, Frames, Model};
use rt::err;
use std::collections::HashMap;
use std::path::Path;
use urdf_rs::JointType;

/// Links share a capsule that is at most this much larger than theirs together (chosen).
const MERGED_RATIO: f64 = 1.2;
/// A capsule is cut if it is larger than this many times its hull, and a cut saves enough (chosen).
const VOLUME_RATIO: f64 = 2.0;
/// A cut saves at least this share of its capsule (chosen) ...
const SAVED_SHARE: f64 = 0.2;
/// ... and at least this volume, m^3: the volume of a finger (chosen).
const SAVED_M3: f64 = 1e-4;
/// Largest number of capsules of one group (chosen).
const CELLS_MAX: usize = 6;
/// Number of positions of each joint of a hand that are tried, both limits included (chosen).
const FINGER_STEPS: usize = 9;
/// A near capsule is cut if that saves at least this share of it (chosen).
const SAVED_NEAR_SHARE: f64 = 0.1;
/// Largest number of rounds in which near capsules are cut (chosen).
const ROUNDS: usize = 12;
/// Largest number of times that ranges are narrowed (chosen).
const NARROWED_MAX: usize = 8;

#[derive(Clone, Debug)]
pub struct First {
    pub plan: Plan,
    /// The capsules of the plan, as `fit_all` makes them.
    pub capsules: Vec<Named>,
    pub notes: Vec<String>,
    /// The same robot with the ranges that the plan needs. Those of its other joints are as before.
    pub narrowed: Model,
}

#[derive(Clone)]
struct Draft {
    group: Group,
    splitter: Splitter,
    /// The capsules of its cells when they were last made.
    named: Vec<Named>,
    /// True if a cell was cut since.
    is_cut: bool,
}

struct Shaped {
    link: String,
    body: usize,
    /// Its surface in the body's frame.
    points: Vec<Vector3<f64>>,
}

pub fn first_plan(
    model: &Model,
    urdf: &urdf_rs::Robot,
    meshes: Option<&Path>,
    held: &Posture,
) -> Result<First, CollisionError> {
    let tree = Tree { model, urdf };
    let palms = tree.palms()?;
    let fingers = tree.fingers(&palms);
    let scene = Scene::new(urdf, meshes, &fingers).holding(held.clone());
    let mut groups = merged(tree.shaped(&palms, &scene)?, &tree)?;
    for palm in &palms {
        groups.push(Group { parts: vec![Part { below: true, ..Part::whole(palm) }], ..tree.group(palm)? });
    }
    let draft = |group: Group| {
        Ok(Draft { splitter: Splitter::new(scene.matter(&group)?, &[], 0.0), group, named: Vec::new(), is_cut: true })
    };
    let mut drafts: Vec<Draft> = groups.into_par_iter().map(draft).collect::<Result<_, CollisionError>>()?;
    drafts.par_iter_mut().for_each(|draft| cut_fat(&mut draft.splitter));
    let mut plan = Plan::of_groups(Vec::new());
    let mut narrowed = model.clone();
    let (capsules, notes) = cut_near(&mut narrowed, &scene, &mut plan, &mut drafts)?;
    plan.groups = drafts.into_iter().map(Draft::planned).collect();
    plan.fingers = fingers;
    Ok(First { plan, capsules, notes, narrowed })
}

impl Draft {
    /// Makes the capsules of its cells if one was cut. Those of the same shape keep their contents, and what is known of them.
    fn name_again(&mut self, plan: &Plan, scene: &Scene<'_>) -> Result<(), CollisionError> {
        if std::mem::take(&mut self.is_cut) {
            let before = std::mem::replace(&mut self.named, named(plan, &self.group, self.splitter.cells(), scene)?);
            for capsule in &mut self.named {
                let same = before.iter().find(|known| (&known.link, known.shape) == (&capsule.link, capsule.shape));
                same.into_iter().for_each(|known| capsule.content = known.content.clone());
            }
        }
        Ok(())
    }

    fn planned(self) -> Group {
        Group { capsules: self.splitter.cells().len(), cuts: self.splitter.cuts().to_vec(), ..self.group }
    }
}

pub(crate) struct Tree<'a> {
    pub(crate) model: &'a Model,
    pub(crate) urdf: &'a urdf_rs::Robot,
}

impl Tree<'_> {
    fn above(&self, link: &str) -> Option<&urdf_rs::Joint> {
        self.urdf.joints.iter().find(|joint| joint.child.link == link)
    }

    pub(crate) fn lineage<'a>(&'a self, link: &'a str) -> Vec<&'a str> {
        let parent = |link: &&'a str| self.above(link).map(|joint| joint.parent.link.as_str());
        std::iter::successors(Some(link), parent).take(self.urdf.links.len()).collect()
    }

    /// Returns the nearest link that the robot has: this one or one above. The shapes' URDF may have more links.
    pub(crate) fn known<'a>(&'a self, link: &'a str) -> Result<&'a str, CollisionError> {
        let known = self.lineage(link).into_iter().find(|link| self.model.link_body(link).is_some());
        known.ok_or_else(|| {
            CollisionError::content(&self.urdf.name, format!("link `{link}`: the robot has none above it"))
        })
    }

    fn body(&self, link: &str) -> Result<usize, CollisionError> {
        let body = self.model.link_body(self.known(link)?).map(|(body, _)| body);
        Ok(body.unwrap_or_default())
    }

    fn group(&self, link: &str) -> Result<Group, CollisionError> {
        Ok(Group { frame: self.known(link)?.to_owned(), ..Group::of_link(link) })
    }

    /// Returns the movable joints above a link up to the next commanded one, from the link upward.
    fn uncommanded(&self, link: &str) -> Vec<&urdf_rs::Joint> {
        let joints = self.lineage(link).into_iter().filter_map(|link| self.above(link));
        let commanded = |joint: &&urdf_rs::Joint| self.model.joint_names.contains(&joint.name);
        let own = joints.take_while(|joint| !commanded(joint));
        own.filter(|joint| joint.joint_type != JointType::Fixed).collect()
    }

    /// Returns the links of the arms' ends from which hands hang: the parents of their first joints.
    pub(crate) fn palms(&self) -> Result<Vec<String>, CollisionError> {
        let mut palms: Vec<String> = Vec::new();
        for link in self.urdf.links.iter().filter(|link| has_shapes(link)) {
            let Some(first) = self.uncommanded(&link.name).pop() else { continue };
            let palm = &first.parent.link;
            let body = self.body(palm)?;
            let at_hand = self.model.arms.iter().any(|arm| arm.hand_body() == body);
            if at_hand && !palms.contains(palm) {
                palms.push(palm.clone());
            }
        }
        let inner =
            |palm: &String| self.lineage(palm).iter().skip(1).any(|link| palms.iter().any(|other| other == link));
        let outer = palms.iter().filter(|palm| !inner(palm)).cloned();
        Ok(outer.collect())
    }

    /// Returns the fingers below these palms. A finger's first joint is free. The others bend together.
    pub(crate) fn fingers(&self, palms: &[String]) -> Vec<Finger> {
        let mut chains: Vec<Vec<String>> = Vec::new();
        for link in self.urdf.links.iter().filter(|link| self.below(&link.name, palms)) {
            let mut names: Vec<String> = self.uncommanded(&link.name).iter().map(|joint| joint.name.clone()).collect();
            names.reverse();
            if !names.is_empty() && !chains.iter().any(|chain| chain.starts_with(&names)) {
                chains.retain(|chain| !names.starts_with(chain));
                chains.push(names);
            }
        }
        let finger = |chain: Vec<String>| {
            let coupled_steps = if chain.len() > 1 { FINGER_STEPS } else { 1 };
            let (free, coupled) = (chain[0].clone(), chain[1..].to_vec());
            Finger { free, free_steps: FINGER_STEPS, coupled, coupled_steps }
        };
        chains.into_iter().map(finger).collect()
    }

    fn below(&self, link: &str, palms: &[String]) -> bool {
        self.lineage(link).iter().any(|link| palms.iter().any(|palm| palm == link))
    }

    /// Returns the links that have shapes, without the hands.
    fn shaped(&self, palms: &[String], scene: &Scene<'_>) -> Result<Vec<Shaped>, CollisionError> {
        let with_shapes = self.urdf.links.iter().filter(|link| has_shapes(link));
        let own: Vec<_> = with_shapes.filter(|link| !self.below(&link.name, palms)).collect();
        let shaped = |link: &&urdf_rs::Link| {
            let (body, link) = (self.body(&link.name)?, link.name.clone());
            let lineage = self.lineage(&link);
            let top = *lineage
                .iter()
                .take_while(|link| self.body(link).is_ok_and(|b| b == body))
                .last()
                .unwrap_or(&lineage[0]);
            let pose = scene.pose(top, &link, &Posture::new())?;
            let points = scene.points(&link)?.iter().map(|point| pose.transform_point(point)).collect();
            Ok(Shaped { body, points, link })
        };
        own.par_iter().map(shaped).collect()
    }

    /// Returns the nearest link that is above both or one of the two.
    fn common(&self, a: &str, b: &str) -> Result<String, CollisionError> {
        let above = self.lineage(b);
        let common = self.lineage(a).into_iter().find(|link| above.contains(link));
        common.map(str::to_owned).ok_or_else(|| CollisionError::content(&self.urdf.name, "has two roots"))
    }
}

/// Groups links of one body whose common capsule is hardly larger than their own.
fn merged(links: Vec<Shaped>, tree: &Tree<'_>) -> Result<Vec<Group>, CollisionError> {
    let volume = |points: &[Vector3<f64>]| rough_capsule(points).map_or(0.0, |shape| shape.volume_m3());
    let group = |shaped: Shaped| {
        let volume = volume(&shaped.points);
        Ok((tree.group(&shaped.link)?, shaped, volume))
    };
    let mut groups: Vec<(Group, Shaped, f64)> =
        links.into_par_iter().map(group).collect::<Result<_, CollisionError>>()?;
    // A group that takes in another one becomes a new one. What encloses two old ones stays known.
    let mut ids: Vec<usize> = (0..groups.len()).collect();
    let mut known: HashMap<[usize; 2], f64> = HashMap::new();
    loop {
        let pairs: Vec<(usize, usize)> = (0..groups.len())
            .flat_map(|b| (0..b).map(move |a| (a, b)))
            .filter(|(a, b)| groups[*a].1.body == groups[*b].1.body)
            .collect();
        let common = |(a, b): &(usize, usize)| {
            let key = [ids[*a], ids[*b]];
            let both = || groups[*a].1.points.iter().chain(&groups[*b].1.points).copied().collect::<Vec<_>>();
            (key, known.get(&key).copied().unwrap_or_else(|| volume(&both())))
        };
        known = pairs.par_iter().map(common).collect();
        let ratio = |(a, b): &(usize, usize)| {
            let volume = known[&[ids[*a], ids[*b]]];
            (volume / (groups[*a].2 + groups[*b].2), volume)
        };
        let best = pairs.iter().map(|pair| (pair, ratio(pair))).min_by(|x, y| x.1.0.total_cmp(&y.1.0));
        let Some((&(a, b), (_, volume))) = best.filter(|(_, (ratio, _))| *ratio <= MERGED_RATIO) else { break };
        let (group, shaped, _) = groups.remove(b);
        ids[a] = ids.iter().max().map_or(0, |last| last + 1);
        ids.remove(b);
        let kept = &mut groups[a];
        let frame = tree.common(&kept.0.frame, &group.frame)?;
        kept.0.frame = frame;
        kept.0.parts.extend(group.parts);
        kept.1.points.extend(shaped.points);
        kept.2 = volume;
    }
    Ok(groups.into_iter().map(|(group, ..)| group).collect())
}

/// Cuts capsules that are much larger than their hulls.
fn cut_fat(splitter: &mut Splitter) {
    while splitter.cells().len() < CELLS_MAX {
        let fat: Vec<usize> = (0..splitter.cells().len()).filter(|at| is_fat(splitter, *at)).collect();
        let savings = fat.into_iter().filter_map(|at| Some((at, splitter.saving_m3(at)?)));
        let most = savings.max_by(|a, b| a.1.total_cmp(&b.1));
        let enough = |at: usize| (SAVED_SHARE * splitter.cells()[at].shape.volume_m3()).max(SAVED_M3);
        match most {
            Some((at, saved)) if saved >= enough(at) => splitter.cut(at),
            _ => break,
        };
    }
}

fn is_fat(splitter: &Splitter, at: usize) -> bool {
    let cell = &splitter.cells()[at];
    cell.shape.volume_m3() > SAVED_M3 && cell.volume_ratio() > VOLUME_RATIO
}

/// Cuts capsules that are too near others, and names the pairs that are built close. Returns the capsules, and notes about
/// the pairs that stay near. Where no cut helps, it narrows ranges, and begins again: a later fit with these makes the same
/// cuts.
fn cut_near(
    model: &mut Model,
    scene: &Scene<'_>,
    plan: &mut Plan,
    drafts: &mut [Draft],
) -> Result<(Vec<Named>, Vec<String>), CollisionError> {
    let (mut finder, mut whole) = (Finder::default(), None);
    let (mut round, mut narrowed) = (0, 0);
    loop {
        round += 1;
        let mut capsules: Vec<Named> = Vec::new();
        let mut cells: Vec<(usize, usize)> = Vec::new();
        for (index, draft) in drafts.iter_mut().enumerate() {
            draft.name_again(plan, scene)?;
            capsules.extend(draft.named.iter().cloned());
            cells.extend((0..draft.splitter.cells().len()).map(|cell| (index, cell)));
        }
        let whole = whole.get_or_insert_with(|| drafts.to_vec());
        let near = finder.find(model, plan, &capsules)?;
        plan.close = near.iter().filter(|near| near.is_close()).map(|near| near.names.clone()).collect();
        let blocking = near.iter().filter(|near| near.can_be_cut()).count();
        err!("round {round}: {} capsules, {blocking} pairs too near", capsules.len());
        let narrowable = |only: fn(&Near) -> bool| {
            near.iter().filter(move |near| near.is_blocking() && only(near) && narrowed < NARROWED_MAX)
        };
        let mut again = narrow_all(model, plan, &capsules, narrowable(|near| near.keep || !near.can_be_cut()));
        let cut = if again { Vec::new() } else { cut_all(model, drafts, (&capsules, &cells), &near, round) };
        if !again && cut.is_empty() {
            again = narrow_all(model, plan, &capsules, narrowable(|_| true));
            if !again {
                return Ok((capsules, near.iter().map(Near::sentence).collect()));
            }
        }
        if again {
            (round, narrowed) = (0, narrowed + 1);
            drafts.clone_from_slice(whole);
        }
        cut.into_iter().for_each(|draft| drafts[draft].is_cut = true);
    }
}

/// Narrows the ranges of the joints between these pairs where that helps. Returns false if it helps nowhere.
fn narrow_all<'a>(model: &mut Model, plan: &Plan, capsules: &[Named], pairs: impl Iterator<Item = &'a Near>) -> bool {
    let before = model.limits;
    for near in pairs {
        if let Some(narrowed) = narrow(model, plan, capsules, near) {
            *model = narrowed;
        }
    }
    model.limits != before
}

/// Cuts one capsule of each pair that is too near, where that helps. Returns the drafts that were cut.
fn cut_all(
    model: &Model,
    drafts: &mut [Draft],
    (capsules, cells): (&[Named], &[(usize, usize)]),
    near: &[Near],
    round: usize,
) -> Vec<usize> {
    let mut cut: Vec<usize> = Vec::new();
    for near in near.iter().filter(|near| near.can_be_cut()) {
        let room = capsules.len() + 2 * cut.len() + 1 < CAPSULES_MAX && round <= ROUNDS;
        let both = near.pair.map(|capsule| cells[capsule]);
        if !room || both.iter().any(|(draft, _)| cut.contains(draft)) {
            continue;
        }
        let free = both.into_iter().filter(|(draft, _)| drafts[*draft].splitter.cells().len() < CELLS_MAX);
        let free: Vec<(usize, usize)> = free.collect();
        let savings = free.iter().filter_map(|&(draft, cell)| {
            let saved = drafts[draft].splitter.saving_m3(cell)?;
            let enough = SAVED_NEAR_SHARE * drafts[draft].splitter.cells()[cell].shape.volume_m3();
            (saved > enough).then_some((saved, draft, cell))
        });
        if let Some((_, draft, cell)) = savings.max_by(|a, b| a.0.total_cmp(&b.0)) {
            drafts[draft].splitter.cut(cell);
            cut.push(draft);
        } else {
            cut.extend(cut_away(model, drafts, capsules, near.pair, both));
        }
    }
    cut
}

/// Cuts one capsule of a pair, so that both are farther apart at home. Returns its draft.
fn cut_away(
    model: &Model,
    drafts: &mut [Draft],
    capsules: &[Named],
    pair: [usize; 2],
    cells: [(usize, usize); 2],
) -> Option<usize> {
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    [0, 1].into_iter().find_map(|own| {
        let ((draft, cell), [named, other]) = (cells[own], [own, 1 - own].map(|side| &capsules[pair[side]]));
        let pose = |named: &Named| model.link_pose(&frames, &named.link);
        let own_from_other = pose(named)?.inverse().compose(&pose(other)?);
        let place = |point| own_from_other.transform_point(point);
        let other = Shape { a: place(&other.shape.a), b: place(&other.shape.b), radius_m: other.shape.radius_m };
        drafts[draft].splitter.cut_away(cell, &other, CELLS_MAX).then_some(draft)
    })
}
