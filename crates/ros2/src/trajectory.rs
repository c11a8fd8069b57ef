//! The message of one trajectory controller. For the command of index k its points are
//!
//! ```text
//! (q, v) at k - 8 n,  n = 10 ... 1    executed before, 5.3 ms apart (HISTORY_POINTS)
//! (q, v) at k                         the command
//! (q, v) at each change of a joint's jerk in the certified stop
//! (q, 0) at the stop's end + 0.2 s    at rest
//! ```
//!
//! A controller interpolates neighbouring points by the cubic through q and v. Where the jerk is constant the motion is that
//! cubic, so the stop is exact. Between two executed points a joint is off by at most J h^3 / 96 with h = 5.3 ms. The
//! certificate covers h = 10 ms. If no message follows, the robot plays the certified stop by itself.
//!
//! The executed points make the controller continue: it reads a stamped curve that begins in its past at its own time. With
//! one point per message it starts again from the measured position each time, and the robot creeps.

use driver::PlanPlayback;
use messages::{JOINTS_MAX, JointMotion, Stamp, StopPlan, deadline, tick_at};
use std::collections::VecDeque;

/// Number of executed points: 53 ms.
pub const HISTORY_POINTS: usize = 10;
/// Ticks between two messages: 5.3 ms. A robot with a delay of 25 ms misses no motion if four messages in a row are lost.
/// After six it is 2e-5 rad off, because the stop begins gently. No servo shows that.
pub const PERIOD_TICKS: u64 = 8;
/// Time from the end of the stop to the last point, s. A controller rejects a message whose last point lies in its past.
const REST_S: f64 = 0.2;
/// Changes of the jerk closer than this are merged, s. A joint is then off by less than 1e-12 rad.
const ALIKE_S: f64 = 1e-5;
/// Largest number of points: executed, present, three changes of jerk for each joint, and rest.
pub const POINTS_MAX: usize = HISTORY_POINTS + 1 + 3 * JOINTS_MAX + 1;

/// The state of all joints at an index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Executed {
    pub k: u64,
    /// Positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
}

#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Time since the first point, ns.
    pub since_first_ns: u64,
    /// Positions of the controller's joints, rad or m.
    pub positions: Vec<f64>,
    /// Velocities of the controller's joints, rad/s or m/s.
    pub velocities: Vec<f64>,
}

/// A setpoint for the robot, with its certified stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    pub k: u64,
    pub motion: JointMotion,
}

/// The executed curve: the points of earlier messages, and the stop of the last message where none followed in time.
#[derive(Clone, Debug, Default)]
pub struct History {
    points: VecDeque<Executed>,
    last: Option<Command>,
}

impl History {
    /// The points before the next message, the oldest first.
    pub fn points(&self) -> impl DoubleEndedIterator<Item = &Executed> {
        self.points.iter()
    }

    /// Prepares the message of the last command. The other commands were not sent. `executing_k` is the index that the robot
    /// executes when the message arrives.
    ///
    /// A robot that has executed the last message plays its stop. The history then has that stop, and not the commands that were
    /// not sent. Returns the state that the new message must continue. None if nothing was sent before.
    pub fn prepare(&mut self, commands: &[Command], executing_k: u64) -> Option<Command> {
        let (next, last) = (commands.last()?, self.last?);
        if next.k <= last.k {
            self.points.clear();
            return None;
        }
        let stops = executing_k + PERIOD_TICKS > last.k;
        if !stops {
            let unsent = &commands[..commands.len() - 1];
            unsent.iter().for_each(|command| self.push(Executed::new(command.k, &command.motion)));
            return Some(*unsent.last().unwrap_or(&last));
        }
        let until = (executing_k + PERIOD_TICKS).min(next.k - 1);
        let points = until.saturating_sub(last.k) / PERIOD_TICKS;
        let mut from = last;
        for _ in 0..points {
            from.k += PERIOD_TICKS;
            from.motion.play(PERIOD_TICKS);
            self.push(Executed::new(from.k, &from.motion));
        }
        Some(from)
    }

