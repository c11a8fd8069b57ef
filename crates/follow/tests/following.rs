//! The stage with a robot whose command equals the aim: it reaches, keeps up, rises, and does not spin.

use crate::support::{A_MAX, FREE, Robot, V_MAX, arm, clearance_m, model, node_s, posture, random_q, turned};
use follow::LIMB_JOINTS;
use follow::Weights;
use follow::arm::{Arm, ArmVector, Limbs};
use messages::{TICK_HZ, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// The larger of an arm's two limb errors, degrees.
fn off_deg(robot: &Robot, side: usize, person: &Limbs) -> f64 {
    let [upper, fore] = arm().angles(&robot.arm(side), person);
    upper.max(fore).to_degrees()
}

#[test]
fn robot_reaches_standing_person_and_then_stands() {
    let goals = [[0.9, -0.4, 2.2, 1.6, -0.7], [-0.5, 0.9, 0.9, 0.4, 0.9], [0.3, 0.3, 1.5, 0.0, 0.2]];
    for (n, goal) in goals.iter().enumerate() {
        let mut robot = Robot::at(&FREE, Weights::default());
        robot.propose(goal);
        let person = arm().limbs(&ArmVector::from(*goal));
        let mut reached = None;
        for tick in 0..4 * TICK_HZ {
            robot.step(|_| [person; 2]);
            let off = off_deg(&robot, 0, &person).max(off_deg(&robot, 1, &person));
            if off < 1.0 {
                reached = reached.or(Some(tick));
            }
            // Once it has arrived, it does not leave again.
            assert!(reached.is_none() || off < 1.5, "goal {n}: {off} degrees off again");
        }
        let off = off_deg(&robot, 0, &person).max(off_deg(&robot, 1, &person));
        println!("goal {n}: reached after {reached:?} ticks, then {off:.4} degrees off at {:.2e} rad/s", robot.speed());
        // 1.3 rad at 2 rad/s and 10 rad/s^2 take 0.85 s.
        assert!(reached.is_some_and(|tick| tick < 3 * TICK_HZ / 2), "goal {n}: {reached:?}");
        assert!(off < 0.05 && robot.speed() < 2e-3, "goal {n}: {off} degrees off, {} rad/s", robot.speed());
        assert!((robot.arm(0) - robot.arm(1)).amax() < 1e-6, "goal {n}: the right arm is the mirror of the left");
    }
}

#[test]
fn proposed_posture_does_not_change_reached_limbs() {
    let goal = [0.9, -0.4, 2.2, 1.6, -0.7];
    let person = arm().limbs(&ArmVector::from(goal));
    for by in [-0.6, 0.6] {
        let mut robot = Robot::at(&FREE, Weights::default());
        robot.propose(&goal.map(|q| q + by));
        for _ in 0..4 * TICK_HZ {
            robot.step(|_| [person; 2]);
        }
        let off = off_deg(&robot, 0, &person);
        assert!(off < 0.1, "proposed {by} rad away: {off} degrees off");
    }
}

#[test]
fn slow_person_is_followed_within_one_degree() {
    // At most 0.3 x 0.41 Hz x 2 pi = 0.8 rad/s and 2 rad/s^2. Allowed are 2 rad/s and 10 rad/s^2.
    let at =
        |t_s: f64| ArmVector::from_fn(|j, _| FREE[j] + 0.3 * (TAU * t_s * (0.24 + 0.042 * j as f64) + j as f64).sin());
    let mut robot = Robot::at(&FREE, Weights::default());
    let (mut worst, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
    for tick in 0..8 * TICK_HZ {
        let t_s = robot.k as f64 * TICK_S;
        robot.propose(&at(t_s).into());
        robot.step(|node| [arm().limbs(&at(node_s(node))); 2]);
        if tick > TICK_HZ {
            let off = off_deg(&robot, 0, &arm().limbs(&at(robot.k as f64 * TICK_S)));
            (worst, sum, count) = (worst.max(off), sum + off, count + 1.0);
        }
    }
    println!("a slow person: {:.3} degrees off in the mean, {worst:.3} at most", sum / count);
    assert!(worst < 1.0 && sum / count < 0.5, "{} degrees in the mean, {worst} at most", sum / count);
}

/// Final error of the limbs of a hanging arm that must rise, degrees.
fn rises(hangs: &[f64; LIMB_JOINTS], raised: &[f64; LIMB_JOINTS], weights: Weights) -> f64 {
    arrives(Robot::at(hangs, weights), raised)
}

/// Final error of the limbs, degrees.
fn arrives(mut robot: Robot, raised: &[f64; LIMB_JOINTS]) -> f64 {
    robot.propose(raised);
    let person = arm().limbs(&ArmVector::from(*raised));
    for _ in 0..4 * TICK_HZ {
        robot.step(|_| [person; 2]);
    }
    off_deg(&robot, 0, &person)
}

#[test]
fn hanging_arm_on_wrong_side_reaches_raised_posture_with_pull() {
    // Joint 2 is at its limit, where joints 1 and 3 turn about one line. Those two are on the wrong side. So the
    // arm must turn about itself before it can rise.
    let cases = [
        ([0.18, 1.55, 0.07, 0.41, -0.23], [0.69, -0.10, 3.64, 0.02, -0.13]),
        ([-0.16, 1.55, 3.58, 0.47, -0.21], [1.28, -0.46, 0.94, 0.82, 0.37]),
        ([-0.26, 1.55, 2.93, 0.26, -0.28], [-0.03, -0.31, -0.55, 0.96, -0.40]),
    ];
    for (n, (hangs, raised)) in cases.iter().enumerate() {
        let with = rises(hangs, raised, Weights::default());
        let without = rises(hangs, raised, Weights { pull: 0.0, ..Weights::default() });
        println!("arm {n} that hangs on the other side: {with:.3} degrees off, {without:.1} without the pull");
        assert!(with < 0.1, "arm {n}: {with} degrees off");
        assert!(without > 20.0, "arm {n}: limbs alone lead there as well: {without} degrees off");
    }
}

#[test]
fn arm_reaches_raised_posture_from_any_hanging_posture() {
    let mut rng = Pcg64::seed_from_u64(77);
    let (mut off, mut impatient_off) = (0, 0);
    for _ in 0..80 {
        let any = random_q(&mut rng);
        let hangs =
            [rng.random_range(-0.5..0.5), 1.55, any[2], rng.random_range(0.1..0.7), rng.random_range(-0.4..0.4)];
        let raised = random_q(&mut rng).into();
        off += u32::from(rises(&hangs, &raised, Weights::default()) > 3.0);
        impatient_off += u32::from(rises(&hangs, &raised, Weights { patience: 0.0, ..Weights::default() }) > 3.0);
    }
    println!("of 80 arms {off} are more than 3 degrees off after 4 s, {impatient_off} without patience");
    assert!(off <= 1, "{off} of 80 arms do not arrive");
    assert!(impatient_off >= 4, "patience is for nothing: {impatient_off} of 80 do not arrive without");
}

#[test]
fn solid_arm_reaches_clear_raised_posture_from_clear_hanging_posture() {
    let (model, mut rng) = (model(), Pcg64::seed_from_u64(78));
    let is_clear = |q: &[f64; LIMB_JOINTS]| clearance_m(&model, &posture(&model, q), true) > 0.03;
    let (mut off, mut arms) = (0, 0);
    while arms < 60 {
        let any = random_q(&mut rng);
        let hangs = [rng.random_range(-0.5..0.5), 1.2, any[2], rng.random_range(0.1..0.7), rng.random_range(-0.4..0.4)];
        let raised: [f64; LIMB_JOINTS] = random_q(&mut rng).into();
        if is_clear(&hangs) && is_clear(&raised) {
            arms += 1;
            off += u32::from(arrives(Robot::solid(&hangs, Weights::default()), &raised) > 3.0);
        }
    }
    println!("of {arms} solid arms {off} are more than 3 degrees off after 4 s");
    assert!(off <= 2, "{off} of {arms} arms do not arrive");
}

/// RMS of the joints' and of the limbs' deviations from their means, degrees, for a person who stands with noise.
fn noisy(stands: [f64; LIMB_JOINTS], noise_deg: f64) -> [f64; 2] {
    let person = arm().limbs(&ArmVector::from(stands));
    let mut rng = Pcg64::seed_from_u64(21);
    let mut robot = Robot::at(&stands, Weights::default());
    let first = robot.next_first();
    // Each node is seen once, with its own noise.
    let seen: Vec<Limbs> = (0..600)
        .map(|_| Limbs {
            upper: turned(&mut rng, &person.upper, noise_deg.to_radians()),
            fore: turned(&mut rng, &person.fore, noise_deg.to_radians()),
        })
        .collect();
    let mut joints = Vec::new();
    for tick in 0..10 * TICK_HZ {
        // Retargeting turns that noise into 1.9 degrees RMS of the joints there (see the tests of `retarget`).
        robot.propose(&stands.map(|q| q + 3.3_f64.to_radians() * rng.random_range(-1.0..1.0)));
        robot.step(|node| [seen[(node - first) as usize]; 2]);
        if tick >= TICK_HZ {
            joints.push(robot.arm(0));
        }
    }
    let mean = joints.iter().sum::<ArmVector>() / joints.len() as f64;
    let squares: f64 = joints.iter().map(|q| (q - mean).norm_squared()).sum();
    let off: f64 = joints.iter().map(|q| arm().angles(q, &person).iter().map(|a| a * a).sum::<f64>()).sum();
    let rms = |sum: f64, numbers: usize| (sum / (joints.len() * numbers) as f64).sqrt().to_degrees();
    [rms(squares, LIMB_JOINTS), rms(off, 2)]
}

#[test]
fn joints_near_gimbal_lock_move_less_than_input_noise() {
    const NOISE_DEG: f64 = 0.5;
    // The upper arm hangs, where joints 1 and 3 turn about one line. One elbow is straight in addition.
    for elbow in [0.0, 0.3, 1.2] {
        for below in [0.0, 0.02, 0.1] {
            let hangs = [0.2, FRAC_PI_2 - 2e-3 - below, FRAC_PI_2, elbow, 0.1];
            let [joints, limbs] = noisy(hangs, NOISE_DEG);
            println!("elbow {elbow}, {below} rad from hanging: joints {joints:.3} degrees RMS, limbs {limbs:.3}");
            assert!(joints < NOISE_DEG, "joints move by {joints} degrees RMS for {NOISE_DEG} degrees of noise");
        }
    }
}

#[test]
fn aims_stay_continuous_when_person_jumps() {
    // The person jumps with both arms at any tick. The aims' positions and velocities do not jump.
    let mut robot = Robot::at(&FREE, Weights::default());
    let postures = [[0.9, -0.4, 2.2, 1.6, -0.7], [-0.5, 0.9, 0.9, 0.4, 0.9], [1.3, 1.2, 3.0, 0.1, 1.9]];
    for tick in 0..6 * TICK_HZ {
        let goal = &postures[(tick / 701 % 3) as usize];
        let (q, v) = (robot.q, robot.v);
        robot.propose(goal);
        let person = arm().limbs(&ArmVector::from(*goal));
        let output = robot.step(|_| [person; 2]);
        for (j, aim) in output.aims.iter().enumerate() {
            let Some(aim) = aim else { continue };
            assert!(aim.a.abs() <= A_MAX && aim.v.abs() <= V_MAX + 1e-9, "tick {tick}, joint {j}: {aim:?}");
            assert!((aim.v - v[j] - aim.a * TICK_S).abs() < 1e-9, "tick {tick}, joint {j}: {} to {aim:?}", v[j]);
            let moved = v[j] * TICK_S + 0.5 * aim.a * TICK_S * TICK_S;
            assert!((aim.q - q[j] - moved).abs() < 1e-9, "tick {tick}, joint {j}: {} to {aim:?}", q[j]);
        }
    }
}

#[test]
fn aim_restarts_at_command_that_stands_still() {
    // Something is in the way: the command stands still, whatever the aim is.
    let mut robot = Robot::at(&FREE, Weights::default());
    let goal = [0.9, -0.4, 2.2, 1.6, -0.7];
    let person = arm().limbs(&ArmVector::from(goal));
    robot.propose(&goal);
    let q = robot.q;
    let mut farthest = 0.0_f64;
    for _ in 0..TICK_HZ {
        let output = robot.step(|_| [person; 2]);
        (robot.q, robot.v) = (q, [0.0; messages::JOINTS_MAX]);
        for (aim, q) in output.aims.iter().zip(&q) {
            farthest = farthest.max(aim.map_or(0.0, |aim| (aim.q - q).abs()));
        }
    }
    // An arm's turn comes every ten ticks, and its result is valid four ticks later. So the aim is ahead by no
    // more than its motion until the next plan.
    assert!(farthest < 0.1, "aims ran {farthest} rad away");
    assert!(farthest > 1e-3, "and they do aim at something");
}

#[test]
fn both_hands_that_touch_go_to_their_places() {
    let model = model();
    let limbs = [0, 1].map(|side| Arm::from_model(&model, side).limbs(&ArmVector::from(FREE)));
    let place = Arm::from_model(&model, 0).hand_center(&ArmVector::from(FREE.map(|q| q + 0.1))).cast::<f32>();
    let off_m = |weight: f32| {
        let mut robot = Robot::at(&FREE, Weights::default());
        robot.places = [[place.x, place.y, place.z, weight], [place.x, -place.y, place.z, weight]];
        (0..TICK_HZ).for_each(|_| {
            robot.step(|_| limbs);
        });
        [0, 1].map(|side| (Arm::from_model(&model, side).hand_center(&robot.arm(side)) - place.cast()).norm())
    };
    let (without_m, with_m) = (off_m(0.0), off_m(1.0));
    assert!(
        (0..2).all(|side| with_m[side] < 0.3 * without_m[side]),
        "{with_m:?} m off, {without_m:?} without a weight"
    );
}
