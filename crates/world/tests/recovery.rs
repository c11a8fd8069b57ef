//! A robot that starts outside its limits or too close to itself is refused. Hold-to-run brings it back, and then
//! it engages. Control and driver are the real ones, the robot is simulated.

use crate::support::{Bench, JOINTS, clearance, distances, loaded, random_posture};
use messages::{Fault, Faults, JOINTS_MAX, Mode, TICK_HZ, Transition};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot::{Frames, Model};

/// Margin beyond d_min with which a recovery ends, m.
const MARGIN_M: f64 = 3e-3;
/// Rounding of two kinematics that agree to 1e-12, over a metre.
const ROUNDING_M: f64 = 1e-9;
/// Longest recovery, ticks: 20 mrad take 0.3 s at 0.1 rad/s, and a hand that overlaps by 40 mm is out in a few seconds.
const BACK_WITHIN: u64 = 20 * TICK_HZ;

/// Postures that overlap or nearly do, by at most `depth_m`.
fn in_collision(model: &Model, rng: &mut Pcg64Mcg, depth_m: f64) -> [f64; JOINTS_MAX] {
    let mut frames = Frames::default();
    loop {
        let q = random_posture(model, rng, 0.01);
        let clear = clearance(model, &mut frames, &q);
        let of_itself = distances(model, &mut frames, &q)[..model.pairs.len()].contains(&clear);
        if of_itself && clear > -depth_m && clear < model.d_measured_min_m - 5e-4 {
            return q;
        }
    }
}

/// A home posture with a few joints between their limit and their mechanical stop.
fn outside_limits(model: &Model, rng: &mut Pcg64Mcg) -> [f64; JOINTS_MAX] {
    let mut q = model.home;
    for _ in 0..3 {
        let j = rng.random_range(1..JOINTS);
        let (soft, hard) = (&model.limits[j], &model.urdf_limits[j]);
        let by = rng.random_range(0.006..0.018);
        let below = rng.random_bool(0.5);
        q[j] = if below { (soft.q_min - by).max(hard.q_min) } else { (soft.q_max + by).min(hard.q_max) };
    }
    q
}

/// Checks the executed motion of a recovery, tick by tick.
struct Judge {
    frames: Frames,
    last_q: [f64; JOINTS_MAX],
    last_m: Vec<f64>,
}

impl Judge {
    fn new(bench: &Bench) -> Self {
        let mut frames = Frames::default();
        let last_q = bench.commanded().q;
        let last_m = distances(bench.model(), &mut frames, &last_q);
        Self { frames, last_q, last_m }
    }

    /// Checks that near pairs came no closer, joints outside went no further out, and nothing was fast.
    fn step(&mut self, bench: &Bench, context: &str) {
        let model = bench.model();
        let motion = bench.commanded();
        for j in 0..JOINTS {
            let fastest = if model.prismatic[j] { 0.01 } else { 0.1 };
            assert!(motion.v[j].abs() <= fastest + 1e-9, "{context}: joint {j} at {}", motion.v[j]);
            let (low, high) = (model.limits[j].q_min.min(self.last_q[j]), model.limits[j].q_max.max(self.last_q[j]));
            let q = motion.q[j];
            assert!(q >= low - 1e-11 && q <= high + 1e-11, "{context}: joint {j} went out to {q}");
        }
        let now = distances(model, &mut self.frames, &motion.q);
        let goal = model.d_min_m + MARGIN_M;
        for (pair, (now, last)) in now.iter().zip(&self.last_m).enumerate() {
            assert!(*now >= last.min(goal) - ROUNDING_M, "{context}: pair {pair} from {last} to {now}");
        }
        (self.last_q, self.last_m) = (motion.q, now);
    }

    fn is_clear(&self, model: &Model) -> bool {
        let inside = (0..JOINTS).all(|j| model.limits[j].contains(self.last_q[j]));
        inside && self.last_m.iter().all(|m| *m >= model.d_min_m + MARGIN_M - ROUNDING_M)
    }
}