    /// Returns the state that a robot executes at `at` if it received every message. None before the first point.
    pub fn expected(&self, at: Stamp) -> Option<Executed> {
        let last = self.last?;
        let k = tick_at(at);
        if k >= last.k {
            let mut motion = last.motion;
            motion.play(k - last.k);
            return Some(Executed::new(k, &motion));
        }
        let next = self.points.iter().position(|point| point.k > k).filter(|next| *next > 0)?;
        let (from, to) = (&self.points[next - 1], &self.points[next]);
        let share = (at.since(deadline(from.k)) as f64 / deadline(to.k).since(deadline(from.k)) as f64).clamp(0.0, 1.0);
        let between = |from: f64, to: f64| from + share * (to - from);
        Some(Executed {
            k,
            q: std::array::from_fn(|j| between(from.q[j], to.q[j])),
            v: std::array::from_fn(|j| between(from.v[j], to.v[j])),
        })
    }

    /// Restarts the history with `command`, which is at rest, as if the robot had rested there for `ticks`.
    pub fn begin(&mut self, command: &Command, ticks: u64) {
        self.clear();
        self.push(Executed::new(command.k.saturating_sub(ticks), &command.motion));
    }

    /// Removes all points. The next message has no executed points.
    pub fn clear(&mut self) {
        (self.points, self.last) = (VecDeque::new(), None);
    }

    pub fn sent(&mut self, command: &Command) {
        self.push(Executed::new(command.k, &command.motion));
        self.last = Some(*command);
    }

    fn push(&mut self, point: Executed) {
        self.points.push_back(point);
        while self.points.len() > HISTORY_POINTS {
            self.points.pop_front();
        }
    }
}

impl Executed {
    pub fn new(k: u64, motion: &JointMotion) -> Self {
        Self { k, q: motion.q, v: motion.v }
    }
}

/// Returns the time of the first point, and the points of the joints in the mask `joints`. `past` begins with the oldest.
pub fn points<'a>(
    past: impl DoubleEndedIterator<Item = &'a Executed>,
    Command { k, motion: now }: &Command,
    joints: u32,
) -> (Stamp, Vec<Point>) {
    let k = *k;
    let chosen = |all: &[f64; JOINTS_MAX]| (0..JOINTS_MAX).filter(|j| joints & 1 << j != 0).map(|j| all[j]).collect();
    let past = past.filter(|executed| executed.k < k);
    let past: Vec<&Executed> = past.rev().take(HISTORY_POINTS).collect::<Vec<_>>().into_iter().rev().collect();
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
    // The stop ends at rest. Any remaining velocity is a rounding error.
    for point in points.iter_mut().rev().take(2) {
        if now.is_at_rest() || point.since_first_ns > present_ns {
            point.velocities.fill(0.0);
        }
    }
    (first, points)
}

/// Returns the times of the points in the stop, s: now, each change of a joint's jerk, and rest after the end.
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
pub(crate) mod tests {
    use super::*;
    use crate::reference::continues;
    use messages::{Layout, TICK_S};
    use rand::{RngExt, SeedableRng};
    use wbc::JointStop;

    const J: f64 = 320.0;
    const A: f64 = 8.0;
    const LEFT: u32 = 0b111_1111 << 3;

