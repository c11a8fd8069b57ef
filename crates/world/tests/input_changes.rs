//! Reaction of an engaged robot to the clutch of its frames and to another person. Every stage runs in virtual time, from
//! the client's frame to the executed motion. `simulate` has the faulty frames.

use client::{PlayOptions, Player};
use config::Overrides;
use messages::{Fault, Mode, PersonChange, RawSkeleton, Subject, TICK_HZ, Transition, raw_flag};
use motion::CalibrationMode;
use safety::engage::OperatorView;
use std::path::Path;
use std::sync::LazyLock;
use world::{Links, Moment, Running, World, WorldConfig};

static CONFIG: LazyLock<WorldConfig> = LazyLock::new(|| {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let loaded = config::load(&path, Overrides::default()).expect("the settings of the repository");
    WorldConfig::new(&loaded).expect("a world")
});

/// A world that is engaged, two seconds into the motion.
static ENGAGED: LazyLock<Bench> = LazyLock::new(|| {
    let mut bench = Bench::new(6);
    while bench.mode != Mode::Engaged {
        bench.step(&mut |_| true);
        assert!(bench.k < 12 * TICK_HZ, "{:?}", bench.mode);
    }
    bench.run(2 * TICK_HZ, &mut |_| true);
    assert_eq!(bench.mode, Mode::Engaged);
    bench
});

/// A world, a client that plays a motion, and an operator who holds the enable.
#[derive(Clone)]
struct Bench {
    world: World,
    player: Player,
    k: u64,
    mode: Mode,
    enable: bool,
    last: Option<Moment>,
}

impl Bench {
    fn new(seed: u64) -> Self {
        let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
        Self {
            world: World::new(&CONFIG, seed, Links::default()),
            player: Player::new(&motion::builtin(), play, 9, 1),
            k: 0,
            mode: Mode::Disengaged,
            enable: false,
            last: None,
        }
    }

    /// Runs one tick. `spoil` gets each frame of the client, and may change it or drop it.
    fn step(&mut self, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) -> Moment {
        let now = self.world.now();
        if let Some((_, mut raw)) = self.player.due(now, self.mode == Mode::Engaged)
            && spoil(&mut raw)
        {
            self.world.publish(&raw);
        }
        let held = self.enable;
        self.enable = self.k >= TICK_HZ;
        let operator = OperatorView {
            connected: true,
            enable_level: self.enable,
            enable_edge: self.enable && !held,
            heartbeat_received: now,
            ..OperatorView::default()
        };
        let moment = self.world.step(&CONFIG, &operator, Running::ALL);
        self.mode = moment.control.and_then(|c| Mode::from_u32(c.status.mode)).expect("a mode");
        self.k += 1;
        self.last = Some(moment);
        moment
    }

    fn run(&mut self, ticks: u64, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) {
        for _ in 0..ticks {
            self.step(spoil);
        }
    }

    fn why(&self) -> u32 {
        let status = self.last.and_then(|moment| moment.control).expect("control").status;
        let kept = messages::TRANSITIONS_KEPT;
        status.transitions[(status.transition_count as usize + kept - 1) % kept].why
    }

    fn assert_no_violations(&self, context: &str) {
        for (kind, count) in self.world.report().violations() {
            assert_eq!(count, 0, "{context}: {kind}");
        }
    }
}

/// The person goes on moving under the clutch.
#[test]
fn f119_robot_stands_under_the_clutch_of_the_frames_and_then_moves_slowly_to_the_person() {
    let mut bench = ENGAGED.clone();
    bench.run(2 * TICK_HZ, &mut under_clutch);
    assert_eq!((bench.mode, bench.why()), (Mode::Holding, Fault::Clutch as u32));
    let at = |bench: &Bench| bench.last.and_then(|moment| moment.robot).expect("a robot").q;
    let (stands, limits) = (at(&bench), CONFIG.control.model.limits);
    bench.run(TICK_HZ, &mut under_clutch);
    assert!(at(&bench).iter().zip(&stands).all(|(now, then)| (now - then).abs() < 1e-6), "it stands");
    let mut ticks = 0;
    while bench.mode != Mode::Engaging {
        bench.step(&mut |_| true);
        ticks += 1;
        assert!(ticks < TICK_HZ / 5, "{:?}", bench.mode);
    }
    for tick in 0..TICK_HZ - 5 {
        let robot = bench.step(&mut |_| true).robot.expect("a robot");
        let fastest = robot.v.iter().zip(&limits).fold(0.0, |most: f64, (v, limits)| most.max(v.abs() / limits.v_max));
        assert!(fastest <= 0.05 + 1e-6, "tick {tick}: {fastest} of a limit");
    }
    bench.run(5 * TICK_HZ, &mut |_| true);
    assert_eq!(bench.mode, Mode::Engaged);
    bench.assert_no_violations("clutch");
}

fn under_clutch(f: &mut RawSkeleton) -> bool {
    f.flags |= raw_flag::CLUTCH;
    true
}

/// Makes the left forearm half as long again.
fn stretch(f: &mut RawSkeleton) {
    for c in 0..3 {
        f.positions[20][c] = f.positions[18][c] + 1.5 * (f.positions[20][c] - f.positions[18][c]);
    }
}

#[test]
fn each_change_of_the_person_releases_the_robot_and_is_named() {
    type Change = fn(&mut RawSkeleton);
    // The change lasts for so many ticks, and then the other one. For another session the client has to be silent
    // until its lease ends.
    let cases: [(PersonChange, u64, Change, Change); 4] = [
        (PersonChange::FirstOfIngest, 0, |_| {}, |_| {}),
        (PersonChange::Session, TICK_HZ * 11 / 10, |_| {}, |f| f.session_nonce += 1),
        (PersonChange::Operator, 0, |_| {}, |f| f.operator_id += 1),
        (PersonChange::Doubtful, TICK_HZ * 6 / 10, stretch, |_| {}),
    ];
    for (change, ticks, spoil, after) in cases {
        let mut bench = ENGAGED.clone();
        if change == PersonChange::FirstOfIngest {
            bench.world.restart_ingest();
        }
        bench.run(ticks, &mut |f| {
            spoil(f);
            change != PersonChange::Session
        });
        bench.run(TICK_HZ, &mut |f| {
            after(f);
            true
        });
        let status = bench.last.and_then(|moment| moment.control).expect("control").status;
        let changed = |made: &&Transition| made.why == Fault::PersonChanged as u32;
        let about: Vec<_> = explain::newest_transitions(&status, u32::MAX)
            .filter(changed)
            .map(|made| Subject::from_code(made.about))
            .collect();
        assert_eq!(about, [Some(Subject::Person(change))]);
        assert_eq!(bench.mode, Mode::Disengaged, "{change:?}: the enable is held, but the robot was released");
        bench.assert_no_violations("another person");
    }
}
