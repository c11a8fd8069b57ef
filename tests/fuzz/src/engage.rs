//! The state machine that engages and disengages the robot, under any input at any time.

use crate::bytes::Bytes;
use messages::{Fault, Mode, Response, Stamp, Transition};
use safety::engage::{Config, Input, OperatorView, Output, Permit, RobotView, Settings, State, TargetView, tick};

/// Number of ticks of one input.
const TICKS_MAX: usize = 512;

/// Returns the shipped settings, with the tracking error of soft drives.
fn config() -> Config {
    let settings = Settings {
        tracking_error_rad: 0.05,
        tracking_error_now_rad: 0.15,
        tracking_error_m: 0.01,
        tracking_error_now_m: 0.03,
        ..Settings::default()
    };
    Config::new(&settings).expect("the shipped figures")
}

/// Runs the input. Each step starts with a byte: the number of ticks before it, and the number of fields to set.
/// Then each field has its index and 64 bits. Stamps stay fresh unless they are set.
pub(crate) fn run(input: &[u8]) {
    let config = config();
    let mut bytes = Bytes::new(input);
    let mut state = State::default();
    let mut view = well();
    let mut mode = state.mode();
    let mut fresh = 0xf;
    let mut ticks = 0;
    while !bytes.is_empty() && ticks < TICKS_MAX {
        let step = bytes.u8();
        // Time at rest without faults, long enough for a release, a blend or a hold.
        let idle = [0, 1, 32, 160][usize::from(step >> 6)];
        for _ in 0..idle {
            one(&config, &mut state, &mut view, &mut mode, fresh);
            ticks += 1;
        }
        for _ in 0..step % 8 {
            let field = bytes.u8();
            if field == 255 {
                fresh = bytes.u8();
            } else {
                set(&mut view, field, bytes.u64());
            }
        }
        one(&config, &mut state, &mut view, &mut mode, fresh);
        ticks += 1;
    }
}

/// Returns an input without faults.
fn well() -> Input {
    let mut view = Input { k: 1_000_000, own_gap_ns: 666_667, realtime_ok: true, ..Input::default() };
    view.target = TargetView { config_matches: true, input_fresh: true, incarnation: 7, ..view.target };
    view.target.session_nonce = 70;
    view.robot = RobotView { config_matches: true, commanded: true, incarnation: 9, ..view.robot };
    (view.robot.at_rest, view.robot.sample_ns) = (true, 666_667);
    view.operator.connected = true;
    view.motion.at_rest = true;
    view
}

fn one(config: &Config, state: &mut State, view: &mut Input, mode: &mut Mode, fresh: u8) {
    view.k = view.k.wrapping_add(1);
    let now = messages::deadline(view.k.min(1 << 40));
    let (target, robot, operator) = (&mut view.target, &mut view.robot, &mut view.operator);
    let stamps =
        [&mut target.received, &mut target.input_received, &mut robot.received, &mut operator.heartbeat_received];
    for (bit, stamp) in stamps.into_iter().enumerate() {
        if fresh & 1 << bit != 0 {
            *stamp = now;
        }
    }
    let out = tick(config, state, now, *view);
    check(view, *mode, &out);
    assert_eq!(state.mode(), out.mode);
    *mode = out.mode;
    let held = view.operator;
    view.operator = OperatorView { enable_edge: false, recover_edge: false, release_edge: false, ..held };
    (view.operator.reset_edge, view.operator.estop_edge) = (false, false);
    view.own_gap_ns = 666_667;
}

