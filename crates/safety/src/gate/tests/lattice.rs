//! Tests the checks of one joint against exact physics, for every state of a small lattice.
//!
//! The unit of time is a tick. Positions of the lattice are multiples of `STEP` units, velocities of `STEP` units a
//! tick, and accelerations of `STEP` units a tick^2. So the polynomials of constant jerk are exact in integers.
//!
//! The judge below decides each limit over the whole phase. It takes the roots of those polynomials and
//! compares squares in `i128`. It has no rounding, no bisection, and no code of the gate. Limits lie on the
//! lattice. So a value exceeds a limit by far more than the allowed rounding, or only at a turning point. A
//! value within 8 units of the slack counts as undecided, and there must be almost none.

use crate::gate::check::{Check, Limits};
use crate::gate::fixed::{Phase, Point, TICK};

/// Units of one lattice step. Halves and sixths of it are whole, and half a step of velocity is not rest.
const STEP: i128 = 6144;
/// Ticks per second.
const HZ: i128 = 1500;
/// The gate's slack, units: `check::SLACK`, and the jerk that it makes over a tick. Both are written out a second time.
const SLACK: i64 = 64;
const JERK_SLACK: i128 = 96_000;
/// Largest error of the gate's arithmetic, units.
const ROUNDING: i128 = 8;

/// Limits in lattice steps. They are so few that every limit binds within a tick or two.
struct Bounds {
    q: i128,
    v: i128,
    a: i128,
    j: i128,
    /// Longest stop, ticks.
    stop: i128,
}

/// In these bounds jerk and velocity bind before acceleration does.
const STRONG: Bounds = Bounds { q: 4, v: 3, a: 3, j: 2, stop: 5 };
/// In these bounds acceleration binds.
const WEAK: Bounds = Bounds { q: 4, v: 3, a: 1, j: 2, stop: 5 };

impl Bounds {
    fn limits(&self) -> Limits {
        Limits {
            q: [gate(-self.q * STEP), gate(self.q * STEP)],
            v: gate(self.v * STEP * HZ),
            a: gate(self.a * STEP * HZ * HZ),
            jerk: gate(self.j * STEP * HZ * HZ * HZ),
            stop: TICK * gate(self.stop),
        }
    }

    /// Returns for position, velocity and acceleration whether a phase breaks the limit, if `grant` units of
    /// slack are added to each.
    fn broken(&self, x: State, j: i128, end: i128, grant: i128) -> [bool; 3] {
        let both = |holds: fn(State, i128, i128, i128) -> bool, most: i128| {
            holds(x, j, end, most + grant) && holds(x.mirrored(), -j, end, most + grant)
        };
        let a_most = self.a * STEP * HZ * HZ + grant;
        let a_holds = [x.a, x.a + j * end].iter().all(|a| (a * HZ * HZ).abs() <= a_most);
        [!both(position_stays_below, self.q * STEP), !both(velocity_stays_below, self.v * STEP * HZ), !a_holds]
    }

    /// Returns the checks that the step from `last` to `next` fails with `grant` units of slack. `next` is
    /// not the plan's point.
    fn step_fails(&self, last: State, next: Point, grant: i128) -> [(Check, bool); 5] {
        let (q, v, a) = (i128::from(next.q), i128::from(next.v), i128::from(next.a));
        let change = (a - last.a * HZ * HZ) * HZ;
        // The acceleration of `next` may be off the lattice by less than a hundred units. This is 0.03 units
        // of velocity.
        let j = (change as f64 / (STEP * HZ * HZ * HZ) as f64).round() as i128 * STEP;
        let exact = last.after(j, 1);
        let slack = i128::from(SLACK);
        let is_step = (q - exact.q).abs() <= slack && (v - exact.v * HZ).abs() <= slack;
        let [q_on_the_way, v_on_the_way, _] = self.broken(last, j, 1, grant);
        [
            (Check::Position, q.abs() > self.q * STEP + slack || is_step && q_on_the_way),
            (Check::Velocity, v.abs() > self.v * STEP * HZ + slack || is_step && v_on_the_way),
            (Check::Acceleration, a.abs() > self.a * STEP * HZ * HZ + slack),
            (Check::Jerk, change.abs() > self.j * STEP * HZ * HZ * HZ + JERK_SLACK),
            (Check::Step, !is_step),
        ]
    }

