//! From any clear posture, towards any target, engaging starts without a jump. After a long hold it is just as slow.

use crate::support::{Bench, JOINTS, TORSO, clearance, loaded};
use messages::{Faults, JOINTS_MAX, JointTarget, Layout, Mode, TICK_HZ, TICK_S, TRAJECTORY_NODES};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot::{Frames, Model};

/// Number of postures.
const POSTURES: u32 = 24;
/// Share of the velocity limits in the first second.
const SLOW: f64 = 0.05;

fn clear_posture(model: &Model, rng: &mut Pcg64Mcg) -> [f64; JOINTS_MAX] {
    let mut frames = Frames::default();
    loop {
        let q = std::array::from_fn(|j| {
            let (low, high) = (model.limits[j].q_min, model.limits[j].q_max);
            if j >= model.count {
                return 0.0;
            }
            // Some joints are at their very limit, as near as the encoder's noise leaves them inside.
            match rng.random_range(0..8) {
                0 => low + 1e-3,
                1 => high - 1e-3,
                _ => rng.random_range(low + 1e-3..high - 1e-3),
            }
        });
        if clearance(model, &mut frames, &q) >= model.d_min_m + 3e-3 {
            return q;
        }
    }
}

/// Any target: another posture, one in collision, far beyond every limit, or a jump every tick.
fn target(model: &Model, rng: &mut Pcg64Mcg, wild: bool) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let limits = &model.limits[j];
        if j >= model.count {
            return 0.0;
        }
        let q = rng.random_range(limits.q_min..limits.q_max);
        if wild && rng.random_bool(0.3) { 8.0 * q } else { q }
    })
}

/// Runs a second of engaging in which no joint exceeds 5 % of its limit or jumps. Returns the travelled distance.
fn first_second(bench: &mut Bench, context: &str, mut next: impl FnMut() -> [f64; JOINTS_MAX]) -> f64 {
    let mut travelled = 0.0;
    let mut last = bench.commanded();
    for n in 0..TICK_HZ - 2 {
        bench.target = Some(next());
        bench.step();
        assert_eq!(bench.mode(), Mode::Engaging, "{context}, tick {n}: {:?}", Faults(bench.status.faults));
        let now = bench.commanded();
        for j in 0..JOINTS {
            let v_max = bench.model().limits[j].v_max;
            let (speed, step) = (now.v[j].abs() / v_max, (now.q[j] - last.q[j]).abs() / (v_max * TICK_S));
            assert!(speed <= SLOW + 1e-9, "{context}, tick {n}: joint {j} at {speed} of its limit");
            assert!(step <= SLOW + 1e-6, "{context}, tick {n}: joint {j} made a step of {step}");
            travelled += (now.q[j] - last.q[j]).abs();
        }
        last = now;
    }
    travelled
}

#[test]
fn f065_engaging_begins_without_jump_from_any_clear_posture() {
    let loaded = loaded();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut travelled = 0.0;
    for n in 0..POSTURES {
        let context = format!("posture {n}");
        let start = clear_posture(&loaded.model, &mut rng);
        let mut bench = Bench::new(&loaded, start, u64::from(n));
        let far = target(&loaded.model, &mut rng, n % 2 == 0);
        bench.target = Some(far);
        bench.settle();
        // The command is the measured posture, not an assumed one.
        for (j, (held, start)) in bench.commanded().q.iter().zip(&start).enumerate() {
            assert!((held - start).abs() < 1e-3, "{context}: joint {j}");
        }
        let held = bench.commanded().q;
        bench.press_enable();
        bench.step();
        assert_eq!(bench.mode(), Mode::Engaging, "{context}: {:?}", Faults(bench.status.faults));
        let first: f64 = (0..JOINTS).map(|j| (bench.commanded().q[j] - held[j]).abs()).fold(0.0, f64::max);
        // One tick of the highest jerk, 400 rad/s^3 T^3 / 6, and nothing more.
        assert!(first <= 400.0 * TICK_S.powi(3) / 6.0 + 1e-12, "{context}: {first}");
        let noisy = n % 3 == 0;
        travelled +=
            first_second(&mut bench, &context, || if noisy { target(&loaded.model, &mut rng, true) } else { far });
        bench.assert_no_violations(&context);
    }
    assert!(travelled > 0.5 * f64::from(POSTURES), "the robots hardly moved: {travelled} rad");
}

/// Runs until the robot's mode is `wanted`. Returns the number of ticks, which is below `within`.
fn until(bench: &mut Bench, wanted: impl Fn(Mode) -> bool, within: u64, context: &str) -> u64 {
    let mut ticks = 0;
    while !wanted(bench.mode()) {
        bench.step();
        ticks += 1;
        assert!(ticks < within, "{context}: {:?} {:?}", bench.mode(), Faults(bench.status.faults));
    }
    ticks
}

/// A person as the robot at `q`, with wrists bent by `bent`. x y z w.
fn person(model: &Model, q: &[f64; JOINTS_MAX], bent: [f64; 2]) -> Box<JointTarget> {
    let xyzw = |matrix: Matrix3<f64>| {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix)).coords.data.0[0]
    };
    let mut target = Box::new(JointTarget::ZERO);
    for (side, arm) in model.arms.iter().enumerate() {
        let (upper, fore) = arm.limb_rotations(&arm.limb_values(q));
        target.human_limbs[2 * side..2 * side + 2].copy_from_slice(&[xyzw(upper), xyzw(fore)]);
        let hand = xyzw(fore * model.wrists[side].rotation([bent[0], bent[1], 0.0])).map(|x| x as f32);
        target.hand_trajectory.iter_mut().for_each(|hands| hands[side] = hand);
    }
    target.limb_trajectory = [target.human_limbs.map(|limb| limb.map(|x| x as f32)); TRAJECTORY_NODES];
    target.trajectory_nodes = TRAJECTORY_NODES as u32;
    target
}