/// Recovers from `start`. Returns true if it came back, and false if it reported that it finds no way.
fn recover(loaded: &config::Loaded, start: [f64; JOINTS_MAX], reason: Fault, context: &str) -> bool {
    let mut bench = Bench::new(loaded, start, 1);
    bench.settle();
    assert!(Faults(bench.status.faults).has(reason), "{context}: {:?}", Faults(bench.status.faults));
    // The robot cannot be engaged from there, and nothing moves.
    bench.target = Some(loaded.model.home);
    bench.settle();
    bench.press_enable();
    bench.step();
    assert_eq!(bench.mode(), Mode::Disengaged, "{context}");
    bench.let_go();
    bench.settle();
    let mut judge = Judge::new(&bench);
    bench.press_recovery();
    bench.step();
    judge.step(&bench, context);
    assert_eq!(bench.mode(), Mode::Recovering, "{context}: {:?}", Faults(bench.status.faults));
    let mut ticks = 0;
    while bench.mode() == Mode::Recovering && ticks < BACK_WITHIN {
        bench.step();
        judge.step(&bench, context);
        ticks += 1;
    }
    assert_eq!(bench.status.gate_denials, 0, "{context}: the gate denied");
    assert_eq!(bench.mode(), Mode::Disengaged, "{context}: after {ticks} ticks");
    bench.assert_no_violations(context);
    if bench.last_why() != Transition::RECOVERED {
        assert_eq!(bench.last_why(), Transition::BLOCKED, "{context}");
        return false;
    }
    assert!(judge.is_clear(bench.model()), "{context}");
    // The recovery is still held and the person is there. Nothing engages by itself until the enable is pressed.
    bench.settle();
    bench.let_go();
    bench.settle();
    assert_eq!(bench.commanded().q, judge.last_q, "{context}: it moved by itself");
    bench.press_enable();
    bench.step();
    assert_eq!(bench.mode(), Mode::Engaging, "{context}: {:?}", Faults(bench.status.faults));
    bench.steps(TICK_HZ / 4);
    assert_eq!(bench.mode(), Mode::Engaging, "{context}");
    bench.assert_no_violations(context);
    true
}

#[test]
fn f043_joints_outside_limits_are_recovered() {
    let loaded = loaded();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut starts: Vec<_> = (0..6).map(|_| outside_limits(&loaded.model, &mut rng)).collect();
    // Outside by no more than the noise of a measurement.
    for (joint, by) in [(4, 0.004), (12, 0.001)] {
        let mut start = loaded.model.home;
        start[joint] = loaded.model.limits[joint].q_max + by;
        starts.push(start);
    }
    for (n, start) in starts.into_iter().enumerate() {
        assert!(recover(&loaded, start, Fault::StartOutsideLimits, &format!("start {n}")), "start {n}: no way");
    }
}

#[test]
fn f044_postures_in_self_collision_are_recovered() {
    let loaded = loaded();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let mut back = 0;
    for n in 0..16 {
        let start = in_collision(&loaded.model, &mut rng, 0.04);
        back += u32::from(recover(&loaded, start, Fault::StartInCollision, &format!("start {n}")));
    }
    println!("{back} of 16 came back");
    // If two pairs can only be opened by closing another one, the robot stays where it is and reports it.
    assert!(back >= 13, "only {back} of 16 came back");
}

#[test]
fn status_names_joint_outside_and_nearest_pair() {
    let loaded = loaded();
    let mut start = loaded.model.home;
    start[5] = loaded.model.limits[5].q_max + 0.015;
    let mut bench = Bench::new(&loaded, start, 1);
    bench.settle();
    assert_eq!(bench.status.joint_outside, 6, "one more than the index");
    assert!((bench.status.outside_by - 0.015).abs() < 1e-3, "{}", bench.status.outside_by);
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let start = in_collision(&loaded.model, &mut rng, 0.04);
    let mut bench = Bench::new(&loaded, start, 1);
    bench.settle();
    let mut frames = Frames::default();
    loaded.model.forward(&start, &mut frames);
    let (least, pair) = loaded.model.clearance(&frames);
    let pair = &loaded.model.pairs[pair];
    assert_eq!(bench.status.nearest_pair_measured, [pair.a as u32, pair.b as u32]);
    assert!((bench.status.clearance_measured_m - least).abs() < 1e-3);
    assert_eq!(bench.status.joint_outside, 0);
}

#[test]
fn recovery_stops_at_once_on_release_and_does_not_resume() {
    let loaded = loaded();
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    for n in 0..8 {
        let context = format!("start {n}");
        let start = in_collision(&loaded.model, &mut rng, 0.04);
        let mut bench = Bench::new(&loaded, start, 1);
        bench.settle();
        let mut judge = Judge::new(&bench);
        bench.press_recovery();
        for _ in 0..rng.random_range(20..300) {
            bench.step();
            judge.step(&bench, &context);
        }
        if n % 2 == 0 {
            bench.let_go();
        } else {
            bench.hand.estop_edge = true;
        }
        // The recovery's own stop takes 80 ms and the time of acceleration, far below the 500 ms of any other.
        let mut ticks = 0;
        while ticks == 0 || bench.commanded().v.iter().any(|v| *v != 0.0) {
            bench.step();
            judge.step(&bench, &context);
            ticks += 1;
            assert!(ticks < TICK_HZ / 4, "{context}: still moving");
        }
        let rest = bench.commanded().q;
        bench.steps(TICK_HZ);
        let expected = if n % 2 == 0 { Mode::Disengaged } else { Mode::Faulted };
        assert_eq!((bench.mode(), bench.commanded().q), (expected, rest), "{context}");
        bench.assert_no_violations(&context);
    }
}