/// Sets one field to any bits.
fn set(view: &mut Input, field: u8, bits: u64) {
    let (flag, word, real) = (bits & 1 == 1, bits as u32, f64::from_bits(bits));
    let (operator, target, robot, motion) = (&mut view.operator, &mut view.target, &mut view.robot, &mut view.motion);
    match field % 48 {
        0 => view.k = bits,
        1 => view.own_gap_ns = bits,
        2 => view.deadlines_missed = word,
        3 => view.realtime_ok = flag,
        4 => operator.connected = flag,
        5 => operator.enable_level = flag,
        6 => operator.enable_edge = flag,
        7 => operator.recover_level = flag,
        8 => operator.recover_edge = flag,
        9 => operator.release_edge = flag,
        10 => operator.reset_edge = flag,
        11 => operator.estop_edge = flag,
        12 => operator.heartbeat_received = Stamp(bits),
        13 => target.received = Stamp(bits),
        14 => target.incarnation = word,
        15 => target.session_nonce = bits,
        16 => target.config_matches = flag,
        17 => target.input_fresh = flag,
        18 => target.input_received = Stamp(bits),
        19 => target.implausible = flag,
        20 => robot.received = Stamp(bits),
        21 => robot.incarnation = word,
        22 => robot.config_matches = flag,
        23 => robot.commanded = flag,
        24 => robot.driver_fault = flag,
        25 => robot.reset_count = word,
        26 => robot.outside_limits = flag,
        27 => robot.in_collision = flag,
        28 => robot.clear_to_start = flag,
        29 => robot.collision_near = flag,
        30 => robot.tracking_error_rad = real,
        31 => robot.tracking_error_m = real,
        32 => motion.at_rest = flag,
        33 => motion.aligned = flag,
        34 => motion.settled = flag,
        35 => motion.gate_denied = flag,
        40 => target.jumped = flag,
        41 => motion.behind = flag,
        42 => robot.feedback_invalid = flag,
        43 => robot.emergency_stop = flag,
        44 => robot.at_rest = flag,
        45 => robot.velocity_error = flag,
        46 => robot.standstill_lost = flag,
        47 => robot.sample_ns = bits,
        // Pressing an enable takes two fields.
        36..=38 => (operator.enable_level, operator.enable_edge) = (true, true),
        _ => (operator.recover_level, operator.recover_edge) = (true, true),
    }
}

/// Invariants of every tick.
fn check(view: &Input, before: Mode, out: &Output) {
    match (out.mode, out.permit) {
        (Mode::Engaging | Mode::Engaged, Permit::Follow { speed_scale }) => {
            assert!((0.0..=1.0).contains(&speed_scale), "speed scale {speed_scale}");
            assert!(out.mode == before || out.mode == Mode::Engaged || speed_scale <= 0.05, "a fast beginning");
        }
        (Mode::Recovering, Permit::Recover) => {}
        (Mode::Disengaged | Mode::Holding | Mode::Faulted, Permit::Stop) => {}
        other => panic!("{other:?}: a permit that does not belong to the mode"),
    }
    // Every change has a reason, and every reason belongs to a change.
    let changed = |t: Transition| (t.k, t.from, t.to) == (view.k, before as u32, out.mode as u32);
    assert_eq!(before != out.mode, out.transition.is_some(), "{before:?} to {:?}", out.mode);
    assert!(out.transition.is_none_or(changed), "{:?}", out.transition);
    // Only an edge engages or recovers.
    let operator = &view.operator;
    let rests = view.motion.at_rest && view.robot.at_rest;
    let engages = before == Mode::Disengaged && matches!(out.mode, Mode::Engaging | Mode::Engaged);
    if engages {
        assert!(operator.enable_edge && operator.enable_level && !operator.release_edge, "engaged without an edge");
        assert!(out.active.is_empty() && rests, "engaged with {:?}", out.active);
    }
    assert_eq!(out.at_rest, rests);
    let recovers = before != Mode::Recovering && out.mode == Mode::Recovering;
    assert!(!recovers || operator.recover_edge && operator.recover_level, "recovers without an edge");
    // Levels end it, and a stop overrides everything.
    let moves = matches!(out.mode, Mode::Engaging | Mode::Engaged);
    assert!(!moves || operator.enable_level && !operator.release_edge, "moves though it was let go");
    let resets = before == Mode::Faulted && out.mode != Mode::Faulted;
    assert!(!resets || out.mode == Mode::Disengaged && rests && !operator.enable_level, "left Faulted");
    if !out.active.with_response(Response::Stop).is_empty() {
        assert_eq!(out.mode, Mode::Faulted, "{:?}", out.active);
    }
    assert!(!operator.estop_edge || out.active.has(Fault::EmergencyStop), "an emergency stop was missed");
    for response in [Response::Hold, Response::Release] {
        assert!(!moves || out.active.with_response(response).is_empty(), "moves with {:?}", out.active);
    }
}
