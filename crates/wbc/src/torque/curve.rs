//! Bounds the difference between a torque and its chord, as derived in the parent module. The tables are made once.

use crate::chain::{BODIES, JointSet, KinematicChain, joints};
use crate::config::WbcError;
use crate::dynamics::{GRAVITY_M_PER_S2, Mass, PerJoint};
use crate::trajectory::Arc;
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use robot::Payload;

/// The product of a matrix of `LANES` times four rows, column by column, and a vector.
#[inline]
fn times<const LANES: usize>(matrix: &[[f64; 4]], vector: &PerJoint) -> [f64; JOINTS_MAX] {
    let mut sums = [[0.0; 4]; LANES];
    for (column, x) in matrix.chunks_exact(LANES).zip(vector) {
        for (sum, m) in sums.iter_mut().zip(column) {
            *sum = std::array::from_fn(|lane| sum[lane] + m[lane] * x);
        }
    }
    let mut product = [0.0; JOINTS_MAX];
    product.iter_mut().zip(sums.as_flattened()).for_each(|(out, sum)| *out = *sum);
    product
}

/// The effect of a body's mass on the joints that carry it.
#[derive(Clone, Debug, Default)]
struct Carried {
    /// Revolute joints between the base and the body, in their order.
    turns: Vec<usize>,
    /// Prismatic joints between the base and the body. They come before all revolute ones.
    slides: Vec<usize>,
    /// All of these.
    joints: JointSet,
    /// D: largest distance of the body's origin from the axis of each of `turns`, m. It is zero for the last one.
    away: Vec<f64>,
    /// The axis of the last of `turns`.
    axis: Vector3<f64>,
    /// The body without its payload: mass (kg), centre (m), and second moments about its origin (kg m^2).
    empty: (f64, Vector3<f64>, [f64; 2]),
    /// Its mass with its payload, kg.
    mass_kg: f64,
    /// W: largest first moment about each of `turns`, kg m.
    first: Vec<f64>,
    /// N: largest product of inertia about each pair of `turns`, kg m^2. Each column is `lanes` times four entries.
    second: Vec<[f64; 4]>,
    lanes: usize,
}

/// The tables of a robot.
#[derive(Clone, Debug)]
pub(crate) struct Curves {
    parent: [usize; JOINTS_MAX],
    prismatic: [bool; JOINTS_MAX],
    /// The bodies of the left and the right hand.
    hands: [usize; 2],
    bodies: Vec<Carried>,
    /// Bound of each entry of the mass matrix, column by column, kg m^2, kg m or kg.
    matrix: [PerJoint; JOINTS_MAX],
}

/// Sums over the revolute joints from the base to a body.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    v: f64,
    a: f64,
    jerk: f64,
}

/// The acceleration due to a joint's motion per reach, and its first two derivatives.
#[derive(Clone, Copy, Debug, Default)]
struct Term {
    value: f64,
    rate: f64,
    curve: f64,
}

/// Second moments of |dm| about a body's origin: over all directions, and about the axis of its joint.
fn second_moments(mass: &Mass, axis: &Vector3<f64>) -> [f64; 2] {
    let own = Matrix3::identity() * (mass.about_center.trace() / 2.0) - mass.about_center;
    // A URDF may give an inertia that no mass has. Then negative mass counts as mass.
    let eigen = own.symmetric_eigen();
    let spread = eigen.eigenvectors * Matrix3::from_diagonal(&eigen.eigenvalues.abs()) * eigen.eigenvectors.transpose();
    let all = spread + mass.center * mass.center.transpose() * mass.mass_kg;
    [all.trace(), all.trace() - axis.dot(&(all * axis))]
}

