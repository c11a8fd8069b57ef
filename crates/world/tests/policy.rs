//! A policy through every stage: its chunks, its silence, and the person who takes over from it.

use crate::support::random_posture;
use crate::support::scene::{Scene, player};
use messages::{
    ChunkDrop, Fault, Faults, Header, JOINTS_MAX, Layout, Mode, PersonChange, PolicyChunk, Stamp, Subject, TICK_HZ,
    TICK_S, chunk_flag, source_flag,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::Model;

/// Rows of a chunk, and the time between them: 20 Hz, as many published policies.
const ROWS: usize = 16;
const PERIOD_NS: u64 = 50_000_000;

impl Scene {
    fn model(&self) -> &Model {
        &self.config.control.model
    }

    /// A chunk that is observed now and begins in `ahead_ns`. `row` gives the joints at a time after now, s.
    fn chunk(&mut self, ahead_ns: u64, row: impl Fn(f64) -> [f64; JOINTS_MAX]) -> PolicyChunk {
        let now = self.world.now();
        self.sequence += 1;
        let (robot, mask) = (self.model().id(), arms(self.model()));
        let mut chunk = PolicyChunk {
            header: Header { sequence: self.sequence, stamp: now, origin: now, ..Header::ZERO },
            session_nonce: 9,
            robot,
            start: now.plus_ns(ahead_ns),
            period_ns: PERIOD_NS,
            rows: ROWS as u32,
            valid_mask: mask,
            ..PolicyChunk::ZERO
        };
        for i in 0..ROWS {
            chunk.q[i] = row((ahead_ns + i as u64 * PERIOD_NS) as f64 * 1e-9).map(|q| q as f32);
        }
        chunk
    }

    /// Publishes a chunk that moves both arms about home, `amplitude` rad wide, with the phase of the world's time.
    fn wave(&mut self, amplitude: f64) -> Result<(), ChunkDrop> {
        let (model, at) = (self.model().clone(), self.world.ticks() as f64 * TICK_S);
        let chunk = self.chunk(0, |s| wave(&model, amplitude, at + s));
        self.world.publish_chunk(&self.config, &chunk)
    }

    /// Runs the tick `k`, with a new chunk in each one of `every`.
    fn step_waving(&mut self, k: u64, every: u64, amplitude: f64) {
        if k.is_multiple_of(every) {
            self.wave(amplitude).expect("a valid chunk");
        }
        self.step();
    }

    /// Runs `seconds`, with a new chunk ten times a second.
    fn run(&mut self, seconds: f64, amplitude: f64) {
        (0..(seconds * TICK_HZ as f64) as u64).for_each(|k| self.step_waving(k, TICK_HZ / 10, amplitude));
    }

    fn engage(&mut self, amplitude: f64) {
        self.run(1.0, amplitude);
        self.press_enable();
        self.run(3.0, amplitude);
        assert_eq!(self.mode, Mode::Engaged, "{:?}", Faults(self.status.faults));
    }
}

/// A count from the environment, for long runs.
fn count(variable: &str, otherwise: usize) -> usize {
    std::env::var(variable).map_or(otherwise, |count| count.parse().expect("a count"))
}

fn arms(model: &Model) -> u32 {
    model.arms.iter().flat_map(|arm| arm.range()).fold(0, |mask, j| mask | 1 << j)
}

/// Every joint of both arms swings about home, so slowly that half of no limit is reached at 0.1 rad.
fn wave(model: &Model, amplitude: f64, at_s: f64) -> [f64; JOINTS_MAX] {
    let mut q = model.home;
    for (side, arm) in model.arms.iter().enumerate() {
        for (i, j) in arm.range().enumerate() {
            let limits = &model.limits[j];
            let inside = amplitude.min(0.4 * (limits.q_max - limits.q_min));
            let middle = q[j].max(limits.q_min + inside).min(limits.q_max - inside);
            q[j] = middle + inside * (2.0 * at_s + i as f64 + side as f64).sin();
        }
    }
    q
}

#[test]
fn f142_policy_beside_a_person_comes_out_within_half_a_degree_and_20_ms() {
    let mut scene = Scene::new(1);
    scene.engage(0.1);
    let model = scene.model().clone();
    let (mut worst, mut sources) = (0.0_f64, u32::MAX);
    for k in 0..4 * TICK_HZ {
        scene.step_waving(k, TICK_HZ / 10, 0.1);
        sources &= scene.status.sources;
        let at = scene.world.ticks() as f64 * TICK_S;
        let distance = |delay_s: f64| {
            let asked = wave(&model, 0.1, at - delay_s);
            let arms = model.arms.iter().flat_map(|arm| arm.range());
            arms.map(|j| (asked[j] - scene.command.q[j]).abs()).fold(0.0, f64::max)
        };
        worst = worst.max((0..=20).map(|ms| distance(f64::from(ms) * 1e-3)).fold(f64::INFINITY, f64::min));
    }
    assert!(worst.to_degrees() < 0.5, "{} degrees at any delay up to 20 ms", worst.to_degrees());
    assert_eq!(sources, source_flag::POLICY[0] | source_flag::POLICY[1]);
    assert_eq!(scene.world.report().violations_total(), 0);
}

#[test]
fn f138_policy_that_falls_silent_stops_the_robot_where_its_chunk_ends() {
    let mut scene = Scene::new(2);
    scene.engage(0.1);
    let chunk_s = ROWS as f64 * PERIOD_NS as f64 * 1e-9;
    scene.wave(0.1).expect("a valid chunk");
    let mut stopped_s = None;
    for k in 0..2 * TICK_HZ {
        scene.step();
        if scene.mode == Mode::Holding && stopped_s.is_none() {
            assert!(Faults(scene.status.faults).has(Fault::InputStale));
            stopped_s = Some(k as f64 * TICK_S);
        }
    }
    let stopped_s = stopped_s.expect("it stops");
    assert!((chunk_s..chunk_s + 0.11).contains(&stopped_s), "{stopped_s} s after the chunk of {chunk_s} s");
    assert!(scene.command.v.iter().all(|&v| v == 0.0) && scene.status.sources == 0);
    // The lease is over. A person is followed only after a new enable.
    for _ in 0..5 * TICK_HZ {
        scene.step();
        assert!(scene.mode != Mode::Engaged && scene.mode != Mode::Engaging, "{:?}", scene.mode);
    }
    let released = explain::newest_transitions(&scene.status, 1).next().map(|made| Subject::from_code(made.about));
    assert_eq!(released, Some(Some(Subject::Person(PersonChange::Policy))));
}

#[test]
fn f143_takeover_at_random_moments_makes_no_step_of_velocity() {
    let count = count("TELEOPD_TAKEOVERS", 100);
    let mut random = Pcg64::seed_from_u64(3);
    let mut scene = Scene::new(3);
    scene.engage(0.3);
    let mut led = [0_u64; 2];
    for _ in 0..count {
        scene.hand.takes_over = [random.random(), random.random()];
        let ticks = random.random_range(20..400);
        for k in 0..ticks {
            scene.step_waving(k, 100, 0.3);
            assert_eq!(scene.mode, Mode::Engaged, "{:?}", Faults(scene.status.faults));
            for (side, led) in led.iter_mut().enumerate() {
                let person = scene.status.sources & source_flag::PERSON[side] != 0;
                assert_eq!(person, scene.hand.takes_over[side]);
                *led += u64::from(person);
            }
        }
    }
    assert!(led.iter().all(|&ticks| ticks > count as u64 * 50), "{led:?} ticks");
    assert!(scene.worst_step < 1e-6, "{} rad/s beyond the acceleration limit", scene.worst_step);
    assert_eq!(scene.world.report().violations_total(), 0);
}

/// Runs with a policy that holds every joint at `at`.
fn hold(scene: &mut Scene, at: [f64; JOINTS_MAX], ticks: u64) {
    for k in 0..ticks {
        if k % 150 == 0 {
            let chunk = scene.chunk(0, |_| at);
            scene.world.publish_chunk(&scene.config, &chunk).expect("a valid chunk");
        }
        scene.step();
    }
}

/// A scene that is Engaged at home, with a person who stands still.
fn at_home(seed: u64) -> (Scene, [f64; JOINTS_MAX], usize) {
    let mut scene = Scene::new(seed);
    scene.stands = true;
    let home = scene.model().home;
    hold(&mut scene, home, TICK_HZ);
    scene.press_enable();
    hold(&mut scene, home, 3 * TICK_HZ);
    assert_eq!(scene.mode, Mode::Engaged);
    let elbow = scene.model().arms[0].range().nth(3).expect("an elbow");
    (scene, home, elbow)
}

fn farthest(a: &[f64; JOINTS_MAX], b: &[f64; JOINTS_MAX]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn f143_held_arm_stays_through_takeover_until_policy_has_seen_it() {
    let (mut scene, home, elbow) = at_home(4);
    let there = scene.command.q;
    scene.hand.takes_over = [true; 2];
    hold(&mut scene, home, TICK_HZ);
    // A wish that was made before the person lets go, and far from where the arm is then.
    let mut other = home;
    other[elbow] += 0.3;
    let stale = scene.chunk(0, |_| other);
    scene.step();
    scene.hand.takes_over = [false; 2];
    scene.step();
    scene.world.publish_chunk(&scene.config, &stale).expect("it is in order");
    // A clutch in between changes nothing.
    for k in 0..TICK_HZ / 2 {
        scene.hand.clutch_level = (100..200).contains(&k);
        scene.step();
        assert!(farthest(&scene.command.q, &there) < 1e-6, "{} rad", farthest(&scene.command.q, &there));
        assert_eq!(scene.status.sources, 0, "nobody leads");
    }
    hold(&mut scene, other, 3 * TICK_HZ);
    let off = (scene.command.q[elbow] - other[elbow]).abs();
    assert!(off < 1e-3, "a chunk that was made since leads: {off} rad off, {:?}", scene.mode);
}

#[test]
fn f143_takeover_begins_where_the_arm_is_and_not_where_the_policy_wants_it() {
    let (mut scene, mut far, elbow) = at_home(9);
    far[elbow] += 0.4;
    hold(&mut scene, far, 30);
    let (there, wanted) = (scene.command.q, far[elbow]);
    assert!(wanted - there[elbow] > 0.35, "the arm has just begun to move: {}", wanted - there[elbow]);
    scene.hand.takes_over = [true; 2];
    hold(&mut scene, far, TICK_HZ);
    assert_eq!(scene.mode, Mode::Engaged);
    // What it needs to brake.
    assert!(farthest(&scene.command.q, &there) < 0.05, "{} rad", farthest(&scene.command.q, &there));
    assert_eq!(scene.status.limb_error_measured_rad, 0.0, "it moves relative to the person, and is not behind");
}

#[test]
fn f142_joint_that_a_policy_names_no_longer_stays_where_it_is() {
    let (mut scene, mut at, elbow) = at_home(7);
    at[elbow] += 0.3;
    hold(&mut scene, at, 2 * TICK_HZ);
    let there = scene.command.q;
    let mut chunk = scene.chunk(0, |_| at);
    chunk.valid_mask &= !(1 << elbow);
    scene.world.publish_chunk(&scene.config, &chunk).expect("a valid chunk");
    for _ in 0..TICK_HZ / 2 {
        scene.step();
        assert!((scene.command.q[elbow] - there[elbow]).abs() < 1e-3, "{}", scene.command.q[elbow] - there[elbow]);
    }
}

#[test]
fn f138_policy_that_returns_after_its_lease_moves_nothing_without_a_new_enable() {
    let (mut scene, home, _) = at_home(8);
    scene.nobody = true;
    for _ in 0..2 * TICK_HZ {
        scene.step();
    }
    assert_ne!(scene.mode, Mode::Engaged);
    hold(&mut scene, home, 4 * TICK_HZ);
    assert!(scene.mode != Mode::Engaged && scene.mode != Mode::Engaging, "{:?}", scene.mode);
}

#[test]
fn f144_person_who_vanishes_or_changes_during_takeover_stops_the_robot() {
    let mut scene = Scene::new(5);
    scene.engage(0.1);
    scene.hand.takes_over = [true, false];
    scene.run(0.5, 0.1);
    assert_eq!((scene.mode, scene.status.sources), (Mode::Engaged, source_flag::PERSON[0] | source_flag::POLICY[1]));
    // Another client. It gets the lease after a second, and leads nothing then.
    scene.player = player(&motion::builtin(), 1.0, 2);
    let mut stopped = false;
    for k in 0..6 * TICK_HZ {
        scene.step_waving(k, 100, 0.1);
        stopped |= scene.mode == Mode::Holding;
        let moves = matches!(scene.mode, Mode::Engaging | Mode::Engaged);
        assert!(!stopped || !moves, "{:?} behind a stranger after {k} ticks", scene.mode);
    }
    assert!(stopped, "{:?}", scene.mode);
}

#[test]
fn f141_adversarial_policy_breaks_no_limit() {
    let ticks = count("TELEOPD_POLICY_TICKS", 60_000) as u64;
    let mut random = Pcg64::seed_from_u64(6);
    let mut scene = Scene::new(6);
    scene.engage(0.1);
    let model = scene.model().clone();
    let (mut dropped, mut engaged, mut goal) = (0, 0_u64, model.home);
    for k in 0..ticks {
        if k % 50 == 0 && random.random_bool(0.7) {
            let attack = random.random_range(0..8);
            if attack < 2 || random.random_bool(0.05) {
                goal = random_posture(&model, &mut random, 0.0);
            }
            let (here, noise) = (scene.command.q, random.random_range(0.0..0.5));
            let mut chunk = scene.chunk(random.random_range(0..60_000_000), |s| match attack {
                // Jumps, walks, beyond every range, frozen, and slowly toward a posture that may be inside the body.
                0 => goal,
                1 => here.map(|q| q + noise),
                2 => goal.map(|q| 4.0 * q),
                3 => here,
                _ => std::array::from_fn(|j| here[j] + (goal[j] - here[j]) * (s / 0.8)),
            });
            match random.random_range(0..20) {
                0 => chunk.q[3][5] = f32::NAN,
                1 => chunk.start = Stamp(chunk.start.0.saturating_sub(3_000_000_000)),
                2 => chunk.valid_mask = random.random(),
                3 => (chunk.flags, chunk.v) = (chunk_flag::VELOCITIES, [[40.0; JOINTS_MAX]; messages::CHUNK_ROWS_MAX]),
                4 => chunk.header.origin = chunk.header.origin.plus_ns(1_000_000_000),
                5 => chunk.rows = random.random_range(0..300),
                _ => {}
            }
            dropped += u64::from(scene.world.publish_chunk(&scene.config, &chunk).is_err());
        }
        if random.random_bool(0.001) {
            scene.hand.takes_over = [random.random(), random.random()];
        }
        scene.step();
        engaged += u64::from(scene.mode == Mode::Engaged);
        match scene.mode {
            Mode::Disengaged if k % 300 == 0 => scene.press_enable(),
            Mode::Faulted => scene.hand.reset_edge = k % 300 == 0,
            _ => scene.hand.reset_edge = false,
        }
        if scene.mode == Mode::Disengaged && k % 300 == 299 {
            (scene.hand.enable_level, scene.hand.release_edge) = (false, true);
        }
    }
    let report = scene.world.report();
    assert_eq!(report.violations_total(), 0, "{:?}", report.first_violation);
    assert!(engaged > ticks / 4 && dropped > 20, "engaged in {engaged} ticks, {dropped} dropped");
}
