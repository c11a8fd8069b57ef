//! Trajectory controllers between the driver and the joints, simulated.
//!
//! Some robots take no setpoints. They have joint trajectory controllers (TIAGo++ four: torso, head, left arm, right arm)
//! that take trajectory points. [`Interface::Jtc100`] is a driver for them. Every h = 10 ms of the index it hands
//! position and velocity of its executed motion, command or plan, to all of them. Each of them lays a cubic through
//! the points (Hermite) and follows it at a delay of its own,
//!
//! ```text
//! y_k(t) = spline_k(t - D - d_g),   D = h,   0 <= d_g <= h
//! ```
//!
//! D is the time by which the newest point must be ahead. d_g is drawn once per run from the seed, because the
//! controllers are not synchronised, and the network and their cycles add delays.
//!
//! *Bounds.* For |q'''| <= J the spline differs from q by at most J h^3 / 96, and its derivative from q' by at
//! most J h^2 / 30. The constants are the largest integrals over a period of the magnitude of the Peano kernel
//! and of its derivative. They are 1/96 in the middle, and 0.0323 at 0.23 h from either end. So limits of
//! position and velocity may be exceeded by these amounts ([`spline_error`], [`spline_speed_error`]). The jerk of
//! a spline jumps from point to point.
//!
//! This is what such a controller does with curves that reach into its past. A controller of ROS 2 Humble that gets one
//! point per message does something else, [`Interface::Jtc100Restart`]. At each message it begins again at the measured
//! position with velocity 0, and makes a cubic to the point, which is due D + d_g later. The next message comes before
//! that. Each restart is a step of the setpoint, from where it was to where the joint is. A joint that follows its
//! setpoint late never gets there: the robot creeps. Source: the documentation of
//! `joint_trajectory_controller`, and ros2_controllers#1505.

use crate::cubic::cubic;
use driver::{Interface, POINT_S, POINT_TICKS, Setpoint};
use messages::{JOINTS_MAX, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::CONTROLLERS_MAX;

/// Ticks of a gap between two setpoints that are executed one by one. After that many ticks every controller is
/// at its end.
const GAP_MAX_TICKS: u64 = 1500;
/// Separates the draw of the delays from the draw of the noise.
const DELAY_STREAM: u64 = 0x4a54_4331_3030_687a;

/// Returns the largest distance of the spline from a motion of this jerk, rad or m.
pub fn spline_error(j_max: f64) -> f64 {
    j_max * POINT_S.powi(3) / 96.0
}

/// Returns the largest difference of their velocities, rad/s or m/s.
pub fn spline_speed_error(j_max: f64) -> f64 {
    j_max * POINT_S.powi(2) / 30.0
}

/// A trajectory point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    q: [f64; JOINTS_MAX],
    v: [f64; JOINTS_MAX],
}

/// The controllers.
#[derive(Clone, Debug)]
pub(crate) struct Controllers {
    /// d_g, ticks.
    delay_ticks: [f64; CONTROLLERS_MAX],
    /// Number of controllers.
    count: usize,
    /// Number of each joint's controller.
    controller: [usize; JOINTS_MAX],
    /// The last three points. The newest is that of the last multiple of a period.
    points: [Point; 3],
    /// The driver's last executed setpoint.
    last: Setpoint,
    /// Measured positions at the newest point, where every controller began again. None if they do not.
    restarts: Option<[f64; JOINTS_MAX]>,
}

impl Controllers {
    /// Creates the controllers of the joints of `body`, at rest at `held`. Returns `None` for an interface without any.
    pub(crate) fn new(interface: Interface, body: &plant::Body, held: &Setpoint, seed: u64) -> Option<Self> {
        let restarts = match interface {
            Interface::Direct => return None,
            Interface::Jtc100 => None,
            Interface::Jtc100Restart => Some(held.q),
        };
        let controller = std::array::from_fn(|j| body.joints.get(j).map_or(0, |joint| joint.controller));
        let mut rng = Pcg64::seed_from_u64(seed ^ DELAY_STREAM);
        Some(Self {
            delay_ticks: std::array::from_fn(|_| rng.random_range(0.0..=POINT_TICKS as f64)),
            count: controller.iter().max().map_or(1, |last| last + 1).min(CONTROLLERS_MAX),
            controller,
            points: points_before(held),
            last: *held,
            restarts,
        })
    }

