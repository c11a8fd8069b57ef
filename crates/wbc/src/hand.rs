//! Limits the speed of elbows and hands in the base frame.
//!
//! A point p of an arm moves with p' = sum_k J_k q_k'. For a revolute joint about z_k through o_k, J_k = z_k
//! x (p - o_k). For a prismatic joint, J_k = z_k. A tick with its stop is accepted only if one of two bounds
//! proves that every point is slow enough.
//!
//! *By levers.* The length of J_k is the distance l_k of the point from the joint's axis, and 1 for a
//! prismatic joint. While the joints after k move by L_i, that distance grows by at most the sum of R_i L_i,
//! with the reaches R_i of [`KinematicChain::reach`]. Joints before k carry both the point and the axis, and k itself
//! turns the point about the axis. Let V_k be the largest speed of joint k on the way. Then |p'| <= sum_k
//! (l_k + sum_{i after k} R_i L_i) V_k at every instant. This needs no kinematics. It counts joints that move
//! the point in opposite directions as if they moved it in the same one.
//!
//! *By segments.* On a segment of dt the point's acceleration is at most B (see
//! [`certificate`](crate::certificate)). So |p'| is at most (|p'_0| + |p'_1| + B dt) / 2 with the speeds at
//! its ends. Segments are halved until that is enough, or until they are too short.
//!
//! To make this succeed, joints get only a share of their wanted velocities w. The share keeps |sum_k J_k
//! w_k| below the bound.

use crate::chain::{KinematicChain, Placements, joints};
use crate::interval::Bounds;
use crate::plan::JointState;
use crate::trajectory::{Swing, Trajectory};
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Planning stays below the bound by this, m/s. The wanted velocities are reached some 11 ms later (the velocity gain
/// of `track`). In this time 10 rad/s^2 at 0.9 m add this much. Of a small bound, planning keeps at least the share
/// below. With it one tick in a thousand falls back at 0.25 m/s (one in thirty at 0.9).
const MARGIN_M_PER_S: f64 = 0.1;
const SHARE_MIN: f64 = 0.75;
/// Longest and shortest segment, s, and the largest number of evaluations of the kinematics. The longest stop
/// has 25 of the longest segments.
const SEGMENT_S: f64 = 20e-3;
const SHORTEST_S: f64 = 2e-3;
const EVALUATIONS_MAX: usize = 48;
/// Elbows and hands of both arms.
const POINTS: usize = 4;

/// A point with the joints that move it.
#[derive(Clone, Debug)]
struct Point {
    body: usize,
    at: Vector3<f64>,
    joints: Vec<usize>,
    /// Reach of each of these joints, m (1 for a prismatic joint).
    reach: Vec<f64>,
}

/// The bound, and the points that must keep it.
#[derive(Clone, Debug)]
pub(crate) struct HandSpeed {
    max_m_per_s: f64,
    points: Vec<Point>,
}

impl HandSpeed {
    /// Returns None if joints within `limits` cannot move a point faster than `max_m_per_s`. A point is a
    /// body and a place in its frame, m.
    pub(crate) fn new(
        chain: &KinematicChain,
        limits: &[Bounds; JOINTS_MAX],
        points: impl Iterator<Item = (usize, Vector3<f64>)>,
        max_m_per_s: f64,
    ) -> Option<Self> {
        let points = points.map(|(body, at)| {
            let joints: Vec<usize> = joints(chain.ancestors(body)).collect();
            let reach = joints.iter().map(|&j| chain.reach(j, body, &at)).collect();
            Point { body, at, joints, reach }
        });
        let fastest =
            |point: &Point| point.joints.iter().zip(&point.reach).map(|(&j, r)| r * limits[j].v_max).sum::<f64>();
        let points: Vec<Point> = points.filter(|point| fastest(point) > max_m_per_s).collect();
        (!points.is_empty()).then_some(Self { max_m_per_s, points })
    }

    /// Share of the velocities `wanted` that keeps the bound at `places`, per joint. It is one for joints
    /// that do not move a point which would be too fast.
    pub(crate) fn shares(
        &self,
        chain: &KinematicChain,
        places: &Placements,
        wanted: &[f64; JOINTS_MAX],
    ) -> [f64; JOINTS_MAX] {
        let mut shares = [1.0; JOINTS_MAX];
        let planned = (self.max_m_per_s - MARGIN_M_PER_S).max(SHARE_MIN * self.max_m_per_s);
        for point in &self.points {
            let speed = point.velocity(chain, places, |j| wanted[j]).norm();
            if speed > planned {
                for &j in &point.joints {
                    shares[j] = f64::min(shares[j], planned / speed);
                }
            }
        }
        shares
    }

    /// Returns true if every point keeps the bound at every instant of `motion`, which begins at `places`.
    pub(crate) fn is_kept(&self, chain: &KinematicChain, places: &Placements, motion: &Trajectory) -> bool {
        let paths = paths(motion);
        let fastest: [f64; JOINTS_MAX] = std::array::from_fn(|j| motion.joints[j].fastest());
        // Written so that NaN is refused.
        let by_levers = |point: &Point| point.fastest(chain, places, &paths, |j| fastest[j]) <= self.max_m_per_s;
        let left = [0, 1, 2, 3].map(|i| self.points.get(i).filter(|point| !by_levers(point)));
        left.iter().all(Option::is_none) || self.is_kept_by_segments(chain, places, motion, left)
    }

    /// The proof by segments of the points that are left.
    fn is_kept_by_segments(
        &self,
        chain: &KinematicChain,
        places: &Placements,
        motion: &Trajectory,
        left: [Option<&Point>; POINTS],
    ) -> bool {
        let needed = left.into_iter().flatten().fold(0, |set, point| set | chain.ancestors(point.body));
        let end_s = motion.end_s();
        let state =
            |j: usize, t: f64| if needed & 1 << j != 0 { motion.joints[j].at(t) } else { JointState::default() };
        let at = |t: f64| -> [JointState; JOINTS_MAX] { std::array::from_fn(|j| state(j, t)) };
        let speeds = |places: &Placements, x: &[JointState; JOINTS_MAX]| -> [f64; POINTS] {
            left.map(|point| point.map_or(0.0, |point| point.velocity(chain, places, |j| x[j].v).norm()))
        };
        let mut there = *places;
        let (mut t0, mut x0) = (0.0, at(0.0));
        let mut speed0 = speeds(places, &x0);
        let mut dt = SEGMENT_S;
        for _ in 0..EVALUATIONS_MAX {
            let t1 = (t0 + dt).min(end_s);
            let x1 = at(t1);
            chain.forward(&x1.map(|x| x.q), needed, &mut there);
            let speed1 = speeds(&there, &x1);
            let mut swings = [Swing::default(); JOINTS_MAX];
            joints(needed).for_each(|j| swings[j] = motion.joints[j].swing(t0, t1, x0[j], x1[j]));
            let kept = left.iter().enumerate().filter_map(|(i, point)| Some((i, (*point)?))).all(|(i, point)| {
                let sag = point.acceleration(chain, &swings) * (t1 - t0);
                0.5 * (speed0[i] + speed1[i] + sag) <= self.max_m_per_s
            });
            if !kept {
                dt *= 0.5;
                if dt < SHORTEST_S {
                    return false;
                }
                continue;
            }
            if t1 >= end_s {
                return true;
            }
            (t0, x0, speed0) = (t1, x1, speed1);
            dt = (2.0 * dt).min(SEGMENT_S);
        }
        false
    }
}

fn paths(motion: &Trajectory) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| motion.joints[j].path())
}

