//! Collision geometry: capsules on bodies, and the pairs of them that are checked.

use crate::error::RobotError;
use crate::file::{Allowed, CapsuleEntry};
use crate::kinematics::Frames;
use crate::model::Model;
use crate::segment::segment_distance;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Largest number of capsules of a robot. Their end points in the base frame must fit on the stack of a tick.
pub const CAPSULES_MAX: usize = 64;

/// All points within `radius_m` of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Capsule {
    /// Unique name.
    pub name: String,
    /// The body it is fixed to.
    pub body: usize,
    /// One end of the axis in the body's frame, m.
    pub a: Vector3<f64>,
    /// The other end, m.
    pub b: Vector3<f64>,
    /// Radius, m.
    pub radius_m: f64,
}

impl Capsule {
    /// Returns both ends of its axis in the base frame, m.
    pub fn ends(&self, frames: &Frames) -> [Vector3<f64>; 2] {
        let pose = &frames.base_from_body[self.body];
        [pose.transform_point(&self.a), pose.transform_point(&self.b)]
    }
}

/// Two capsules that are checked against each other, with `a < b`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pair {
    /// Index of one capsule.
    pub a: usize,
    /// Index of the other.
    pub b: usize,
}

/// The reason why a pair is not checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AllowedReason {
    /// Both are on one body, so they cannot move relative to each other.
    SameBody,
    /// They are on two bodies with one joint between them, whose mechanical stops keep them apart.
    Adjacent,
    /// The collision tool has proved that they keep the clearance over the whole box of the position limits
    /// in force.
    ProvedClear,
    /// The collision tool has proved that they overlap in the maker's own description, in every posture within the
    /// position limits in force. So no command could keep a clearance, and nothing keeps them apart.
    OverlapAsPublished,
}

/// Two capsules that are not checked against each other, with `a < b`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub struct AllowedPair {
    pub a: usize,
    pub b: usize,
    pub reason: AllowedReason,
}

impl Model {
    /// The least clearance of all checked pairs, m, and the index of that pair in `pairs`. It is negative if
    /// the capsules overlap. Without pairs it is infinite, and the index is 0. Never allocates.
    pub fn clearance(&self, frames: &Frames) -> (f64, usize) {
        let mut ends = [[Vector3::zeros(); 2]; CAPSULES_MAX];
        for (end, capsule) in ends.iter_mut().zip(&self.capsules) {
            *end = capsule.ends(frames);
        }
        let mut least = (f64::INFINITY, 0);
        for (index, pair) in self.pairs.iter().enumerate() {
            let ([a0, a1], [b0, b1]) = (&ends[pair.a], &ends[pair.b]);
            let radii = self.capsules[pair.a].radius_m + self.capsules[pair.b].radius_m;
            let clearance = segment_distance(a0, a1, b0, b1).distance_m - radii;
            if clearance < least.0 {
                least = (clearance, index);
            }
        }
        least
    }
}

pub(crate) fn read_capsules(
    file: &str,
    entries: &[CapsuleEntry],
    body_of: impl Fn(&str) -> Option<(usize, crate::pose::Pose)>,
) -> Result<Vec<Capsule>, RobotError> {
    if entries.is_empty() || entries.len() > CAPSULES_MAX {
        let bound = format!("must be 1 to {CAPSULES_MAX}");
        return Err(RobotError::value(file, "number of collision.capsules", entries.len().to_string(), bound));
    }
    let mut capsules: Vec<Capsule> = Vec::with_capacity(entries.len());
    for entry in entries {
        let key = format!("collision.capsules `{}`", entry.name);
        if capsules.iter().any(|capsule| capsule.name == entry.name) {
            return Err(RobotError::duplicate(file, "capsule", &entry.name));
        }
        let (body, body_from_link) = body_of(&entry.link)
            .ok_or_else(|| RobotError::unknown(file, format!("{key}: link"), &entry.link, "a link of the URDF"))?;
        // No robot with such arms has a capsule 2 m from its link or 1 m thick.
        let refuse = |name: &str, value: f64, bound: &str| {
            RobotError::value(file, format!("{key}: {name}"), schema::short(value), bound)
        };
        if let Some(value) = entry.a_m.iter().chain(&entry.b_m).find(|value| !(value.abs() <= 2.0)) {
            return Err(refuse("a_m or b_m", *value, "at most 2 in magnitude"));
        }
        if !(entry.radius_m > 0.0 && entry.radius_m <= 1.0) {
            return Err(refuse("radius_m", entry.radius_m, "must be above 0, at most 1"));
        }
        capsules.push(Capsule {
            name: entry.name.clone(),
            body,
            a: body_from_link.transform_point(&entry.a_m.into()),
            b: body_from_link.transform_point(&entry.b_m.into()),
            radius_m: entry.radius_m,
        });
    }
    Ok(capsules)
}

/// Sorts every pair of capsules into checked and allowed. A pair without a reason is checked.
pub(crate) fn read_pairs(
    file: &str,
    capsules: &[Capsule],
    allowed: &Allowed,
    parent_body: impl Fn(usize) -> Option<usize>,
) -> Result<(Vec<Pair>, Vec<AllowedPair>), RobotError> {
    let mut reasons: BTreeMap<Pair, AllowedReason> = BTreeMap::new();
    let tables = [
        (AllowedReason::Adjacent, "adjacent", &allowed.adjacent),
        (AllowedReason::ProvedClear, "proved_clear", &allowed.proved_clear),
        (AllowedReason::OverlapAsPublished, "overlap_as_published", &allowed.overlap_as_published),
    ];
    for (reason, table_name, table) in tables {
        let find = |name: &str| {
            let known = capsules.iter().position(|capsule| capsule.name == name);
            known.ok_or_else(|| RobotError::unknown(file, format!("collision.allowed.{table_name}"), name, "a capsule"))
        };
        for (first, others) in table {
            for second in others {
                let (x, y) = (find(first)?, find(second)?);
                let pair = Pair { a: x.min(y), b: x.max(y) };
                let (a, b) = (capsules[x].body, capsules[y].body);
                let key = format!("collision.allowed.{table_name}.{first}");
                let refuse = |bound: &str| RobotError::value(file, key.as_str(), format!("`{second}`"), bound);
                if reason == AllowedReason::Adjacent && parent_body(a) != Some(b) && parent_body(b) != Some(a) {
                    return Err(refuse("only bodies with one joint between them are adjacent"));
                }
                if a == b {
                    return Err(refuse("capsules of one body need no entry"));
                }
                if reasons.insert(pair, reason).is_some() {
                    return Err(refuse("a pair may be listed once"));
                }
            }
        }
    }
    let (mut pairs, mut listed) = (Vec::new(), Vec::new());
    for b in 0..capsules.len() {
        for a in 0..b {
            let same = (capsules[a].body == capsules[b].body).then_some(AllowedReason::SameBody);
            match same.or_else(|| reasons.get(&Pair { a, b }).copied()) {
                Some(reason) => listed.push(AllowedPair { a, b, reason }),
                None => pairs.push(Pair { a, b }),
            }
        }
    }
    pairs.sort_unstable();
    listed.sort_unstable_by_key(|pair| (pair.a, pair.b));
    Ok((pairs, listed))
}
