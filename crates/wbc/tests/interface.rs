//! Tests the executed motion of a robot whose controllers are not synchronised and put splines through
//! samples of the command.

use crate::support::{D_MIN_M, config_of, input, made_up, parts};
use judge::{Attacker, Checker, Robot};
use messages::{ALL_JOINTS, JOINTS_MAX, Stamp, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::{
    Config, Input, Interface, Interpolation, JointMotion, Options, Output, Permit, State, Target, WbcError,
    certify_rest, tick,
};

/// First joint, and one past the last joint, of each controller.
const CONTROLLERS: [[usize; 2]; 4] = [[0, 1], [1, 3], [3, 10], [10, 17]];

const TICKS: u64 = 5000;

/// Joints of either arm in a posture of the invented robot. Its hands are 15 mm apart and reach forward, side
/// by side. If one shoulder alone turns by 0.05 rad, they touch.
const SIDE_BY_SIDE: [f64; 7] = [0.6574, 0.7151, 0.8337, 1.5033, -0.4189, 0.1196, -0.4295];

/// The commands of one run, one for each tick.
struct Trace(Vec<JointMotion>);

impl Trace {
    /// Records a run under attack.
    fn attacked(robot: &Robot, options: Options, seed: u64) -> Self {
        let mut attacker = Attacker::new(robot, Pcg64::seed_from_u64(seed));
        Self::new(robot, options, robot.home, |config, state, k| {
            attacker.next(k, &state.planned().q);
            tick(config, state, Stamp::NONE, input(k, &attacker))
        })
    }

    /// Records a run in which both hands, close together and side by side, swing to and fro with their
    /// shoulders. Each hand is in the way of the other.
    fn chased(robot: &Robot, options: Options, _: u64) -> Self {
        let mut start = robot.home;
        start[3..10].copy_from_slice(&SIDE_BY_SIDE);
        start[10..17].copy_from_slice(&SIDE_BY_SIDE);
        Self::new(robot, options, start, |config, state, k| {
            let (mut q, mut dq, t) = (start, [0.0; JOINTS_MAX], k as f64 * TICK_S);
            for (j, sign) in [(3, 1.0), (10, -1.0)] {
                q[j] += sign * 0.35 * (5.0 * t).sin();
                dq[j] = sign * 1.75 * (5.0 * t).cos();
            }
            let target = Target { q: &q, dq: &dq, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
            let permit = Permit::Follow { speed_scale: 1.0 };
            tick(config, state, Stamp::NONE, Input { k, target: Some(target), permit })
        })
    }

    fn new(
        robot: &Robot,
        options: Options,
        start: [f64; JOINTS_MAX],
        mut tick: impl FnMut(&Config, &mut State, u64) -> Output,
    ) -> Self {
        let config = config_of(robot, options);
        let mut state = State::at_rest(&config, start);
        let mut checker = Checker::new(robot, *state.planned());
        let mut trace = vec![*state.planned()];
        for k in 0..TICKS {
            let out = tick(&config, &mut state, k);
            checker.command(k, &out.motion, out.on_plan, false);
            trace.push(*state.planned());
        }
        assert_eq!(checker.violations, 0, "{:#?}", checker.first);
        Self(trace)
    }

    fn end_s(&self) -> f64 {
        (self.0.len() - 1) as f64 * TICK_S
    }

    /// Position and velocity of joint `j` at `t`. Between two commands a cubic goes through positions and
    /// velocities. It differs from the motion by at most J T^3 / 96 = 1e-9 rad.
    fn at(&self, j: usize, t: f64) -> [f64; 2] {
        let k = ((t / TICK_S) as usize).min(self.0.len() - 2);
        let (from, to) = (&self.0[k], &self.0[k + 1]);
        cubic([from.q[j], from.v[j]], [to.q[j], to.v[j]], TICK_S, t / TICK_S - k as f64)
    }

    /// Position that a controller executes if it samples at `phase` and then every period.
    fn executed(&self, interface: &Interface, j: usize, t: f64, phase: f64) -> f64 {
        let h = interface.period_s;
        if interface.interpolation == Interpolation::Exact {
            return self.at(j, t)[0];
        }
        let n = ((t - phase) / h).floor();
        let [from, to] = [n, n + 1.0].map(|n| self.at(j, (phase + n * h).clamp(0.0, self.end_s())));
        let share = (t - phase) / h - n;
        match interface.interpolation {
            Interpolation::Linear => from[0] + share * (to[0] - from[0]),
            _ => cubic(from, to, h, share)[0],
        }
    }
}

/// The cubic with these positions and velocities at the ends of `h` seconds, at share `s` of this time.
fn cubic(from: [f64; 2], to: [f64; 2], h: f64, s: f64) -> [f64; 2] {
    let (d, a, b) = (to[0] - from[0], h * from[1], h * to[1]);
    let (c2, c3) = (3.0 * d - 2.0 * a - b, a + b - 2.0 * d);
    [from[0] + s * (a + s * (c2 + s * c3)), (a + s * (2.0 * c2 + s * 3.0 * c3)) / h]
}

/// Least clearance of the executed motion, m. It is measured at every tick, with several delays per
/// controller, at the ends of their range and within it.
fn least_executed(robot: &Robot, trace: &Trace, interface: &Interface, seed: u64) -> f64 {
    let mut rng = Pcg64::seed_from_u64(seed);
    let phases: [f64; 4] = std::array::from_fn(|_| rng.random_range(0.0..=interface.period_s));
    let mut least = f64::INFINITY;
    let mut t = interface.skew_s + 2.0 * interface.period_s;
    while t < trace.end_s() - 2.0 * interface.period_s {
        for _ in 0..2 {
            let mut q = [0.0; JOINTS_MAX];
            for (controller, phase) in CONTROLLERS.into_iter().zip(phases) {
                let share = if rng.random_bool(0.7) {
                    f64::from(rng.random_range(0..2_u8))
                } else {
                    rng.random_range(0.0..1.0)
                };
                for (j, q) in q.iter_mut().enumerate().take(controller[1]).skip(controller[0]) {
                    *q = trace.executed(interface, j, t - share * interface.skew_s, phase);
                }
            }
            least = least.min(robot.clearance(&q));
        }
        t += TICK_S;
    }
    least
}

#[test]
fn executed_motion_keeps_clearance_certified_for_interface() {
    let robot = made_up();
    let linear = Interface { interpolation: Interpolation::Linear, ..Interface::JTC_100_HZ };
    let mut closest = f64::INFINITY;
    for (i, interface) in [Interface::JTC_100_HZ, linear].into_iter().enumerate() {
        for seed in 200..202 {
            for make in [Trace::attacked, Trace::chased] {
                let trace = make(&robot, Options::default().interface(interface), seed);
                let least = least_executed(&robot, &trace, &interface, seed);
                println!("interface {i}, seed {seed}: executed {:.3} mm", least * 1e3);
                assert!(least >= D_MIN_M, "interface {i}, seed {seed}: {least} m");
                closest = closest.min(least);
            }
        }
    }
    assert!(closest < D_MIN_M + 4e-3, "never close: {closest} m");
}

#[test]
fn executed_motion_without_skew_in_certificate_is_too_close() {
    let robot = made_up();
    let without_skew = Interface { skew_s: 0.0, ..Interface::JTC_100_HZ };
    for options in [Options::default(), Options::default().interface(without_skew)] {
        let least = (200..202).map(|seed| {
            let trace = Trace::chased(&robot, options, seed);
            least_executed(&robot, &trace, &Interface::JTC_100_HZ, seed)
        });
        let least = least.fold(f64::INFINITY, f64::min);
        println!("without skew in the certificate: executed {:.3} mm", least * 1e3);
        assert!(least < D_MIN_M - 3e-4, "{least} m: the test cannot fail");
    }
}

#[test]
fn certify_rest_is_same_with_and_without_skew() {
    let robot = made_up();
    let configs =
        [Options::default(), Options::default().interface(Interface::JTC_100_HZ)].map(|o| config_of(&robot, o));
    let [plain, skewed] = configs.each_ref().map(|config| certify_rest(config, &robot.home));
    assert_eq!((plain, plain.0), (skewed, true));
}

#[test]
fn interface_out_of_bounds_is_refused() {
    let refuse = |interface: Interface| match Config::from_parts(parts(), Options::default().interface(interface)) {
        Err(WbcError::Interface { key, value, bound }) => (key, value, bound),
        other => panic!("{interface:?} was not refused: {:?}", other.map(|_| ())),
    };
    assert_eq!(refuse(Interface { skew_s: 0.06, ..Interface::default() }), ("skew_s", 0.06, 0.05));
    assert_eq!(refuse(Interface { period_s: -1.0, ..Interface::JTC_100_HZ }), ("period_s", -1.0, 0.05));
    assert_eq!(refuse(Interface { skew_s: f64::NAN, ..Interface::default() }).0, "skew_s");
    let (key, value, _) = refuse(Interface { skew_s: 0.05, ..Interface::default() });
    assert!(key == "deviation at rest in m" && value > 2e-3, "{key} {value}");
}
