//! The trajectory of one controller: what was executed, the present point, and the certified stop.
//!
//! A trajectory controller that gets one point for each message starts again from the measured position, and creeps.
//! One that gets a stamped curve whose beginning lies in the past reads the curve at its own time. So each message
//! holds
//!
//! - the last [`HISTORY`] points of earlier messages, 5.3 ms apart,
//! - the point of the present index,
//! - the certified stop from there, with a point wherever a joint's jerk changes, and a last point at rest.
//!
//! Controllers put a cubic through positions and velocities of neighbouring points. Where the jerk is constant the
//! motion is that cubic, so the stop is exact. Between two points of the history a joint is off by at most J h^3 / 96
//! with h = 5.3 ms. The certificate covers 10 ms. If no message follows, the robot plays the certified stop by itself.

use driver::Motion;
use messages::{JOINTS_MAX, Stamp, StopPlan, deadline};

/// Number of points of the past: 53 ms.
pub const HISTORY: usize = 10;
/// Ticks between two messages: 5.3 ms. A robot that runs 25 ms behind misses nothing if four in a row are lost. The
/// stop begins gently: after six it is 2e-5 rad off, which no servo shows.
pub const PERIOD_TICKS: u64 = 8;
/// The last point rests for this long, s. It is never in the past when a message arrives: a controller would reject
/// the message.
const REST_S: f64 = 0.2;
/// Switches of the jerk nearer than this are one, s. A joint is then off by less than 1e-12 rad.
const ALIKE_S: f64 = 1e-5;
/// Largest number of points: past, present, three switches for each of seven joints, and the rest.
pub const POINTS_MAX: usize = HISTORY + 1 + 3 * JOINTS_MAX + 1;

/// The state of all joints at an index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Executed {
    /// Index.
    pub k: u64,
    /// Positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
}

/// A point of a trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Time since the first point, ns.
    pub since_first_ns: u64,
    /// Positions of the controller's joints, rad or m.
    pub positions: Vec<f64>,
    /// Velocities of the controller's joints, rad/s or m/s.
    pub velocities: Vec<f64>,
}

/// The points of the joints in `joints`, and the time of the first one. `past` has the oldest first. `now` is the
/// present state with its stop.
pub fn points(past: &[Executed], k: u64, now: &Motion, joints: u32) -> (Stamp, Vec<Point>) {
    let chosen = |all: &[f64; JOINTS_MAX]| (0..JOINTS_MAX).filter(|j| joints & 1 << j != 0).map(|j| all[j]).collect();
    let past = past.iter().filter(|executed| executed.k < k);
    let past: Vec<&Executed> = past.rev().take(HISTORY).collect::<Vec<_>>().into_iter().rev().collect();
    let first = deadline(past.first().map_or(k, |executed| executed.k));
    let mut points: Vec<Point> = past
        .iter()
        .map(|executed| Point {
            since_first_ns: deadline(executed.k).since(first),
            positions: chosen(&executed.q),
            velocities: chosen(&executed.v),
        })
        .collect();
    let present_ns = deadline(k).since(first);
    for time_s in times_s(&now.plan, joints) {
        let state: [[f64; 3]; JOINTS_MAX] = std::array::from_fn(|j| now.ahead(j, time_s));
        points.push(Point {
            since_first_ns: present_ns + (time_s * 1e9).round() as u64,
            positions: chosen(&state.map(|[q, ..]| q)),
            velocities: chosen(&state.map(|[_, v, _]| v)),
        });
    }
    // The stop ends at rest. What is left of the velocity is rounding.
    for point in points.iter_mut().rev().take(2) {
        if now.at_rest() || point.since_first_ns > present_ns {
            point.velocities.fill(0.0);
        }
    }
    (first, points)
}