impl Point {
    /// The bound by levers, m/s, while joint j is no faster than `speed(j)` and moves by `paths`.
    fn fastest(
        &self,
        chain: &KinematicChain,
        places: &Placements,
        paths: &[f64; JOINTS_MAX],
        speed: impl Fn(usize) -> f64,
    ) -> f64 {
        let at = places[self.body].point(&self.at);
        let (mut sum, mut after) = (0.0, 0.0);
        for (&j, reach) in self.joints.iter().zip(&self.reach).rev() {
            let (link, place) = (&chain.links()[j], &places[j + 1]);
            let lever = if link.prismatic { 1.0 } else { (place.r * link.axis).cross(&(at - place.t)).norm() + after };
            sum += lever.min(*reach) * speed(j);
            after += reach * paths[j];
        }
        sum
    }

    /// The velocity p', m/s.
    fn velocity(&self, chain: &KinematicChain, places: &Placements, speed: impl Fn(usize) -> f64) -> Vector3<f64> {
        let at = places[self.body].point(&self.at);
        self.joints.iter().fold(Vector3::zeros(), |sum, &j| {
            let (link, place) = (&chain.links()[j], &places[j + 1]);
            let axis = place.r * link.axis;
            sum + if link.prismatic { axis } else { axis.cross(&(at - place.t)) } * speed(j)
        })
    }

    /// The bound B on |p''|, m/s^2, while speeds and accelerations of the joints stay within `swings`.
    fn acceleration(&self, chain: &KinematicChain, swings: &[Swing; JOINTS_MAX]) -> f64 {
        let (mut bound, mut turning) = (0.0, 0.0);
        // Goes from the base to the tip. `turning` is the sum of the speeds of the joints before.
        for (&j, reach) in self.joints.iter().zip(&self.reach) {
            let Swing { v, a, .. } = swings[j];
            let own = if chain.links()[j].prismatic { 0.0 } else { v };
            bound += reach * a + reach * v * (own + 2.0 * turning);
            turning += own;
        }
        bound
    }
}
