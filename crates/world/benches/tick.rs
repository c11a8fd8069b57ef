//! The control tick of the shipped robot: the state machine, the predictive controller, whole-body control and the
//! gate. It follows the built-in motion. And the lifter of a camera's image. Criterion keeps the figures under
//! `target/criterion` and compares the next run with them.

use client::PlayOptions;
use config::Overrides;
use control::{Config, Input, State};
use criterion::{Criterion, criterion_group, criterion_main};
use layouts::{ImagePoints, POINTS};
use messages::{JointTarget, Mode, RobotState, Stamp};
use motion::CalibrationMode;
use safety::engage::OperatorView;
use std::path::Path;
use world::{Offline, OfflineEnd};

/// The inputs of one control tick.
struct Received {
    k: u64,
    now: Stamp,
    target: Option<JointTarget>,
    robot: Option<RobotState>,
    operator: OperatorView,
}

impl Received {
    fn tick(&self, config: &Config, state: &mut State) -> Mode {
        let (target, robot) = (self.target.as_ref(), self.robot.as_ref());
        let input =
            Input { k: self.k, target, policy: None, robot, operator: self.operator, ingest: None, realtime_ok: true };
        let mode = control::tick(config, state, self.now, input).status.mode;
        Mode::from_u32(mode).expect("a mode")
    }
}

fn ticks(criterion: &mut Criterion) {
    let settings = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let loaded = config::load(&settings, Overrides::default()).expect("the shipped settings");
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    let (mut received, mut engaged, mut incarnation) = (Vec::new(), Vec::new(), 0);
    let end = Offline::new(&loaded, &motion::builtin(), options).expect("a run").play(|tick| {
        let Some(control) = &tick.moment.control else { return };
        let (status, operator) = (&control.status, *tick.operator);
        let (target, robot) = (tick.moment.target_seen, tick.moment.state_seen);
        received.push(Received { k: status.k, now: status.header.stamp, target, robot, operator });
        engaged.push(status.mode == Mode::Engaged as u32);
        incarnation = status.header.incarnation;
    });
    assert_eq!(end, OfflineEnd::AtRest);
    let begins = engaged.iter().position(|engaged| *engaged).expect("it engages");
    let ends = engaged.iter().rposition(|engaged| *engaged).expect("it engages");

    let config = world::control_config(&loaded, true).expect("control");
    let mut begun = State::new(&config, incarnation);
    received[..begins].iter().for_each(|received| _ = received.tick(&config, &mut begun));
    let (mut state, mut next) = (begun.clone(), begins);
    criterion.bench_function("control tick", |bencher| {
        bencher.iter(|| {
            if next > ends {
                (state, next) = (begun.clone(), begins);
            }
            let mode = received[next].tick(&config, &mut state);
            assert_eq!(mode, Mode::Engaged);
            next += 1;
        });
    });
}

fn lift(criterion: &mut Criterion) {
    let settings = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let loaded = config::load(&settings, Overrides::default()).expect("the shipped settings");
    let lifter = loaded.lifter.expect("the shipped lifter");
    // The time is the same for every image with a trunk.
    let points = std::array::from_fn(|i| [0.1 * (i as f32).sin(), 0.1 * (i as f32).cos()]);
    let image = ImagePoints { points, seen: [1.0; POINTS] };
    criterion.bench_function("lift", |bencher| {
        bencher.iter(|| lifter.lift(std::hint::black_box(&image), None).expect("a trunk"));
    });
}

criterion_group!(benches, ticks, lift);
criterion_main!(benches);
