//! Tests every (state, event) pair of engagement, legal or not. Each is a line of `engage.txt`. The diagram
//! in ARCHITECTURE.md is generated from the same pairs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use crate::support::{Bench, ticks};
use messages::{FAULTS, Fault, Mode, Response, Transition};
use safety::engage::Permit;

type State = (&'static str, fn() -> Bench);
type Event = (&'static str, fn(&mut Bench));

fn at_rest(mut bench: Bench) -> Bench {
    bench.input.motion.at_rest = true;
    bench
}

fn blocked_at_full_speed() -> Bench {
    let mut bench = Bench::engaging();
    bench.steps(ticks(3000));
    bench.input.motion.settled = true;
    bench.steps(ticks(500) - 2);
    bench
}

fn held_too_long() -> Bench {
    let mut bench = Bench::holding(true);
    bench.input.target.input_fresh = false;
    bench.steps(ticks(5000));
    bench.input.target.input_fresh = true;
    bench
}

fn faulted_let_go() -> Bench {
    let mut bench = at_rest(Bench::faulted());
    bench.input.operator.enable_level = false;
    bench
}

fn faulted_by_driver() -> Bench {
    let mut bench = Bench::engaged();
    bench.input.robot.driver_fault = true;
    assert_eq!(bench.step().mode, Mode::Faulted);
    bench.input.operator.enable_level = false;
    at_rest(bench)
}

fn faulted_reset_passed_on() -> Bench {
    let mut bench = faulted_by_driver();
    bench.input.operator.reset_edge = true;
    bench.step();
    bench
}

fn recovering_stuck() -> Bench {
    let mut bench = at_rest(Bench::recovering());
    bench.steps(ticks(500) - 2);
    bench
}

const STATES: [State; 22] = [
    ("Disengaged, just started", || Bench::disengaged(false)),
    ("Disengaged", || Bench::disengaged(true)),
    ("Disengaged, no client", || {
        let mut bench = Bench::disengaged(true);
        bench.alive.heartbeat = false;
        bench
    }),
    ("Disengaged, outside limits", Bench::outside),
    ("Engaging, first second", Bench::engaging),
    ("Engaging, ramp", || {
        let mut bench = Bench::engaging();
        bench.steps(ticks(2000));
        bench
    }),
    ("Engaging, blocked", blocked_at_full_speed),
    ("Engaged", Bench::engaged),
    ("Holding, gap, moving", || Bench::holding(true)),
    ("Holding, gap, at rest", || at_rest(Bench::holding(true))),
    ("Holding, resumable, moving", Bench::holding_near),
    ("Holding, resumable, at rest", || at_rest(Bench::holding_near())),
    ("Holding, released, moving", || Bench::holding(false)),
    ("Holding, released, at rest", || at_rest(Bench::holding(false))),
    ("Holding, too long, moving", held_too_long),
    ("Faulted, moving, enable held", Bench::faulted),
    ("Faulted, at rest, let go", faulted_let_go),
    ("Faulted by driver, at rest", faulted_by_driver),
    ("Faulted by driver, reset passed on", faulted_reset_passed_on),
    ("Recovering, moving", Bench::recovering),
    ("Recovering, at rest", || at_rest(Bench::recovering())),
    ("Recovering, stuck", recovering_stuck),
];

const EVENTS: [Event; 32] = [
    ("nothing", |_| {}),
    ("enable pressed", Bench::press),
    ("enable edge without level", |b| {
        b.input.operator.connected = true;
        b.input.operator.enable_level = false;
        b.input.operator.enable_edge = true;
    }),
    ("enable level without edge", |b| {
        b.input.operator.connected = true;
        b.input.operator.enable_level = true;
    }),
    ("enable let go", |b| b.input.operator.enable_level = false),
    ("recovery pressed", Bench::press_recovery),
    ("recovery edge without level", |b| {
        b.input.operator.connected = true;
        b.input.operator.recover_edge = true;
    }),
    ("recovery pressed with the enable", |b| {
        b.press_recovery();
        b.press();
    }),
    ("recovery let go", |b| b.input.operator.recover_level = false),
    ("back inside and clear", |b| {
        b.input.robot.outside_limits = false;
        b.input.robot.clear_to_start = true;
    }),
    ("release asked for", |b| b.input.operator.release_edge = true),
    ("enable pressed and release", |b| {
        b.press();
        b.input.operator.release_edge = true;
    }),
    ("reset", |b| b.input.operator.reset_edge = true),
    ("reset, let go", |b| {
        b.input.operator.reset_edge = true;
        b.input.operator.enable_level = false;
    }),
    ("reset, let go, at rest", |b| {
        b.input.operator.reset_edge = true;
        b.input.operator.enable_level = false;
        b.input.motion.at_rest = true;
    }),
    ("enable pressed and emergency stop", |b| {
        b.press();
        b.input.operator.estop_edge = true;
    }),
    ("reset and emergency stop, at rest", |b| {
        b.input.operator.reset_edge = true;
        b.input.operator.enable_level = false;
        b.input.operator.estop_edge = true;
        b.input.motion.at_rest = true;
    }),
    ("aligned", |b| b.input.motion.aligned = true),
    ("settled", |b| b.input.motion.settled = true),
    ("at rest", |b| b.input.motion.at_rest = true),
    ("client gone", |b| b.input.operator.connected = false),
    ("target's writer restarted", |b| b.input.target.incarnation += 1),
    ("another session", |b| b.input.target.session_nonce += 1),
    ("session ended", |b| b.input.target.session_nonce = 0),
    ("driver restarted", |b| b.input.robot.incarnation += 1),
    ("command at rest, robot not", |b| (b.input.motion.at_rest, b.input.robot.at_rest) = (true, false)),
    ("reset, let go, command at rest, robot not", |b| {
        b.input.operator.reset_edge = true;
        b.input.operator.enable_level = false;
        (b.input.motion.at_rest, b.input.robot.at_rest) = (true, false);
    }),
    ("enable pressed, robot not at rest", |b| {
        b.press();
        b.input.robot.at_rest = false;
    }),
    ("recovery pressed, robot not at rest", |b| {
        b.press_recovery();
        b.input.robot.at_rest = false;
    }),
    ("driver's fault gone", |b| b.input.robot.driver_fault = false),
    ("tracking error is NaN", |b| b.input.robot.tracking_error_rad = f64::NAN),
    ("overslept 1 s", |b| {
        b.input.k += 1500;
        b.input.own_gap_ns = 1_000_666_667;
    }),
];

/// Brings the bench to the tick before this fault acts. Debouncing and silence pass while nothing comes to rest.
fn raise(bench: &mut Bench, fault: Fault) {
    let at_rest = bench.input.motion.at_rest;
    if matches!(bench.state.mode(), Mode::Holding | Mode::Recovering) {
        bench.input.motion.at_rest = false;
    }
    let input = &mut bench.input;
    match fault {
        Fault::NotRealtime => input.realtime_ok = false,
        Fault::ConfigMismatch => input.target.config_matches = false,
        Fault::StartOutsideLimits => input.robot.outside_limits = true,
        Fault::StartInCollision => input.robot.in_collision = true,
        Fault::NoRobotState => input.robot.commanded = false,
        Fault::NoTarget | Fault::TargetStale => bench.alive.target = false,
        Fault::InputStale => bench.alive.input = false,
        Fault::InputImplausible => input.target.implausible = true,
        Fault::CollisionNear => input.robot.collision_near = true,
        Fault::StateLate | Fault::StateStale => bench.alive.state = false,
        Fault::OperatorSilent => bench.alive.heartbeat = false,
        Fault::WriterRestarted => input.target.incarnation += 1,
        Fault::PersonChanged => input.target.session_nonce += 1,
        Fault::HoldTimeout => {}
        Fault::EmergencyStop => input.operator.estop_edge = true,
        Fault::FeedbackInvalid => input.robot.feedback_invalid = true,
        Fault::TrackingError => input.robot.tracking_error_rad = 0.16,
        Fault::VelocityError => input.robot.velocity_error = true,
        Fault::StandstillLost => input.robot.standstill_lost = true,
        Fault::DeadlinesLate => {
            for _ in 0..9 {
                bench.input.deadlines_missed = 1;
                bench.step();
            }
            bench.input.deadlines_missed = 1;
        }
        Fault::DeadlineMissed => input.deadlines_missed = 10,
        Fault::DriverFault => input.robot.driver_fault = true,
        Fault::GateDenied => input.motion.gate_denied = true,
        Fault::Clutch => input.operator.clutch_level = true,
    }
    let silence_ms = match fault {
        Fault::NoTarget | Fault::TargetStale => 10,
        Fault::StateLate => 5,
        Fault::StateStale => 20,
        Fault::InputStale => 100,
        Fault::OperatorSilent => 200,
        Fault::HoldTimeout => 5000,
        _ => 0,
    };
    // Silence acts once the age exceeds its bound. At 667 us a tick this is the first tick that is not below it.
    let passing = (silence_ms * 1500_u64).div_ceil(1000).saturating_sub(1) + u64::from(fault.row().debounce_ticks - 1);
    for _ in 0..passing {
        bench.step();
    }
    bench.input.motion.at_rest = at_rest;
}

fn why(transition: &Transition) -> String {
    match transition.why {
        Transition::ENABLED => "enabled".into(),
        Transition::RELEASED => "released".into(),
        Transition::ALIGNED => "aligned".into(),
        Transition::AT_REST => "at rest".into(),
        Transition::RESET => "reset".into(),
        Transition::CLEARED => "cleared".into(),
        Transition::SETTLED => "settled".into(),
        Transition::RECOVERING => "recovery held".into(),
        Transition::RECOVERED => "recovered".into(),
        Transition::BLOCKED => "blocked".into(),
        fault => Fault::from_u32(fault).expect("a fault or a reason").row().name.into(),
    }
}

/// Appends the line of a pair. Returns the transition that it causes.
fn line(out: &mut String, state: &State, event: &str, apply: impl Fn(&mut Bench)) -> Option<Transition> {
    let mut bench = (state.1)();
    apply(&mut bench);
    let before = bench.state.mode();
    let resets = bench.last.map_or(0, |last| last.reset_count);
    let decided = bench.step();
    let scale = match decided.permit {
        Permit::Follow { speed_scale } => format!("follow {speed_scale:.2}"),
        Permit::Recover => "recover".into(),
        Permit::Stop => "stop".into(),
    };
    let names = |faults: messages::Faults| {
        let names: Vec<_> = faults.iter().map(|fault| fault.row().name).collect();
        if names.is_empty() { "-".into() } else { names.join("+") }
    };
    let went = decided.transition.map_or(String::new(), |transition| {
        assert_eq!((transition.from, transition.to), (before as u32, decided.mode as u32));
        format!(" -> {} ({})", decided.mode.name(), why(&transition))
    });
    let mut notes = String::new();
    if decided.refused {
        notes += " refused";
    }
    if decided.reset_count != resets {
        notes += " reset+1";
    }
    let (active, latched) = (names(decided.active), names(decided.latched));
    let (name, before) = (state.0, before.name());
    writeln!(out, "{name} | {event} | {before}{went} | {scale} | {active} | latched {latched} |{notes}").unwrap();
    decided.transition
}

/// Returns the lines of all pairs, and all transitions.
fn pairs() -> (String, Vec<Transition>) {
    let mut out = String::from("state | event | mode -> mode (why) | permit | active | latched | notes\n");
    let mut transitions = Vec::new();
    for state in &STATES {
        for (event, apply) in &EVENTS {
            transitions.extend(line(&mut out, state, event, apply));
        }
        for row in &FAULTS {
            transitions.extend(line(&mut out, state, row.name, |bench| raise(bench, row.fault)));
        }
    }
    (out, transitions)
}

fn snapshot() -> String {
    pairs().0
}

/// Text at an arrow: the reason, or the response of a fault.
fn arrow(transition: &Transition) -> String {
    match Fault::from_u32(transition.why).map(|fault| fault.row().response) {
        None => why(transition),
        Some(Response::Inhibit) => unreachable!("an Inhibit makes no transition"),
        Some(Response::Hold) => "Hold fault".into(),
        Some(Response::Release) => "Release fault".into(),
        Some(Response::Stop) => "Stop fault".into(),
    }
}

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../ARCHITECTURE.md");
const BEGIN: &str = "<!-- engagement: written by cargo test -p safety --test all engage_snapshot -- --ignored -->\n";
const END: &str = "<!-- end of engagement -->";

/// Returns the diagram as the block between the two marks of the document.
fn diagram() -> String {
    let mut arrows: BTreeMap<(u32, u32), BTreeSet<String>> = BTreeMap::new();
    for transition in pairs().1 {
        arrows.entry((transition.from, transition.to)).or_default().insert(arrow(&transition));
    }
    let name = |mode: u32| Mode::from_u32(mode).expect("a mode").name();
    let mut out = String::from("```mermaid\nstateDiagram-v2\n    [*] --> Disengaged\n");
    for ((from, to), reasons) in &arrows {
        let reasons: Vec<_> = reasons.iter().map(String::as_str).collect();
        writeln!(out, "    {} --> {}: {}", name(*from), name(*to), reasons.join(" or ")).unwrap();
    }
    out + "```\n"
}

/// Returns the document's text before the block, the block, and the text after it.
fn document() -> [String; 3] {
    let text = std::fs::read_to_string(DOCUMENT).expect("ARCHITECTURE.md");
    let (before, rest) = text.split_once(BEGIN).expect("the mark before the diagram");
    let (block, after) = rest.split_once(END).expect("the mark after the diagram");
    [before.into(), block.into(), after.into()]
}

#[test]
fn diagram_in_document_matches_state_machine() {
    let [_, stored, _] = document();
    assert_eq!(stored, diagram(), "write it again: cargo test -p safety --test all engage_snapshot -- --ignored");
}

#[test]
#[ignore = "writes the diagram: cargo test -p safety --test all engage_snapshot -- --ignored"]
fn write_the_diagram() {
    let [before, _, after] = document();
    std::fs::write(DOCUMENT, format!("{before}{BEGIN}{}{END}{after}", diagram())).unwrap();
}

#[test]
fn every_state_and_event_matches_snapshot() {
    let stored = include_str!("engage.txt");
    let actual = snapshot();
    for (number, (actual, stored)) in actual.lines().zip(stored.lines()).enumerate() {
        assert_eq!(actual, stored, "line {}", number + 1);
    }
    assert!(actual == stored, "the snapshot has {} lines, not {}", stored.lines().count(), actual.lines().count());
}

#[test]
#[ignore = "writes the snapshot: cargo test -p safety --test all engage_snapshot -- --ignored"]
fn write_the_snapshot() {
    std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/engage.txt"), snapshot()).unwrap();
}
