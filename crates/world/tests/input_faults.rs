//! Reaction of an engaged robot to faulty skeletons. Every stage runs in virtual time, from the client's frame to
//! the executed motion.

use client::{PlayOptions, Player};
use config::Overrides;
use messages::{Fault, Mode, PersonChange, RawSkeleton, Subject, TICK_HZ, Transition, raw_flag};
use motion::CalibrationMode;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use safety::engage::OperatorView;
use std::path::Path;
use std::sync::LazyLock;
use world::{Links, Moment, Running, World, WorldConfig};

/// Ticks from the last good skeleton to the stop: 100 ms, and two.
const STALE_TICKS: u64 = TICK_HZ / 10 + 2;

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
    bench.modes.clear();
    bench
});

/// A world, a client that plays a motion, and an operator who holds the enable.
#[derive(Clone)]
struct Bench {
    world: World,
    player: Player,
    k: u64,
    mode: Mode,
    modes: Vec<Mode>,
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
            modes: Vec::new(),
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
        if self.modes.last() != Some(&self.mode) {
            self.modes.push(self.mode);
        }
        self.k += 1;
        self.last = Some(moment);
        moment
    }

    fn run(&mut self, ticks: u64, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) {
        for _ in 0..ticks {
            self.step(spoil);
        }
    }

    /// Number of ticks until the robot is no longer engaged.
    fn until_holding(&mut self, within: u64, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) -> u64 {
        for n in 1..=within {
            self.step(spoil);
            if self.mode != Mode::Engaged {
                assert_eq!(self.mode, Mode::Holding);
                return n;
            }
        }
        panic!("still engaged after {within} ticks");
    }

    /// Executed speed of the fastest joint.
    fn speed(&self) -> f64 {
        let robot = self.last.and_then(|moment| moment.robot).expect("a robot");
        robot.v.iter().fold(0.0, |most, v| v.abs().max(most))
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

/// Name, and the function that changes a frame.
type Lie = (&'static str, Box<dyn FnMut(&mut RawSkeleton)>);

fn lies() -> [Lie; 10] {
    let mut frozen: Option<RawSkeleton> = None;
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let jumps = |f: &mut RawSkeleton| {
        if f.header.sequence % 2 == 1 {
            f.positions[20] = f.positions[16].map(|c| c + 0.1);
        }
    };
    let freezes = move |f: &mut RawSkeleton| {
        let first = frozen.get_or_insert(*f);
        (f.positions, f.rotations) = (first.positions, first.rotations);
    };
    let shakes = move |f: &mut RawSkeleton| {
        f.positions.iter_mut().flatten().for_each(|c| *c += rng.random_range(-0.05..0.05));
    };
    [
        ("f003", Box::new(|f| f.positions[4][2] = 3e38)),
        ("f004", Box::new(|f| f.rotations[18][0] = 0.9)),
        ("f006", Box::new(|f| stretch(f, 1.2))),
        ("f007", Box::new(jumps)),
        ("f009", Box::new(|f| [16, 18, 20].into_iter().for_each(|j| f.positions.swap(j, j + 1)))),
        ("f010", Box::new(|f| f.positions.iter_mut().flatten().for_each(|c| *c *= 100.0))),
        ("f013", Box::new(freezes)),
        ("f016", Box::new(|f| f.operator_id += 1)),
        ("f017", Box::new(shakes)),
        ("f018", Box::new(|f| f.layout = 7)),
    ]
}

fn under_clutch(f: &mut RawSkeleton) -> bool {
    f.flags |= raw_flag::CLUTCH;
    true
}

fn stretch(f: &mut RawSkeleton, factor: f32) {
    for c in 0..3 {
        f.positions[20][c] = f.positions[18][c] + factor * (f.positions[20][c] - f.positions[18][c]);
    }
}

#[test]
fn f003_f004_f006_f007_f009_f010_f012_f013_f016_f017_f018_bad_input_of_400_ms_needs_new_enable() {
    for (name, mut lie) in lies() {
        let mut bench = ENGAGED.clone();
        let mut spoil = |f: &mut RawSkeleton| {
            lie(f);
            true
        };
        // A stuck tracker counts as stuck after 100 ms. Of two jumps there and back the first is accepted, and the
        // second, two frames later, is not. Everything else is refused from its first frame on.
        let later = match name {
            "f013" => STALE_TICKS,
            "f007" => 2 * TICK_HZ / 60,
            _ => 0,
        };
        let within = STALE_TICKS + TICK_HZ / 60 + later;
        let n = bench.until_holding(within, &mut spoil);
        bench.run((TICK_HZ * 4 / 10).saturating_sub(n), &mut spoil);
        // The person appears as before, and the enable is held all the time.
        bench.run(TICK_HZ, &mut |f| {
            f.operator_id += u32::from(name == "f016");
            true
        });
        assert_eq!(bench.modes, [Mode::Engaged, Mode::Holding, Mode::Disengaged], "{name}");
        assert!([Transition::AT_REST, Fault::PersonChanged as u32].contains(&bench.why()), "{name}");
        assert!(bench.speed() < 1e-9, "{name}");
        bench.assert_no_violations(name);
    }
}

#[test]
fn f001_f002_f011_arm_without_numbers_holds_and_goes_on_once_it_is_seen() {
    let marks: [Lie; 2] = [
        ("f001", Box::new(|f| f.positions[20][1] = f32::NAN)),
        ("f002", Box::new(|f| f.rotations[17][3] = f32::NEG_INFINITY)),
    ];
    for (name, mut mark) in marks {
        let mut bench = ENGAGED.clone();
        let mut spoil = |f: &mut RawSkeleton| {
            mark(f);
            true
        };
        bench.run(TICK_HZ, &mut spoil);
        assert_eq!(
            bench.modes.iter().filter(|mode| **mode == Mode::Disengaged).count(),
            0,
            "{name}: {:?}",
            bench.modes
        );
        assert!(bench.speed() < 1e-9, "{name}");
        bench.run(6 * TICK_HZ, &mut |_| true);
        assert_eq!(bench.mode, Mode::Engaged, "{name}: {:?}", bench.modes);
        bench.assert_no_violations(name);
    }
}

#[test]
fn each_change_of_the_person_is_named_by_its_cause() {
    type Change = fn(&mut RawSkeleton);
    // The change lasts for so many ticks, and then the other one. For another session the client has to be silent
    // until its lease ends.
    let cases: [(PersonChange, u64, Change, Change); 4] = [
        (PersonChange::FirstOfIngest, 0, |_| {}, |_| {}),
        (PersonChange::Session, TICK_HZ * 11 / 10, |_| {}, |f| f.session_nonce += 1),
        (PersonChange::Operator, 0, |_| {}, |f| f.operator_id += 1),
        (PersonChange::Doubtful, TICK_HZ * 6 / 10, |f| stretch(f, 1.5), |_| {}),
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
    }
}

#[test]
fn f024_enable_engages_at_15_hz_input_and_not_below() {
    for (every_ms, engages) in [(200, false), (100, false), (70, false), (66, true), (50, true), (33, true)] {
        let mut bench = Bench::new(6);
        let mut newest = None;
        for k in 0..7 * TICK_HZ / 2 {
            // The enable is pressed again every half second, at all phases of the source.
            if k > TICK_HZ && k % 770 < 300 {
                (bench.enable, bench.k) = (false, 0);
            } else if k > TICK_HZ {
                bench.k = TICK_HZ;
            }
            let due = k % (every_ms * TICK_HZ / 1000) == 0;
            bench.step(&mut |f| {
                newest = Some(*f);
                false
            });
            if let (true, Some(mut raw)) = (due, newest) {
                raw.header.origin = bench.world.now();
                bench.world.publish(&raw);
            }
        }
        assert_eq!(bench.modes.contains(&Mode::Engaging), engages, "every {every_ms} ms: {:?}", bench.modes);
    }
}
