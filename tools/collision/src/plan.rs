//! The plan of a fit: which links share capsules, how many, and with what margin.

use crate::error::CollisionError;
use serde::{Deserialize, Serialize};

/// Placeholder for `left` and `right` in names of a plan.
pub const SIDE: &str = "{side}";

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Margin that is added to every fitted radius, mm.
    pub margin_mm: f64,
    /// A pair is proved clear if it stays farther apart than this, mm.
    pub clear_mm: f64,
    /// Without that proof, a pair is proved clear if the convex hulls of both capsules' contents stay farther
    /// apart than this, mm.
    pub clear_hull_mm: f64,
    /// The same bound for the pairs named in `close`, and for parts that keep a posture, mm. It may hold for the surfaces instead of the hulls.
    pub clear_close_mm: f64,
    /// Capsules of one wrist, shoulder or neck that are built closer together than the clearance.
    pub close: Vec<[String; 2]>,
    pub groups: Vec<Group>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fingers: Vec<Finger>,
}

/// Links that move as one body and share capsules. `{side}` in its names makes it a pair of groups, left and
/// right, with mirrored capsules.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// Name of its capsules: `name_0`, `name_1`, ..., or `name` if there is one.
    pub name: String,
    /// The link in whose frame the capsules are given.
    pub frame: String,
    pub parts: Vec<Part>,
    pub capsules: usize,
    /// Exponent that makes capsules slim, see `fit::smallest_capsule`.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub slimness: f64,
    /// Given cuts. Further cuts that the number of capsules needs are searched.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cuts: Vec<Cut>,
}

/// A cut at the plane {x : normal . x = offset} in the frame of its group.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Cut {
    /// The part to cut: 0 is the whole. The portion above the plane becomes a new part with the next number.
    pub part: usize,
    /// Normal of unit length.
    pub normal: [f64; 3],
    /// Offset along the normal, m.
    pub offset_m: f64,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    pub link: String,
    /// Indices of its collision elements. Absent means all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub elements: Option<Vec<usize>>,
    /// True if everything below the link belongs to it, swept over its fingers' joints.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub below: bool,
}

/// One finger: a free joint, and joints that a tendon moves together in proportion to their ranges.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Finger {
    pub free: String,
    /// Number of its positions that are tried, both limits included.
    pub free_steps: usize,
    pub coupled: Vec<String>,
    /// Number of their positions that are tried, both limits included.
    pub coupled_steps: usize,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Group {
    pub fn of_link(link: &str) -> Self {
        Self {
            name: link.to_owned(),
            frame: link.to_owned(),
            parts: vec![Part::whole(link)],
            capsules: 1,
            slimness: 0.0,
            cuts: Vec::new(),
        }
    }
}

impl Part {
    pub fn whole(link: &str) -> Self {
        Self { link: link.to_owned(), elements: None, below: false }
    }
}

impl Plan {
    pub fn of_groups(groups: Vec<Group>) -> Self {
        Self {
            margin_mm: 2.0,
            clear_mm: 12.0,
            clear_hull_mm: 10.0,
            clear_close_mm: 0.5,
            close: Vec::new(),
            groups,
            fingers: Vec::new(),
        }
    }

    /// Returns true if `close` names this pair of capsules.
    pub fn is_close(&self, a: &str, b: &str) -> bool {
        let named = |[x, y]: &[String; 2], side: &str| {
            let (x, y) = (x.replace(SIDE, side), y.replace(SIDE, side));
            (x == a && y == b) || (x == b && y == a)
        };
        self.close.iter().any(|names| named(names, "left") || named(names, "right"))
    }

    pub fn text(&self) -> String {
        // Serialising strings, numbers and tables cannot fail.
        toml::to_string_pretty(self).unwrap_or_default()
    }

    /// Reads a plan. `file` names it in errors.
    pub fn parse(file: &str, text: &str) -> Result<Self, CollisionError> {
        let plan: Self = toml::from_str(text).map_err(|error| CollisionError::content(file, error.to_string()))?;
        let bounds = [
            ("margin_mm", plan.margin_mm, 0.0),
            ("clear_mm", plan.clear_mm, 1.0),
            ("clear_hull_mm", plan.clear_hull_mm, 0.0),
            // Above the error of the proofs' arithmetic.
            ("clear_close_mm", plan.clear_close_mm, 0.1),
        ];
        for (key, value, least) in bounds {
            if !(value >= least && value <= 100.0) {
                return Err(CollisionError::content(file, format!("{key} = {value:?}, must be {least} to 100")));
            }
        }
        for group in &plan.groups {
            if group.capsules == 0 || group.capsules > 16 || group.parts.is_empty() {
                let cause = format!("group `{}`: needs parts and 1 to 16 capsules", group.name);
                return Err(CollisionError::content(file, cause));
            }
            for (index, cut) in group.cuts.iter().enumerate() {
                if cut.part > index || index + 2 > group.capsules {
                    let cause = format!("group `{}`: cut {index}: part or number of cuts is too high", group.name);
                    return Err(CollisionError::content(file, cause));
                }
            }
        }
        Ok(plan)
    }
}