/// Times of the stop at which points are needed, s: now, each switch of a joint's jerk, and a rest after the end.
fn times_s(plan: &StopPlan, joints: u32) -> Vec<f64> {
    let mut times = vec![0.0];
    for j in (0..JOINTS_MAX).filter(|j| joints & 1 << j != 0) {
        let mut end = 0.0;
        for duration_s in plan.duration_s[j] {
            end += duration_s;
            times.push(end);
        }
    }
    times.sort_by(f64::total_cmp);
    let mut kept: Vec<f64> = Vec::with_capacity(POINTS_MAX);
    for time_s in times {
        if kept.last().is_none_or(|last| time_s - last > ALIKE_S) {
            kept.push(time_s);
        }
    }
    let end = kept.last().copied().unwrap_or(0.0);
    kept.push(end + REST_S);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;
    use rand::{RngExt, SeedableRng};
    use wbc::JointStop;

    const J: f64 = 320.0;
    const A: f64 = 8.0;
    const LEFT: u32 = 0b111_1111 << 3;

    /// A motion with any velocities and accelerations, and its stop.
    fn motion(rng: &mut rand_pcg::Pcg64) -> Motion {
        let mut motion = Motion::rest(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        let mut plan = StopPlan::ZERO;
        for j in 0..JOINTS_MAX {
            (motion.v[j], motion.a[j]) = (rng.random_range(-2.0..2.0), rng.random_range(-A..A));
            JointStop::new(motion.v[j], motion.a[j], A, J).store(&mut plan, j);
        }
        motion.plan = plan;
        motion
    }

    /// The cubic through two points, as a controller computes it.
    fn hermite(points: &[Point], t_ns: u64, i: usize) -> f64 {
        let next = points.iter().position(|point| point.since_first_ns >= t_ns).expect("within the trajectory").max(1);
        let (from, to) = (&points[next - 1], &points[next]);
        let h = (to.since_first_ns - from.since_first_ns) as f64 * 1e-9;
        let s = (t_ns - from.since_first_ns) as f64 * 1e-9 / h;
        let (q0, q1, v0, v1) = (from.positions[i], to.positions[i], from.velocities[i] * h, to.velocities[i] * h);
        let (a, b) = (q1 - q0 - v0, v1 - v0 - 2.0 * (q1 - q0 - v0));
        q0 + s * (v0 + s * (a + (s - 1.0) * b))
    }

    #[test]
    fn controllers_play_the_certified_stop_exactly_and_end_at_rest() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        for _ in 0..200 {
            let now = motion(&mut rng);
            let (first, points) = points(&[], 1_500, &now, LEFT);
            assert_eq!(first, deadline(1_500));
            assert!(points.len() <= POINTS_MAX && points[0].since_first_ns == 0);
            assert!(points.windows(2).all(|pair| pair[0].since_first_ns < pair[1].since_first_ns));
            let end_ns = points.last().expect("a point").since_first_ns;
            for _ in 0..50 {
                let t_ns = rng.random_range(0..end_ns);
                for i in 0..7 {
                    let exact = now.ahead(3 + i, t_ns as f64 * 1e-9)[0];
                    let played = hermite(&points, t_ns, i);
                    assert!((played - exact).abs() < 1e-7, "{t_ns} ns, joint {i}: {played} is not {exact}");
                }
            }
            assert!(points.iter().rev().take(2).all(|point| point.velocities.iter().all(|v| *v == 0.0)));
        }
    }

    #[test]
    fn past_comes_first_at_its_own_times_and_only_the_newest_points() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
        let count = HISTORY as u64 + 4;
        let at = |i: u64| 1_500 + PERIOD_TICKS * i;
        let executed = |i: u64| Executed { k: at(i), q: [i as f64; JOINTS_MAX], v: [0.5; JOINTS_MAX] };
        let past: Vec<Executed> = (0..count).map(executed).collect();
        // The newest of them is the present index, which is not its own past.
        let (first, points) = points(&past, at(count - 1), &motion(&mut rng), 1 << 4 | 1 << 2);
        assert_eq!(first, deadline(at(3)));
        for (i, point) in points[..HISTORY].iter().enumerate() {
            assert_eq!(point.since_first_ns, deadline(at(3 + i as u64)).since(first));
            assert_eq!((point.positions.clone(), point.velocities.clone()), (vec![(3 + i) as f64; 2], vec![0.5; 2]));
        }
        assert_eq!(points[HISTORY].since_first_ns, deadline(at(count - 1)).since(first));
    }

    #[test]
    fn resting_robot_gets_two_points_and_a_last_one_in_the_future() {
        let (_, points) = points(&[], 3_000, &Motion::rest([0.3; JOINTS_MAX]), LEFT);
        let times: Vec<u64> = points.iter().map(|point| point.since_first_ns).collect();
        assert_eq!(times, [0, (REST_S * 1e9) as u64]);
        assert!(points.iter().all(|point| point.positions == [0.3; 7] && point.velocities == [0.0; 7]));
    }
}
