//! For any target and any missed ticks, the output is finite, bounded, continuous and reproducible.

use crate::support::{A_MAX, FIRST, FREE, Robot, Trajectory, V_MAX, arm, limb_trajectory, random_q};
use follow::arm::{ArmVector, Limbs};
use follow::{LIMB_JOINTS, NODES, Output, Weights};
use messages::{ALL_JOINTS, TICK_HZ, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// TIAGo++: joints of an arm.
const ARM_JOINTS: usize = 7;
const LEFT: u32 = 0b1_1111 << FIRST[0];
const RIGHT: u32 = 0b1_1111 << FIRST[1];

/// True for a joint that turns no limb.
fn is_wrist(j: usize) -> bool {
    FIRST.iter().any(|&first| (first + LIMB_JOINTS..first + ARM_JOINTS).contains(&j))
}

/// Checks that aims are finite and within the limits. Exactly the joints of valid arms have one, wrists included.
fn assert_sane(output: &Output, valid_mask: u32, context: &str) {
    for (j, aim) in output.aims.iter().enumerate() {
        let arm = FIRST.iter().find(|&&first| (first..first + ARM_JOINTS).contains(&j));
        let meant = arm.is_some_and(|&first| valid_mask >> first & 0b1_1111 == 0b1_1111);
        assert_eq!(aim.is_some(), meant, "{context}: joint {j}");
        let Some(aim) = aim else { continue };
        assert!(aim.q.is_finite() && aim.q.abs() < 10.0, "{context}: joint {j}: {aim:?}");
        assert!(aim.v.abs() <= V_MAX + 1e-9 && aim.a.abs() <= A_MAX, "{context}: joint {j}: {aim:?}");
    }
}

/// Checks that the aim continues from the command within the motion of `ticks` ticks.
fn assert_goes_on(output: &Output, before: &Robot, ticks: u64, context: &str) {
    let dt = ticks as f64 * TICK_S;
    for (j, aim) in output.aims.iter().enumerate() {
        let Some(aim) = aim else { continue };
        let (q, v) = (before.q[j], before.v[j]);
        if is_wrist(j) {
            // A wrist has no acceleration of its own. Whole-body control gives it one.
            let moved = (aim.q - q).abs();
            assert!(moved <= V_MAX * dt.max(TICK_S) + 1e-9, "{context}: wrist {j} from {q} to {}", aim.q);
            continue;
        }
        assert!((aim.v - v).abs() <= A_MAX * dt + 1e-9, "{context}: joint {j} from {v} rad/s to {}", aim.v);
        let moved = (aim.q - q - v * dt).abs();
        assert!(moved <= 0.5 * A_MAX * dt * dt + 1e-9, "{context}: joint {j} from {q} to {} at {v} rad/s", aim.q);
    }
}

fn standing(q: &ArmVector) -> [Limbs; 2] {
    [arm().limbs(q); 2]
}

/// A robot in full motion towards a random goal.
fn moving(seed: u64) -> (Robot, [Limbs; 2]) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut robot = Robot::at(&FREE, Weights::default());
    // Within the robot's own ranges, which are a little narrower.
    let goal = random_q(&mut rng) * 0.9 + ArmVector::from(FREE) * 0.1;
    robot.propose(&goal.into());
    let person = standing(&goal);
    for _ in 0..250 + seed % 10 {
        robot.step(|_| person);
    }
    (robot, person)
}

fn remembered(robot: &Robot) -> Robot {
    Robot { config: robot.config.clone(), state: robot.state.clone(), ..*robot }
}

#[test]
fn same_inputs_give_same_bits() {
    let (mut robot, person) = moving(31);
    let mut again = remembered(&robot);
    let (mut late, _) = moving(31);
    for tick in 0..TICK_HZ {
        let [a, b, c] = [&mut robot, &mut again, &mut late].map(|robot| robot.step(|_| person));
        let bits =
            |output: &Output| output.aims.map(|aim| aim.map(|aim| [aim.q.to_bits(), aim.v.to_bits(), aim.a.to_bits()]));
        assert!(bits(&a) == bits(&b) && bits(&a) == bits(&c), "tick {tick}");
    }
}