impl Carried {
    fn new(chain: &KinematicChain, body: usize, mass: &Mass) -> Self {
        let set = chain.ancestors(body);
        let of =
            |slides: bool| -> Vec<usize> { joints(set).filter(|&j| chain.links()[j].prismatic == slides).collect() };
        let (turns, slides) = (of(false), of(true));
        let n = turns.len();
        let axis = turns.last().map_or(Vector3::zeros(), |&own| chain.links()[own].axis);
        let mut away = vec![0.0; n];
        for k in 0..n.saturating_sub(1) {
            let offset = |i: usize| chain.links()[turns[i]].parent_from_body.t;
            let rest: f64 = (k + 2..n).map(|i| offset(i).norm()).sum();
            away[k] = chain.links()[turns[k]].axis.cross(&offset(k + 1)).norm() + rest;
        }
        let empty = (mass.mass_kg, mass.center, second_moments(mass, &axis));
        let lanes = match n.div_ceil(4) {
            few @ 0..=2 => few.max(1),
            _ => JOINTS_MAX.div_ceil(4),
        };
        let (first, second) = (vec![0.0; n], vec![[0.0; 4]; lanes * n]);
        let mut carried =
            Self { turns, slides, joints: set, away, axis, empty, mass_kg: mass.mass_kg, first, second, lanes };
        carried.carry(&Payload::EMPTY);
        carried
    }

    /// Updates the tables with the body's payload. A point adds its second moments to the body's. Never allocates.
    fn carry(&mut self, payload: &Payload) {
        let (mut m, mut center, [mut second, mut second_own]) = self.empty;
        let &Payload { mass_kg, center: at } = payload;
        if mass_kg > 0.0 {
            center = (center * m + at * mass_kg) / (m + mass_kg);
            m += mass_kg;
            second += mass_kg * at.norm_squared();
            second_own += mass_kg * self.axis.cross(&at).norm_squared();
        }
        self.mass_kg = m;
        let spread = (m * second).sqrt();
        let (n, away) = (self.turns.len(), &self.away);
        for k in 0..n {
            self.first[k] =
                if k + 1 == n { m * self.axis.cross(&center).norm() } else { m * (away[k] + center.norm()) };
            for l in 0..n {
                self.second[l * self.lanes + k / 4][k % 4] = match (k + 1 == n, l + 1 == n) {
                    (true, true) => second_own,
                    (true, false) => away[l] * (m * second_own).sqrt() + (second * second_own).sqrt(),
                    (false, true) => away[k] * (m * second_own).sqrt() + (second * second_own).sqrt(),
                    (false, false) => m * away[k] * away[l] + (away[k] + away[l]) * spread + second,
                };
            }
        }
    }
}

impl Curves {
    pub(crate) fn new(chain: &KinematicChain, masses: &[Mass; BODIES]) -> Result<Self, WbcError> {
        for (joint, link) in chain.links().iter().enumerate() {
            if link.prismatic && joints(chain.ancestors(link.parent)).any(|k| !chain.links()[k].prismatic) {
                return Err(WbcError::Kinematics { joint, what: "is prismatic, but attached to a revolute joint" });
            }
        }
        let bodies: Vec<Carried> = (0..=chain.count()).map(|b| Carried::new(chain, b, &masses[b])).collect();
        let link = |j: usize| chain.links().get(j);
        let mut curves = Self {
            parent: std::array::from_fn(|j| link(j).map_or(0, |link| link.parent)),
            prismatic: std::array::from_fn(|j| link(j).is_some_and(|link| link.prismatic)),
            hands: chain.hands(),
            bodies,
            matrix: [[0.0; JOINTS_MAX]; JOINTS_MAX],
        };
        curves.bound_matrix();
        Ok(curves)
    }

    /// Sets the payload of the hands. Never allocates.
    pub(crate) fn carry(&mut self, payload: &[Payload; 2]) {
        for (hand, payload) in self.hands.into_iter().zip(payload) {
            self.bodies[hand].carry(payload);
        }
        self.bound_matrix();
    }

    /// Sums the contributions of all bodies to each bound of the mass matrix.
    fn bound_matrix(&mut self) {
        let mut matrix = [[0.0; JOINTS_MAX]; JOINTS_MAX];
        for body in &self.bodies {
            for (i, &j) in body.turns.iter().enumerate() {
                for (l, &k) in body.turns.iter().enumerate() {
                    matrix[k][j] += body.second[l * body.lanes + i / 4][i % 4];
                }
                for &k in &body.slides {
                    matrix[j][k] += body.first[i];
                    matrix[k][j] += body.first[i];
                }
            }
            for &j in &body.slides {
                for &k in &body.slides {
                    matrix[j][k] += body.mass_kg;
                }
            }
        }
        self.matrix = matrix;
    }

