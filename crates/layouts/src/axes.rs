//! Directions of a layout's axes.

use serde::Deserialize;

/// A direction as the person sees it, or as an observer of the client's world sees it.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum Direction {
    Forward,
    Back,
    Left,
    Right,
    Up,
    Down,
}

impl Direction {
    /// All directions.
    pub const ALL: [Self; 6] = [Self::Forward, Self::Back, Self::Left, Self::Right, Self::Up, Self::Down];

    /// Returns the index of our axis (x forward, y left, z up), and the sign along it.
    const fn of_ours(self) -> (usize, f64) {
        match self {
            Self::Forward => (0, 1.0),
            Self::Back => (0, -1.0),
            Self::Left => (1, 1.0),
            Self::Right => (1, -1.0),
            Self::Up => (2, 1.0),
            Self::Down => (2, -1.0),
        }
    }
}

/// The axes x, y, z of a layout. They are a signed permutation C of ours: ours = C theirs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    ours: [(usize, f64); 3],
}

impl Axes {
    /// Our own axes.
    pub const OURS: Self = Self::from_directions([Direction::Forward, Direction::Left, Direction::Up]);

    /// Creates the axes with these directions. `None` if two of them lie on one line.
    pub fn new(directions: [Direction; 3]) -> Option<Self> {
        let axes = Self::from_directions(directions);
        (axes.determinant() != 0.0).then_some(axes)
    }

    pub(crate) const fn from_directions([x, y, z]: [Direction; 3]) -> Self {
        Self { ours: [x.of_ours(), y.of_ours(), z.of_ours()] }
    }

    /// Returns 1 for right-handed axes, -1 for left-handed ones, and 0 if the axes are not independent.
    pub fn determinant(&self) -> f64 {
        let [(x, sx), (y, sy), (z, sz)] = self.ours;
        let parity = match [x, y, z] {
            [0, 1, 2] | [1, 2, 0] | [2, 0, 1] => 1.0,
            [0, 2, 1] | [1, 0, 2] | [2, 1, 0] => -1.0,
            _ => 0.0,
        };
        parity * sx * sy * sz
    }

    /// Converts a position: v' = C v.
    pub fn polar(&self, v: [f64; 3]) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (value, (axis, sign)) in v.into_iter().zip(self.ours) {
            out[axis] = sign * value;
        }
        out
    }

    /// Converts an axis of rotation or the vector part of a quaternion: v' = det(C) C v, so that R' = C R C^T.
    pub fn axial(&self, v: [f64; 3]) -> [f64; 3] {
        let determinant = self.determinant();
        self.polar(v).map(|value| determinant * value)
    }
}
