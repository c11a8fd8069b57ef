//! Tests that no stage allocates in a tick. Counts allocations over 10,000 ticks of each stage, in motion.

use client::{PlayOptions, Player};
use config::Overrides;
use messages::{Header, JointTarget, Layout, Mode, PayloadOrder, RobotState, Skeleton, Stamp, TICK_HZ, deadline};
use motion::CalibrationMode;
use rt::{CountingAllocator, count_allocations};
use safety::engage::OperatorView;
use std::path::Path;
use world::simulated;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Number of counted ticks, after engaging.
const TICKS: u64 = 10_000;
/// Ticks before the count: 1 s with the enable released, then engaging.
const BEFORE: u64 = 6 * TICK_HZ;
/// Tick at which the test sends a payload, while the robot waits. Later payloads are refused.
const PAYLOAD_AT: u64 = TICK_HZ;

#[test]
fn allocation_counter_counts_one_box() {
    let (boxed, counted) = count_allocations(|| Box::new(7));
    assert_eq!((*boxed, counted.allocated), (7, 1));
}

#[test]
fn f076_no_stage_allocates_in_a_tick() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
    let loaded = config::load(&path, Overrides::default()).expect("settings");
    let retarget_config = world::retarget_config(&loaded).expect("retarget");
    let control_config = world::control_config(&loaded, true).expect("control");
    let robot_config = world::simulated_config(&loaded, false).expect("simulated robot");
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let mut player = Player::new(&motion::builtin(), play, 5, 1);
    let skeleton_config = skeleton::Config::default();
    let mut skeleton_state = skeleton::State::default();
    let mut retarget_state = retarget::State::default();
    let mut control_state = control::State::new(&control_config, 2);
    let mut robot_state = simulated::State::new(&robot_config, TICK_HZ - 1, 1);
    let (mut mode, mut engaged, mut counts) = (Mode::Disengaged, 0, [0; 4]);
    let mut robot: Option<RobotState> = None;
    let (printed, mut in_payload) = (Some(PayloadOrder { mass_kg: 0.3, centre_m: None }), 0);
    for tick in 0..BEFORE + TICKS {
        let (k, now) = (TICK_HZ + tick, deadline(TICK_HZ + tick));
        let counting = tick >= BEFORE;
        let mut note = |stage: usize, allocated: u64| counts[stage] += if counting { allocated } else { 0 };
        let mut person: Option<Skeleton> = None;
        if let Some((_, raw)) = player.due(now, mode == Mode::Engaged) {
            let input = skeleton::Input { raw: &raw, stored: None };
            let (out, counted) =
                count_allocations(|| skeleton::tick(&skeleton_config, &mut skeleton_state, now, input));
            note(0, counted.allocated);
            let header = Header { sequence: tick + 1, stamp: now, origin: now, incarnation: 6, ..Header::ZERO };
            person = out.skeleton.map(|person| Skeleton { header, ..person });
        }
        let input = retarget::Input { k, skeleton: person.as_ref() };
        let (out, counted) = count_allocations(|| retarget::tick(&retarget_config, &mut retarget_state, now, input));
        note(1, counted.allocated);
        let header =
            Header { sequence: tick + 1, stamp: now, config_hash: loaded.hash, incarnation: 3, ..Header::ZERO };
        let target = JointTarget { header: Header { origin: out.target.header.origin, ..header }, ..out.target };
        let operator = OperatorView {
            connected: true,
            enable_level: tick > TICK_HZ,
            enable_edge: tick == TICK_HZ + 1,
            heartbeat_received: now,
            payload: [printed.filter(|_| tick == PAYLOAD_AT || counting && tick % 1000 == 0), None],
            ..OperatorView::default()
        };
        let input = control::Input {
            k,
            target: Some(&target),
            policy: None,
            robot: robot.as_ref(),
            operator,
            ingest: None,
            realtime_ok: true,
        };
        let (out, counted) = count_allocations(|| control::tick(&control_config, &mut control_state, now, input));
        note(2, counted.allocated);
        in_payload += if tick == PAYLOAD_AT { counted.allocated } else { 0 };
        let (taken, refused) = (out.status.payloads_taken, out.status.payloads_refused);
        assert_eq!(taken, u32::from(tick >= PAYLOAD_AT), "{:?}", out.status.payload_refused_why);
        assert!(refused > 0 || tick < BEFORE);
        mode = Mode::from_u32(out.status.mode).expect("a mode");
        engaged += u64::from(counting && mode == Mode::Engaged);
        let input = driver::DriveInput { due_k: k, command: out.command.as_ref() };
        let (out, counted) =
            count_allocations(|| simulated::tick(&robot_config, &mut robot_state, Stamp(now.0 + 100_000), input));
        note(3, counted.allocated);
        robot = Some(RobotState { header: Header { incarnation: 4, ..header }, ..out.state });
    }
    assert_eq!(in_payload, 0, "allocations of a payload that is taken");
    assert_eq!(counts, [0; 4], "allocations of skeleton, retarget, control, driver");
    assert_eq!(engaged, TICKS, "the ticks counted are ticks in motion");
}
