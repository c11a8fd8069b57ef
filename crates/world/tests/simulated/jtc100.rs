//! Four controllers that are not synchronised, with commands under attack.

use super::{K, MODEL, behind, exact};
use crate::support::JOINTS;
use checker::{Report, ViolationKind, spline_error, spline_speed_error};
use driver::{DriveInput, Interface, Setpoint};
use messages::{ALL_JOINTS, Header, JOINTS_MAX, JointCommand, Layout, Mode, TICK_S, deadline};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Frames;
use safety::{engage, gate};
use std::sync::LazyLock;
use world::simulated::{Config, Options, State, tick};

/// Two swings.
const TICKS: u64 = 10_000;

fn ideal(interface: Interface) -> Options {
    let robot = plant::Options { delay_ns: 0, ..exact() };
    Options { driver: behind(interface), robot, initial: None }
}

/// First joint of either arm. Its axis is upright.
const SHOULDERS: [usize; 2] = [3, 10];
/// Amplitude of the common swing of both arms, rad, and its angular frequency, rad/s.
const SWING_RAD: f64 = 0.4;
const SWING_OMEGA: f64 = 2.0;

/// Returns a posture in which the arms reach forward side by side, closer than allowed, wherever they swing. One
/// is in the way of the other.
fn side_by_side(rng: &mut Pcg64) -> [f64; JOINTS_MAX] {
    let mut frames = Frames::default();
    loop {
        let mut q = MODEL.home;
        for j in 0..7 {
            let limits = &MODEL.limits[3 + j];
            let middle = rng.random_range(limits.q_min + 0.1..limits.q_max - 0.1);
            (q[3 + j], q[10 + j]) = (middle, middle);
        }
        let beside = |swing: f64| {
            let q = swung(&q, swing);
            MODEL.forward(&q, &mut frames);
            let (clearance_m, pair) = MODEL.clearance(&frames);
            let pair = &MODEL.pairs[pair];
            let arms = [pair.a, pair.b].map(|c| controller_of_body(MODEL.capsules[c].body));
            (-0.03..0.012).contains(&clearance_m) && (arms == [2, 3] || arms == [3, 2])
        };
        if [-SWING_RAD, -SWING_RAD / 2.0, 0.0, SWING_RAD / 2.0, SWING_RAD].into_iter().all(beside) {
            return q;
        }
    }
}

/// Returns the posture with both arms turned to the same side.
fn swung(q: &[f64; JOINTS_MAX], by: f64) -> [f64; JOINTS_MAX] {
    let mut q = *q;
    q[SHOULDERS[0]] += by;
    q[SHOULDERS[1]] -= by;
    q
}

/// Returns the controller of a body. The joint before a body moves it.
fn controller_of_body(body: usize) -> usize {
    if body == 0 { 0 } else { controller(body - 1) }
}

/// Record of one tick.
struct Seen {
    commanded: Setpoint,
    sent: Setpoint,
}

struct Run {
    report: Report,
    denials: u64,
    delays_s: Vec<f64>,
    seen: Vec<Seen>,
}

/// Returns the controller of a joint: torso, head, left arm, right arm.
fn controller(j: usize) -> usize {
    if j < 3 { [0, 1, 1][j] } else { (2 + (j - 3) / 7).min(3) }
}

/// Returns the gate's data on the four controllers: a skew of 10 ms, and splines.
fn controllers() -> gate::Interface {
    gate::Interface {
        off: std::array::from_fn(|j| MODEL.limits[j].j_max * 1e-6 / 96.0),
        skew_s: 0.01,
        controller: std::array::from_fn(controller),
    }
}

/// Returns a robot whose arms have delays at least 9 ms apart: about one in a hundred.
fn far_apart(config: &Config) -> State {
    let apart = |robot: &State| robot.driver().delays_s().is_some_and(|delays| (delays[2] - delays[3]).abs() > 9e-3);
    (0..).map(|seed| State::new(config, K, seed)).find(apart).expect("there are many")
}