    /// Returns the checks that a stop fails with `grant` units of slack, and the state at its end.
    fn stop_fails(&self, start: State, phases: &[(i128, i128); 3], grant: i128) -> ([(Check, bool); 2], State) {
        let mut x = start;
        let mut leaves = false;
        for (j, ticks) in phases.iter().filter(|(_, ticks)| *ticks > 0) {
            let [q, v, _] = self.broken(x, j * STEP, *ticks, grant);
            // The acceleration at the beginning of the stop is the command's, and is judged there.
            x = x.after(j * STEP, *ticks);
            leaves |= j.abs() > self.j || q || v || x.a.abs() > self.a * STEP;
        }
        let late = phases.iter().map(|(_, ticks)| ticks).sum::<i128>() > self.stop;
        let rests = x.v == 0 && x.a == 0;
        ([(Check::PlanLimits, leaves), (Check::Braking, late || !rests)], x)
    }
}

fn gate(value: i128) -> i64 {
    i64::try_from(value).expect("the lattice is small")
}

/// Position, velocity and acceleration in units, units a tick and units a tick^2.
#[derive(Clone, Copy, Debug, PartialEq)]
struct State {
    q: i128,
    v: i128,
    a: i128,
}

impl State {
    fn steps(q: i128, v: i128, a: i128) -> Self {
        Self { q: q * STEP, v: v * STEP, a: a * STEP }
    }

    fn point(self) -> Point {
        Point { q: gate(self.q), v: gate(self.v * HZ), a: gate(self.a * HZ * HZ) }
    }

    /// State after `t` ticks of jerk `j`. It is exact, since both are whole and STEP is a multiple of 6.
    fn after(self, j: i128, t: i128) -> Self {
        Self {
            q: self.q + self.v * t + self.a * t * t / 2 + j * t * t * t / 6,
            v: self.v + self.a * t + j * t * t / 2,
            a: self.a + j * t,
        }
    }

    fn mirrored(self) -> Self {
        Self { q: -self.q, v: -self.v, a: -self.a }
    }
}

/// Returns true if q(t) = q + v t + a t^2 / 2 + j t^3 / 6 is at most `most` for all t in [0, end].
///
/// Its maximum inside lies where q' = 0 and q'' < 0. With D = a^2 - 2 j v this is at a + j t = -sqrt(D),
/// where q = q_0 + (2 D sqrt(D) + 3 D a - a^3) / (6 j^2).
fn position_stays_below(x: State, j: i128, end: i128, most: i128) -> bool {
    if x.q > most || x.after(j, end).q > most {
        return false;
    }
    let State { q, v, a } = x;
    if j == 0 {
        // The maximum is q - v^2 / 2a, at t = -v / a.
        let turns = a < 0 && v > 0 && v < -a * end;
        return !turns || 2 * -a * q + v * v <= 2 * -a * most;
    }
    let d = a * a - 2 * j * v;
    if d <= 0 {
        return true;
    }
    let last = a + j * end;
    let after_start = if j > 0 { a < 0 && d < a * a } else { a > 0 || d > a * a };
    let before_end = if j > 0 { last >= 0 || d > last * last } else { last < 0 && d < last * last };
    if !(after_start && before_end) {
        return true;
    }
    let room = 6 * j * j * (most - q) - 3 * d * a + a * a * a;
    room >= 0 && 4 * d * d * d <= room * room
}

/// Returns true if v(t) = v + a t + j t^2 / 2, in units a second, is at most `most` for all t in [0, end].
fn velocity_stays_below(x: State, j: i128, end: i128, most: i128) -> bool {
    // The maximum is v - a^2 / 2j, at t = -a / j.
    let peaks = j < 0 && x.a > 0 && x.a < -j * end;
    let ends_hold = x.v * HZ <= most && x.after(j, end).v * HZ <= most;
    ends_hold && (!peaks || HZ * (2 * -j * x.v + x.a * x.a) <= 2 * -j * most)
}

/// Compares verdicts with the limits that are surely broken and those that may be. Counts the undecided cases.
#[derive(Debug, Default)]
struct Tally {
    admitted: u64,
    denied: std::collections::BTreeMap<String, u64>,
    undecided: u64,
}