    /// Puts the controllers at `held`, without moving there, as if `held` had come with its speed. Controllers do
    /// so after their drives were off. Returns the setpoint of the joints now.
    pub(crate) fn hold(&mut self, held: &Setpoint) -> Setpoint {
        self.points = points_before(held);
        self.last = *held;
        self.restarts = self.restarts.map(|_| held.q);
        self.executed(held.k)
    }

    /// Returns D + d_g of each controller, s.
    pub(crate) fn delays_s(&self) -> Vec<f64> {
        self.delay_ticks[..self.count].iter().map(|ticks| (POINT_TICKS as f64 + ticks) * TICK_S).collect()
    }

    /// Returns true if every controller rests at the same place.
    pub(crate) fn at_rest(&self) -> bool {
        self.points.iter().all(|point| {
            let moved = point.q.iter().zip(&self.last.q).map(|(q, last)| q - last);
            moved.chain(point.v).all(|x| x.abs() <= driver::REST_TOLERANCE)
        })
    }

    /// Moves the driver on to `to`, while the robot measures `measured`. `each` gets the setpoint of the joints at every
    /// index up to it. If setpoints are missing in between, the points are taken from the cubic through both ends.
    pub(crate) fn advance(&mut self, to: &Setpoint, measured: &[f64; JOINTS_MAX], mut each: impl FnMut(&Setpoint)) {
        let from = self.last;
        let gap = to.k.saturating_sub(from.k);
        for k in to.k - gap.min(GAP_MAX_TICKS)..to.k {
            let (k, share) = (k + 1, (k + 1 - from.k) as f64 / gap as f64);
            if k.is_multiple_of(POINT_TICKS) {
                let point = if k == to.k { Point { q: to.q, v: to.v } } else { between(&from, to, share) };
                self.points = [self.points[1], self.points[2], point];
                let finite = |j: usize, before: f64| if measured[j].is_finite() { measured[j] } else { before };
                self.restarts = self.restarts.map(|before| std::array::from_fn(|j| finite(j, before[j])));
            }
            each(&self.executed(k));
        }
        if gap > 0 {
            self.last = *to;
        }
    }

    /// Returns the setpoint of the joints at index `k`, whose newest point is the last of `points`.
    fn executed(&self, k: u64) -> Setpoint {
        let mut out = Setpoint { k, q: [0.0; JOINTS_MAX], v: [0.0; JOINTS_MAX], a: [0.0; JOINTS_MAX] };
        for j in 0..JOINTS_MAX {
            let delay_ticks = self.delay_ticks[self.controller[j]];
            if let Some(restarted) = &self.restarts {
                let due_ticks = POINT_TICKS as f64 + delay_ticks;
                let (from, to) = ([restarted[j], 0.0], [self.points[2].q[j], self.points[2].v[j]]);
                let share = (k % POINT_TICKS) as f64 / due_ticks;
                [out.q[j], out.v[j], out.a[j]] = cubic(from, to, due_ticks * TICK_S, share);
                continue;
            }
            // Ticks since the oldest point: 0 to 29, so that both ends of the piece are known.
            let since = (k % POINT_TICKS + POINT_TICKS) as f64 - delay_ticks;
            let piece = usize::from(since >= POINT_TICKS as f64);
            let share = since / POINT_TICKS as f64 - piece as f64;
            let end = |point: &Point| [point.q[j], point.v[j]];
            let (from, to) = (end(&self.points[piece]), end(&self.points[piece + 1]));
            [out.q[j], out.v[j], out.a[j]] = cubic(from, to, POINT_S, share);
        }
        out
    }
}

/// Returns the last three points of a motion that came to `held` with its speed.
fn points_before(held: &Setpoint) -> [Point; 3] {
    std::array::from_fn(|n| {
        let before_s = (held.k % POINT_TICKS + (2 - n as u64) * POINT_TICKS) as f64 * TICK_S;
        Point { q: std::array::from_fn(|j| held.q[j] - before_s * held.v[j]), v: held.v }
    })
}

fn between(from: &Setpoint, to: &Setpoint, share: f64) -> Point {
    let duration_s = (to.k - from.k) as f64 * TICK_S;
    let at = |j: usize| cubic([from.q[j], from.v[j]], [to.q[j], to.v[j]], duration_s, share);
    Point { q: std::array::from_fn(|j| at(j)[0]), v: std::array::from_fn(|j| at(j)[1]) }
}