#[test]
fn hands_and_head_begin_slowly_once_the_arms_are_aligned() {
    let loaded = loaded();
    let model = &loaded.model;
    let mut bench = Bench::new(&loaded, model.home, 1);
    let bent = [-0.9, -0.8];
    // The arms are where the person's are, and hands and head are not.
    let mut there = model.home;
    let head = model.head.expect("TIAGo++ has one");
    for (joints, by) in model.wrists.iter().map(|wrist| (wrist.joints, bent)).chain([(head.joints, [0.8, 0.4])]) {
        joints.into_iter().flatten().zip(by).for_each(|(j, by)| there[j] += by);
    }
    (bench.target, bench.person) = (Some(there), person(model, &model.home, bent));
    bench.settle();
    bench.press_enable();
    until(&mut bench, |mode| mode == Mode::Engaged, 2 * TICK_HZ, "aligned arms engage after a second");
    let pointing: Vec<usize> =
        model.wrists.iter().flat_map(|wrist| wrist.joints).chain(head.joints).flatten().collect();
    for n in 0..TICK_HZ {
        bench.step();
        let allowed = SLOW + n as f64 / TICK_HZ as f64 / 2.0;
        for &j in &pointing {
            let share = bench.commanded().v[j].abs() / model.limits[j].v_max;
            assert!(share <= allowed + 0.02, "tick {n}: joint {j} at {share:.3} of its speed, {allowed:.3} is due");
        }
    }
    bench.steps(3 * TICK_HZ);
    for j in pointing {
        let at = bench.commanded().q[j];
        assert!((at - there[j]).abs() < 0.02, "joint {j}: {at} of {}", there[j]);
    }
    bench.assert_no_violations("slowly");
}

#[test]
fn robot_resumes_fast_after_short_gap_and_slowly_after_long_gap() {
    let loaded = loaded();
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for n in 0..6 {
        let context = format!("run {n}");
        let mut bench = Bench::new(&loaded, loaded.model.home, n);
        // Near home, so that the robot reaches it.
        let near = std::array::from_fn(|j| loaded.model.home[j] + if j > 2 { 0.05 } else { 0.0 });
        bench.target = Some(near);
        bench.settle();
        bench.press_enable();
        let mut ticks = until(&mut bench, |mode| mode == Mode::Engaged, 5 * TICK_HZ, &context);
        // At full motion the person is lost for a moment and comes back far away.
        let far = target(&loaded.model, &mut rng, n % 2 == 0);
        bench.target = Some(far);
        bench.steps(rng.random_range(50..400));
        bench.target = None;
        ticks += until(&mut bench, |mode| mode == Mode::Holding, 6 * TICK_HZ - ticks, &context);
        let long = n % 3 == 0;
        let pause = if long { 5 * TICK_HZ / 2 } else { 0 };
        bench.steps(pause);
        bench.target = Some(target(&loaded.model, &mut rng, false));
        until(&mut bench, |mode| mode != Mode::Holding, 9 * TICK_HZ - ticks - pause, &context);
        let again = bench.target.expect("is set");
        if long {
            assert!(bench.status.speed_scale <= SLOW);
            first_second(&mut bench, &context, || again);
        } else {
            let fastest = bench.commanded().v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            assert!(fastest < 1e-3, "{context}: it begins at rest, and not with {fastest}");
            let from = bench.commanded().q;
            for _ in 0..TICK_HZ {
                bench.target = Some(again);
                bench.step();
                assert_eq!(bench.mode(), Mode::Engaged, "{context}: {:?}", Faults(bench.status.faults));
            }
            // At slow speed no joint could travel further than this in a second.
            let slowly = |j: usize| SLOW * bench.model().limits[j].v_max;
            let follows = (0..JOINTS).any(|j| (bench.commanded().q[j] - from[j]).abs() > 3.0 * slowly(j));
            assert!(follows, "{context}: it follows, from {from:?} to {:?}", bench.commanded().q);
        }
        bench.assert_no_violations(&context);
    }
}

#[test]
fn status_reports_raising_torso_while_engaging() {
    let loaded = loaded();
    let mut start = loaded.model.home;
    start[TORSO] -= 0.05;
    let mut bench = Bench::new(&loaded, start, 1);
    bench.target = Some(loaded.model.home);
    bench.settle();
    assert_eq!(explain::activity(&bench.status), None, "nothing moves yet");
    bench.press_enable();
    bench.step();
    bench.step();
    assert_eq!(explain::activity(&bench.status), Some("raising torso"));
    assert!((bench.status.torso_to_go_m - 0.05).abs() < 1e-3, "{}", bench.status.torso_to_go_m);
    let mut ticks = 0;
    while explain::activity(&bench.status).is_some() {
        bench.step();
        ticks += 1;
        assert!(ticks < 10 * TICK_HZ, "{} m to go", bench.status.torso_to_go_m);
    }
    // At full speed it would take 0.7 s. It takes longer, but no longer than the blend and that.
    assert!(ticks > TICK_HZ, "{ticks}");
    bench.assert_no_violations("torso");
}