#[test]
fn missed_ticks_continue_same_motion() {
    for seed in 0..30 {
        let mut rng = Pcg64::seed_from_u64(100 + seed);
        let (mut robot, person) = moving(seed);
        for n in 0..300 {
            let missed: u64 = if rng.random_bool(0.5) { 1 } else { rng.random_range(1..=40) };
            let before = remembered(&robot);
            let first = (robot.k + missed) / messages::TRAJECTORY_NODE_TICKS + 1;
            let output = robot.step_after(missed, &limb_trajectory(first, |_| person), first);
            let context = format!("seed {seed}, step {n}, {missed} ticks");
            // Accelerations that were chosen for another state may lead a little beyond the speed limit.
            let fastest = output.aims.iter().flatten().fold(0.0, |most: f64, aim| most.max(aim.v.abs()));
            assert!(fastest <= 1.05 * V_MAX, "{context}: {fastest} rad/s");
            assert_goes_on(&output, &before, missed, &context);
        }
        let off = arm().angles(&robot.arm(0), &person[0]);
        assert!(off.iter().all(|angle| *angle < 0.1), "seed {seed}: it arrives all the same, {off:?} rad off");
    }
}

#[test]
fn tick_that_repeats_or_runs_back_hardly_moves_aims() {
    let (mut robot, person) = moving(3);
    let first = robot.next_first();
    let there = robot.q;
    for back in [0, 1, 20, 400] {
        robot.k -= back;
        assert_sane(
            &robot.step_after(0, &limb_trajectory(first, |_| person), first),
            ALL_JOINTS,
            &format!("{back} ticks back"),
        );
        robot.k += back;
        // A new plan may be ahead by the length of its iteration, and a wrist's step by both arms' turns.
        let most = V_MAX * 2.0 * follow::ITERATION_TICKS as f64 * TICK_S;
        assert!((0..there.len()).all(|j| (robot.q[j] - there[j]).abs() <= most), "{back} ticks back");
    }
}

#[test]
fn target_path_with_shifted_start_gives_same_motion() {
    // A person who stands before node 20 of the run and elsewhere after it. A shifted start of the target changes
    // nothing.
    let mut rng = Pcg64::seed_from_u64(41);
    let (from, to) = (ArmVector::from(FREE), ArmVector::from(FREE) + ArmVector::repeat(0.3));
    let run = |shift: i64| {
        let mut robot = Robot::at(&FREE, Weights::default());
        let change = robot.next_first() + 20;
        for _ in 0..TICK_HZ {
            let first = robot.next_first().wrapping_add_signed(shift);
            let trajectory = limb_trajectory(first, |node| standing(if node < change { &from } else { &to }));
            robot.step_after(1, &trajectory, first);
        }
        robot.arm(0)
    };
    let straight = run(0);
    for shift in [-3, -1, 1, 2] {
        assert!((run(shift) - straight).amax() < 1e-3, "shifted by {shift} nodes");
    }
    // For a trajectory far in the past or future, the last or the first node is used.
    for shift in [-1000, 1000, -250_000] {
        let (mut robot, person) = moving(4);
        for n in 0..TICK_HZ {
            let first = robot.next_first().saturating_add_signed(shift + rng.random_range(-2..=2));
            let before = remembered(&robot);
            let output = robot.step_after(1, &limb_trajectory(first, |_| person), first);
            let context = format!("shifted by {shift}, tick {n}");
            assert_sane(&output, ALL_JOINTS, &context);
            assert_goes_on(&output, &before, 1, &context);
        }
    }
    let (mut robot, person) = moving(5);
    for first in [0, u64::MAX, u64::MAX - 24] {
        for _ in 0..40 {
            assert_sane(
                &robot.step_after(1, &limb_trajectory(0, |_| person), first),
                ALL_JOINTS,
                "an absurd beginning",
            );
        }
    }
}

/// Puts hostile numbers into limbs of random nodes.
fn hurt(rng: &mut Pcg64, trajectory: &mut Trajectory) {
    const BAD: [f32; 7] = [0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1e-30, -3.0];
    for _ in 0..rng.random_range(1..60) {
        let limb = &mut trajectory[rng.random_range(0..NODES)][rng.random_range(0..4)];
        let bad = BAD[rng.random_range(0..BAD.len())];
        if rng.random_bool(0.5) {
            *limb = [bad; 4];
        } else {
            limb[rng.random_range(0..4)] = bad;
        }
    }
}