    /// A motion with any velocities and accelerations, and its stop.
    fn motion(rng: &mut rand_pcg::Pcg64) -> JointMotion {
        let mut motion = JointMotion::rest(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
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
        cubic(&points[next - 1], &points[next], t_ns, i)
    }

    /// The cubic from one point to the next.
    pub(crate) fn cubic(from: &Point, to: &Point, t_ns: u64, i: usize) -> f64 {
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
            let (first, points) = points([].iter(), &Command { k: 1_500, motion: now }, LEFT);
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
        let count = HISTORY_POINTS as u64 + 4;
        let at = |i: u64| 1_500 + PERIOD_TICKS * i;
        let executed = |i: u64| Executed { k: at(i), q: [i as f64; JOINTS_MAX], v: [0.5; JOINTS_MAX] };
        let past: Vec<Executed> = (0..count).map(executed).collect();
        // The newest of them is the present index, which is not its own past.
        let (first, points) =
            points(past.iter(), &Command { k: at(count - 1), motion: motion(&mut rng) }, 1 << 4 | 1 << 2);
        assert_eq!(first, deadline(at(3)));
        for (i, point) in points[..HISTORY_POINTS].iter().enumerate() {
            assert_eq!(point.since_first_ns, deadline(at(3 + i as u64)).since(first));
            assert_eq!((point.positions.clone(), point.velocities.clone()), (vec![(3 + i) as f64; 2], vec![0.5; 2]));
        }
        assert_eq!(points[HISTORY_POINTS].since_first_ns, deadline(at(count - 1)).since(first));
    }

    /// A robot that executes messages `delay` ticks behind, and takes each `late(k)` ticks after its command. Returns the
    /// largest change of its velocity from one update of 10 ms to the next, by the acceleration limit.
    fn jolt(delay: u64, late: impl Fn(u64) -> u64) -> f64 {
        let wanted = |k: u64| {
            let t = k as f64 * TICK_S;
            let mut motion = JointMotion::rest([0.4 * (3.0 * t).sin(); JOINTS_MAX]);
            (motion.v, motion.a) = ([1.2 * (3.0 * t).cos(); JOINTS_MAX], [-3.6 * (3.0 * t).sin(); JOINTS_MAX]);
            for j in 0..JOINTS_MAX {
                JointStop::new(motion.v[j], motion.a[j], A, J).store(&mut motion.plan, j);
            }
            motion
        };
        let (mut past, mut waiting, mut curve) = (History::default(), Vec::new(), None);
        let (mut positions, mut ready) = (Vec::new(), 0);
        for k in 1_500..6_000_u64 {
            if k % PERIOD_TICKS == 0 {
                waiting.push(Command { k, motion: wanted(k) });
                ready = ready.max(k.saturating_add(late(k)));
            }
            if !waiting.is_empty() && k >= ready {
                let from = past.prepare(&waiting, k - delay);
                let command = *waiting.last().expect("not empty");
                if from.is_some_and(|from| !continues(&[A; JOINTS_MAX], &from, &command)) {
                    // The robot plays its stop, and gets nothing more.
                    ready = u64::MAX;
                    continue;
                }
                curve = Some(points(past.points(), &command, 1));
                past.sent(&command);
                waiting.clear();
            }
            if let (0, Some((first, points))) = (k % 15, &curve) {
                // After its last point the robot holds it.
                let end_ns = points.last().expect("a point").since_first_ns;
                positions.push(hermite(points, deadline(k - delay).since(*first).min(end_ns), 0));
            }
        }
        let speeds: Vec<f64> = positions.windows(2).map(|pair| (pair[1] - pair[0]) / 0.01).collect();
        speeds[5..].windows(2).map(|pair| (pair[1] - pair[0]).abs() / 0.01).fold(0.0, f64::max) / A
    }

    #[test]
    fn robot_that_messages_reach_late_is_taken_back_without_a_step() {
        // 1.2 rad/s and 3.6 rad/s^2 are less than half of the limit.
        let in_time = jolt(38, |_| 1);
        assert!(in_time < 0.46, "{in_time}");
        let pause = |length: u64| jolt(38, move |k| if k % 500 < PERIOD_TICKS { length } else { 1 });
        for (length, most) in [(20, 0.46), (35, 0.5), (45, 1.0), (60, 1.5), (300, 3.0)] {
            let jolt = pause(length);
            println!("a pause of {length} ticks: {jolt:.2} of the limit");
            assert!(jolt < most, "a pause of {length} ticks: {jolt} of the limit");
        }
    }

    #[test]
    fn resting_robot_gets_two_points_and_a_last_one_in_the_future() {
        let (_, points) = points([].iter(), &Command { k: 3_000, motion: JointMotion::rest([0.3; JOINTS_MAX]) }, LEFT);
        let times: Vec<u64> = points.iter().map(|point| point.since_first_ns).collect();
        assert_eq!(times, [0, (REST_S * 1e9) as u64]);
        assert!(points.iter().all(|point| point.positions == [0.3; 7] && point.velocities == [0.0; 7]));
    }
}