impl Tally {
    fn record(&mut self, got: Result<(), Check>, surely: &[(Check, bool)], maybe: &[(Check, bool)], what: &str) {
        let (sure, possible) = (surely.iter().any(|(_, bad)| *bad), maybe.iter().any(|(_, bad)| *bad));
        match got {
            Ok(()) => {
                assert!(!sure, "admitted {what}, which fails {surely:?}");
                self.admitted += 1;
            }
            Err(check) => {
                assert!(possible, "denied {what} for {check:?}, which fails nothing");
                assert!(maybe.contains(&(check, true)), "denied {what} for {check:?}, which fails {maybe:?}");
                *self.denied.entry(format!("{check:?}")).or_default() += 1;
            }
        }
        self.undecided += u64::from(sure != possible);
    }
}

/// Tests every state, with every state that a tick could lead to. Halves of velocity and sixths of position
/// are included.
#[test]
fn every_lattice_step_is_judged_by_exact_physics() {
    let limits = STRONG.limits();
    // This plan leads elsewhere, so that no command passes because it is on the plan.
    let elsewhere = State::steps(50, 0, 0).point();
    let mut tally = Tally::default();
    for (q, v, a, a_next) in states().flat_map(|(q, v, a)| (-5..=5).map(move |a_next| (q, v, a, a_next))) {
        let last = State::steps(q, v, a);
        for (halves, sixths) in (-7..=7).flat_map(|h| (-12..=12).map(move |s| (h, s))) {
            // Positions around the one that the last velocity alone leads to. They range from all within the
            // limits to all beyond.
            let next = State { q: (6 * (q + v) + sixths) * STEP / 6, v: halves * STEP / 2, a: a_next * STEP }.point();
            let got = limits.step(last.point(), next, elsewhere);
            let surely = STRONG.step_fails(last, next, i128::from(SLACK) + ROUNDING);
            let maybe = STRONG.step_fails(last, next, i128::from(SLACK) - ROUNDING);
            tally.record(got, &surely, &maybe, "a step");
        }
    }
    assert!(tally.admitted > 1000 && tally.denied.len() == 5 && tally.undecided == 0, "{tally:?}");
}

/// All positions, velocities and accelerations of the lattice. Some of them are beyond the limits.
fn states() -> impl Iterator<Item = (i128, i128, i128)> {
    (-5..=5).flat_map(|q| (-4..=4).flat_map(move |v| (-4..=4).map(move |a| (q, v, a))))
}

/// Tests the slack of every comparison, to the unit. The lattice steps are moved by up to 65 units.
#[test]
fn step_checks_allow_exactly_the_slack() {
    let limits = STRONG.limits();
    let elsewhere = State::steps(50, 0, 0).point();
    let mut tally = Tally::default();
    let moves = [-SLACK - 1, -SLACK, 0, SLACK, SLACK + 1];
    for (q, v, a, j) in states().flat_map(|(q, v, a)| (-2..=2).map(move |j| (q, v, a, j))) {
        let last = State::steps(q, v, a);
        let exact = last.after(j * STEP, 1).point();
        for n in 0..125 {
            let [dq, dv, da] = [n % 5, n / 5 % 5, n / 25].map(|n| moves[n]);
            let next = Point { q: exact.q + dq, v: exact.v + dv, a: exact.a + da };
            let got = limits.step(last.point(), next, elsewhere);
            let surely = STRONG.step_fails(last, next, i128::from(SLACK) + ROUNDING);
            let maybe = STRONG.step_fails(last, next, i128::from(SLACK) - ROUNDING);
            tally.record(got, &surely, &maybe, "a moved step");
        }
    }
    assert!(tally.admitted > 1000 && tally.denied.len() == 5 && tally.undecided == 0, "{tally:?}");
}