/// Whole-body control and the gate follow arms that swing side by side. Now and then no command arrives for some
/// ticks, and the driver plays the plan.
fn attack(certified_for: wbc::Interface, gated: gate::Interface, seed: u64) -> Run {
    attack_on(Interface::Jtc100, certified_for, gated, seed)
}

fn attack_on(interface: Interface, certified_for: wbc::Interface, gated: gate::Interface, seed: u64) -> Run {
    let hand_speed = checker::Options::default().hand_speed_max_m_per_s;
    let wbc_options = wbc::Options::default().interface(certified_for).hand_speed_m_per_s(hand_speed);
    let wbc_config = wbc::Config::new(&MODEL, wbc_options).expect("whole-body control");
    let gate_config = gate::Config::with_interface(&MODEL, &gated).expect("the gate");
    let robot_config = Config::new(&MODEL, &ideal(interface)).expect("the simulated robot");
    let mut robot = far_apart(&robot_config);
    let start = robot.follower().motion.q;
    let (mut wbc_state, mut gate_state) = (wbc::State::at_rest(&wbc_config, start), gate::State::at_rest(start));
    let mut rng = Pcg64::seed_from_u64(seed);
    let centre = side_by_side(&mut rng);
    let (mut silent, mut seed_at) = (0, (K, 0));
    let mut seen = Vec::new();
    for k in K + 1..=K + TICKS {
        let now = deadline(k);
        let phase = SWING_OMEGA * (k - K) as f64 * TICK_S;
        let (q, mut dq) = (swung(&centre, SWING_RAD * phase.sin()), [0.0; JOINTS_MAX]);
        let speed = SWING_RAD * SWING_OMEGA * phase.cos();
        (dq[SHOULDERS[0]], dq[SHOULDERS[1]]) = (speed, -speed);
        if silent == 0 && rng.random_range(0..2000) == 0 {
            silent = rng.random_range(1..10);
        }
        let command = (silent == 0).then(|| {
            let target = wbc::Target { q: &q, dq: &dq, ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
            let permit = wbc::Permit::Follow { speed_scale: 1.0 };
            let proposed = wbc::tick(&wbc_config, &mut wbc_state, now, wbc::Input { k, target: Some(target), permit });
            let permit = engage::Permit::Follow { speed_scale: 1.0 };
            let made =
                gate::tick(&gate_config, &mut gate_state, now, gate::Proposed { k, permit, motion: proposed.motion });
            if !made.accepted() {
                wbc_state.reseed(&made.motion);
            }
            JointCommand {
                header: Header { sequence: k, stamp: now, incarnation: 1, ..Header::ZERO },
                robot: MODEL.id(),
                k,
                seed_k: seed_at.0,
                seed_played: seed_at.1,
                mode: Mode::Engaged as u32,
                ..JointCommand::ZERO
            }
            .with_motion(&made.motion)
        });
        let out = tick(&robot_config, &mut robot, now, DriveInput { due_k: k, command: command.as_ref() });
        assert_eq!(out.accepted.is_some(), command.is_some(), "tick {k}: {:?}", out.refused);
        if silent > 0 {
            silent -= 1;
            let driver = robot.follower();
            wbc_state.reseed(&driver.motion);
            gate_state.reseed(&driver.motion);
            seed_at = (driver.executed_k, driver.plan_ticks_played);
        }
        seen.push(Seen { commanded: robot.follower().setpoint(), sent: *robot.sent() });
    }
    let delays_s = robot.driver().delays_s().expect("four controllers");
    Run { report: robot.report().clone(), denials: gate_state.denials(), delays_s, seen }
}

/// The run that is certified and judged for the controllers.
static CERTIFIED: LazyLock<Run> = LazyLock::new(|| attack(wbc::Interface::JTC_100_HZ, controllers(), 2));

/// Counts ticks below the clearance and denials: certified and judged for the controllers, neither, and judged alone.
#[test]
fn certificate_or_gate_for_jtc_keeps_clearance_and_neither_does_not() {
    let alone = |gated| attack(wbc::Interface::default(), gated, 2);
    let [certified, blind, gated] =
        [&*CERTIFIED, &alone(gate::Interface::default()), &alone(controllers())].map(|run| {
            let Run { report, denials, .. } = run;
            let (below, least_mm) = (report.violations_of(ViolationKind::Clearance), report.min_clearance_m * 1e3);
            println!("least {least_mm:.2} mm, {below} ticks below, {denials} denials");
            (below, *denials)
        });
    let report = &CERTIFIED.report;
    assert_eq!((certified.1, report.violations_total()), (0, 0), "{:?}", report.first_violation);
    assert!(report.min_clearance_m < MODEL.d_min_m + 4e-3, "never close");
    assert!(blind.0 > 0 && blind.1 == 0, "the test cannot fail");
    assert!(gated.0 == 0 && gated.1 > 0, "the gate alone keeps it");
}

#[test]
fn splines_stay_within_bound_of_delayed_command() {
    let run = &*CERTIFIED;
    let skewed = run.delays_s.iter().fold(0.0, |most: f64, delay| most.max((delay - run.delays_s[0]).abs()));
    assert!(skewed > 1e-3 && run.delays_s.iter().all(|delay| (0.01..=0.02).contains(delay)), "{:?}", run.delays_s);
    let (mut off, mut off_speed) = (0.0_f64, 0.0_f64);
    // The commands are known every tick. The cubic between them differs from them by (T / h)^3 of the bound.
    let tick_share = 1.0 / 15.0;
    for (n, seen) in run.seen.iter().enumerate().skip(40) {
        for j in 0..JOINTS {
            let since = n as f64 - run.delays_s[controller(j)] / TICK_S;
            let (from, share) = (since.floor() as usize, since - since.floor());
            let (from, to) = (&run.seen[from].commanded, &run.seen[from + 1].commanded);
            let [q, v] = cubic([from.q[j], from.v[j]], [to.q[j], to.v[j]], share);
            let (bound, speed_bound) = (spline_error(MODEL.limits[j].j_max), spline_speed_error(MODEL.limits[j].j_max));
            off = off.max((seen.sent.q[j] - q).abs() / bound - f64::powi(tick_share, 3));
            off_speed = off_speed.max((seen.sent.v[j] - v).abs() / speed_bound - f64::powi(tick_share, 2));
        }
    }
    println!("positions reach {off:.3}, velocities {off_speed:.3} of their bounds");
    assert!(off <= 1.0 && off_speed <= 1.0, "{off} {off_speed}");
    assert!(off > 0.3 && off_speed > 0.3, "a bound that nothing comes near: {off} {off_speed}");
}

/// The largest step of the shoulders' setpoints in one tick, as a share of what their speed limits allow.
fn largest_step(run: &Run) -> f64 {
    let step = |pair: &[Seen], j: usize| (pair[1].sent.q[j] - pair[0].sent.q[j]).abs() / MODEL.limits[j].v_max / TICK_S;
    let steps = run.seen.windows(2).flat_map(|pair| SHOULDERS.map(|j| step(pair, j)));
    steps.fold(0.0, f64::max)
}

#[test]
fn controllers_that_begin_again_at_each_point_jump() {
    let restarting = attack_on(Interface::Jtc100Restart, wbc::Interface::JTC_100_HZ, controllers(), 2);
    let [curves, points] = [&*CERTIFIED, &restarting].map(largest_step);
    println!("largest steps: {curves:.3} of the limit with curves, {points:.3} with points");
    assert!(curves < 1.01 && points > 3.0, "{curves} {points}");
}

fn cubic(from: [f64; 2], to: [f64; 2], s: f64) -> [f64; 2] {
    let (d, a, b) = (to[0] - from[0], TICK_S * from[1], TICK_S * to[1]);
    let (c2, c3) = (3.0 * d - 2.0 * a - b, a + b - 2.0 * d);
    [from[0] + s * (a + s * (c2 + s * c3)), (a + s * (2.0 * c2 + s * 3.0 * c3)) / TICK_S]
}