#[test]
fn invalid_target_path_keeps_aims_within_bounds() {
    for seed in 0..40 {
        let mut rng = Pcg64::seed_from_u64(200 + seed);
        let (mut robot, person) = moving(seed);
        for n in 0..800 {
            let first = robot.next_first();
            let mut trajectory = limb_trajectory(first, |_| person);
            robot.places = std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..2.0)));
            match seed % 4 {
                0 => trajectory = [[[0.0; 4]; 4]; NODES],
                1 => trajectory = [[[f32::NAN; 4]; 4]; NODES],
                2 => trajectory = [[[3.0, 1.0, -2.0, 5.0]; 4]; NODES],
                _ => hurt(&mut rng, &mut trajectory),
            }
            if seed % 8 > 3 {
                robot.places = [[f32::NAN, 1e30, f32::INFINITY, 1.0], [-1e30, 1e30, 1e38, 1.0]];
            }
            // The hands are as bad as the limbs.
            robot.hands = std::array::from_fn(|i| [trajectory[i][0], trajectory[i][3]]);
            let before = remembered(&robot);
            let output = robot.step_after(1, &trajectory, first);
            let context = format!("seed {seed}, tick {n}");
            assert_sane(&output, ALL_JOINTS, &context);
            assert_goes_on(&output, &before, 1, &context);
        }
        // When the errors are over, they have no lasting effect.
        (robot.hands, robot.places) = Default::default();
        for _ in 0..2 * TICK_HZ {
            robot.step(|_| person);
        }
        let off = arm().angles(&robot.arm(0), &person[0]);
        assert!(off.iter().all(|angle| *angle < 0.02), "seed {seed}: {off:?} rad off");
    }
}

#[test]
fn arm_without_valid_target_path_stays() {
    for nothing in [0.0, f32::NAN] {
        let mut robot = Robot::at(&FREE, Weights::default());
        for _ in 0..TICK_HZ {
            let first = robot.next_first();
            robot.step_after(1, &[[[nothing; 4]; 4]; NODES], first);
        }
        let moved = (robot.arm(0) - ArmVector::from(FREE)).amax();
        assert!(moved < 1e-3, "{nothing}: {moved} rad");
    }
}

#[test]
fn arm_that_becomes_valid_again_begins_at_command() {
    for seed in 0..40 {
        let mut rng = Pcg64::seed_from_u64(300 + seed);
        let (mut robot, person) = moving(seed);
        for n in 0..1500 {
            if rng.random_bool(0.02) {
                robot.places = std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..2.0)));
            }
            if rng.random_bool(0.05) {
                robot.valid_mask = [0, LEFT, RIGHT, LEFT | RIGHT, ALL_JOINTS, LEFT & LEFT << 1][rng.random_range(0..6)];
            }
            if rng.random_bool(0.01) {
                robot.state.forget();
            }
            let before = remembered(&robot);
            let output = robot.step(|_| person);
            let context = format!("seed {seed}, tick {n}, mask {:b}", robot.valid_mask);
            assert_sane(&output, robot.valid_mask, &context);
            assert_goes_on(&output, &before, 1, &context);
            // An arm that is not valid moves elsewhere, slowly.
            for (j, _) in output.aims.iter().enumerate().filter(|(_, aim)| aim.is_none()) {
                (robot.v[j], robot.q[j]) = (0.3, robot.q[j] + 0.3 * TICK_S);
            }
        }
    }
}

#[test]
fn aim_speed_stays_within_speed_scale() {
    let (mut robot, _) = moving(6);
    let far = standing(&ArmVector::from([-1.1, -1.1, 3.8, 2.2, -2.0]));
    robot.speed_scale = 0.05;
    for n in 0..2 * TICK_HZ {
        let before = remembered(&robot);
        let output = robot.step(|_| far);
        assert_sane(&output, ALL_JOINTS, &format!("tick {n}"));
        assert_goes_on(&output, &before, 1, &format!("tick {n}"));
        // 2 rad/s are braked in 0.2 s. Each arm's turn comes every ten ticks.
        if n > 320 {
            assert!(robot.speed() <= 0.05 * V_MAX + 1e-9, "tick {n}: {} rad/s", robot.speed());
        }
    }
    assert!(robot.speed() > 0.9 * 0.05 * V_MAX, "and it moves on, at {} rad/s", robot.speed());
}