/// A point of the plan needs no admissible jerk, but it must be within the limits and near the plan.
#[test]
fn plan_point_passes_only_near_plan_and_within_limits() {
    let limits = STRONG.limits();
    let last = State::steps(0, 0, 0).point();
    let moves = [-SLACK - 1, -SLACK, 0, SLACK, SLACK + 1];
    for (q, v, a) in states() {
        let on_plan = State::steps(q, v, a).point();
        for n in 0..125 {
            let [dq, dv, da] = [n % 5, n / 5 % 5, n / 25].map(|n| moves[n]);
            let next = Point { q: on_plan.q + dq, v: on_plan.v + dv, a: on_plan.a + da };
            let near = [dq, dv, da].iter().all(|d| d.abs() <= SLACK);
            let within = next.q.abs() <= limits.q[1] + SLACK
                && next.v.abs() <= limits.v + SLACK
                && next.a.abs() <= limits.a + SLACK;
            let rest_of_the_lattice_is_a_step =
                STRONG.step_fails(State::steps(0, 0, 0), next, 0).iter().all(|(_, bad)| !bad);
            let got = limits.step(last, next, on_plan);
            assert_eq!(got.is_ok(), within && (near || rest_of_the_lattice_is_a_step), "{next:?} {on_plan:?} {got:?}");
        }
    }
}

/// Tests every stop of three phases from every state.
#[test]
fn every_lattice_stop_is_judged_by_exact_physics() {
    for (bounds, longest) in [(STRONG, 2), (WEAK, 1)] {
        let limits = bounds.limits();
        let mut tally = Tally::default();
        // Phases have up to the highest jerk for one or two ticks, more than that for one tick, and far more
        // for no time.
        let phases: Vec<(i128, i128)> = (-bounds.j..=bounds.j)
            .flat_map(|j| (1..=longest).map(move |ticks| (j, ticks)))
            .chain([(bounds.j + 1, 1), (-bounds.j - 1, 1), (9, 0)])
            .collect();
        let count = phases.len();
        for (q, v, a) in states() {
            let start = State::steps(q, v, a);
            let point = start.point();
            for n in 0..count.pow(3) {
                let stop = [n % count, n / count % count, n / count.pow(2)].map(|n| phases[n]);
                let quantised =
                    stop.map(|(j, ticks)| Phase { jerk: gate(j * STEP * HZ * HZ * HZ), duration: TICK * gate(ticks) });
                let got = limits.stop(point, &quantised).map(|stop| stop.end().q);
                let (surely, rest) = bounds.stop_fails(start, &stop, i128::from(SLACK) + ROUNDING);
                let (maybe, _) = bounds.stop_fails(start, &stop, i128::from(SLACK) - ROUNDING);
                tally.record(got.map(|_| ()), &surely, &maybe, "a stop");
                let got = got.ok();
                assert!(got.is_none_or(|got| (i128::from(got) - rest.q).abs() <= ROUNDING), "{got:?} {rest:?}");
            }
        }
        assert!(tally.admitted > 100 && tally.denied.len() == 2 && tally.undecided == 0, "{tally:?}");
    }
}

/// Tests the judge itself against a dense walk.
#[test]
fn lattice_judge_matches_dense_samples() {
    for (q, v, a) in states().filter(|(q, _, _)| q % 2 == 0) {
        for (j, end) in (-3..=3).flat_map(|j| [(j, 1), (j, 2)]) {
            let x = State::steps(q, v, a);
            let (mut most_q, mut most_v) = (f64::MIN, f64::MIN);
            for n in 0..=1000 {
                let t = f64::from(n) / 1000.0 * end as f64;
                let (v, a, j) = (v as f64, a as f64, f64::from(j));
                most_q = most_q.max(q as f64 + v * t + a * t * t / 2.0 + j * t * t * t / 6.0);
                most_v = most_v.max(v + a * t + j * t * t / 2.0);
            }
            // The walk misses at most |a| t^2 / 8 and |j| t^2 / 8 of a turning point, which is 5e-6 of a step.
            let unit = STEP as f64;
            let [above, below] =
                [1.0, -1.0].map(|side| (most_q * unit + side - if side < 0.0 { 0.0 } else { -1.0 }) as i128);
            assert!(position_stays_below(x, i128::from(j) * STEP, end, above + 1), "{x:?} {j} {end}");
            assert!(!position_stays_below(x, i128::from(j) * STEP, end, below - 1), "{x:?} {j} {end}");
            let fastest = (most_v * unit * HZ as f64) as i128;
            assert!(velocity_stays_below(x, i128::from(j) * STEP, end, fastest + 100));
            assert!(!velocity_stays_below(x, i128::from(j) * STEP, end, fastest - 100));
        }
    }
}