    /// Largest difference between each torque of `open` and its chord over a segment of `dt` seconds, N m or
    /// N. The first part comes from curvature, the second from kinks. `set` must contain all joints that
    /// these torques depend on. Other entries are undefined.
    pub(crate) fn slack(&self, arcs: &[Arc; JOINTS_MAX], open: JointSet, set: JointSet, dt: f64) -> [PerJoint; 2] {
        let mut sums = [Sums::default(); BODIES];
        let mut terms = [Term::default(); JOINTS_MAX];
        let mut curves = [0.0; JOINTS_MAX];
        for j in joints(set) {
            let above = sums[self.parent[j]];
            if self.prismatic[j] {
                sums[j + 1] = above;
                continue;
            }
            let Arc { v, a, jerk, chord, slope, .. } = arcs[j];
            terms[j] = Term {
                value: chord + v * (v + 2.0 * above.v),
                rate: slope + 2.0 * (v * a + v * above.a + a * above.v),
                curve: 2.0 * (v * jerk + a * a + v * above.jerk + 2.0 * a * above.a + jerk * above.v),
            };
            let own = Sums { v: above.v + v, a: above.a + a, jerk: above.jerk + jerk };
            sums[j + 1] = own;
            if self.bodies[j + 1].joints & open == 0 {
                continue;
            }
            self.add(&self.bodies[j + 1], &own, &terms, arcs, open, &mut curves);
        }
        let mut slack = [[0.0; JOINTS_MAX]; 2];
        for j in joints(open) {
            slack[0][j] = curves[j] * dt * dt / 8.0;
        }
        // Column by column, so that the processor need not wait for one sum after another.
        for (column, arc) in self.matrix.iter().zip(arcs).filter(|(_, arc)| arc.kink != 0.0) {
            slack[1].iter_mut().zip(column).for_each(|(sum, m)| *sum += m * arc.kink);
        }
        slack
    }

    /// Time of the kink that may take the torque of `joint` farthest from its chord.
    pub(crate) fn sharpest(&self, arcs: &[Arc; JOINTS_MAX], joint: usize) -> f64 {
        let row = self.matrix.iter().zip(arcs).map(|(column, arc)| (column[joint] * arc.kink, arc.kink_t));
        row.fold((0.0, 0.0), |most, this| if this.0 > most.0 { this } else { most }).1
    }

    /// Adds the contribution of one body to the curvature of each torque.
    #[inline]
    fn add(
        &self,
        body: &Carried,
        sums: &Sums,
        terms: &[Term; JOINTS_MAX],
        arcs: &[Arc; JOINTS_MAX],
        open: JointSet,
        curves: &mut PerJoint,
    ) {
        let (turn, turned) = (sums.v, sums.v * sums.v + sums.a);
        let (mut lift, mut lift_rate) = (GRAVITY_M_PER_S2, 0.0);
        for &k in &body.slides {
            lift += arcs[k].chord;
            lift_rate += arcs[k].slope;
        }
        let gravity = lift * turned + 2.0 * turn * lift_rate;
        let mut felt = [0.0; JOINTS_MAX];
        let mut carried = 0.0;
        for (i, &k) in body.turns.iter().enumerate() {
            let Term { value, rate, curve } = terms[k];
            felt[i] = value * 2.0 * (turned + turn * turn) + 4.0 * turn * rate + curve;
            carried += body.first[i] * (value * turned + 2.0 * turn * rate + curve);
        }
        let inertial = match body.lanes {
            0..=1 => times::<1>(&body.second, &felt),
            2 => times::<2>(&body.second, &felt),
            _ => times::<{ JOINTS_MAX.div_ceil(4) }>(&body.second, &felt),
        };
        for (i, &j) in body.turns.iter().enumerate() {
            if open & 1 << j != 0 {
                curves[j] += body.first[i] * gravity + inertial[i];
            }
        }
        for &j in &body.slides {
            curves[j] += carried;
        }
    }
}
