//! Definitions of the columns, on sequences with known figures.

use crate::methods::arm;
use eval::clips::{Clip, Human};
use eval::methods::Posture;
use eval::metrics::{MethodFigures, Task, measure, near_gimbal};
use nalgebra::UnitQuaternion;
use retarget::{ArmModel, ArmQ};

const FRAMES: usize = 60;

/// A smooth posture within the limits and away from the gimbal.
fn posture(arm: &ArmModel, frame: usize, amplitude: f64) -> Posture {
    let (mid, half) = (arm.mid(), arm.half());
    let side = |phase: f64| -> ArmQ {
        std::array::from_fn(|j| mid[j] + amplitude * half[j] * (0.11 * frame as f64 + phase + j as f64).sin())
    };
    [side(0.0), side(1.0)]
}

fn humans(arm: &ArmModel, postures: &[Posture]) -> Vec<Human> {
    postures.iter().map(|both| both.each_ref().map(|q| arm.forward(q))).collect()
}

/// A clip of these limbs, with the oracle's postures.
fn task(human: &[Human], oracle: &[Posture]) -> Task {
    let clip = Clip { name: String::new(), rate_hz: 60.0, human: human.to_vec(), positions: Vec::new() };
    Task { clip, oracle: oracle.to_vec() }
}

fn figures(arm: &ArmModel, human: &[Human], oracle: &[Posture], postures: &[Posture]) -> MethodFigures {
    measure([arm; 2], &[task(human, oracle)], &[postures.to_vec()])
}

fn some(value: Option<f64>) -> f64 {
    value.expect("the figure is defined")
}

#[test]
fn oracle_against_itself_has_no_error_and_jerk_ratio_one() {
    let arm = arm();
    let oracle: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.3)).collect();
    let figures = figures(&arm, &humans(&arm, &oracle), &oracle, &oracle);
    assert!(figures.s_gr < 1e-12 && figures.limb_deg_mean < 1e-5 && figures.direction_deg < 1e-5);
    assert_eq!(figures.joint_mse_rad2, Some(0.0));
    assert_eq!(figures.jerk_ratio, Some(1.0));
    assert_eq!(figures.flips_per_1000, Some(0.0));
    assert_eq!(figures.reachable_share, 1.0);
}

#[test]
fn joint_error_excludes_frames_near_the_gimbal() {
    let arm = arm();
    let mut oracle: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.3)).collect();
    let mut postures = oracle.clone();
    for (frame, (best, q)) in oracle.iter_mut().zip(&mut postures).enumerate() {
        if frame % 2 == 0 {
            best[0][1] = 87_f64.to_radians();
            assert!(near_gimbal(&arm, &best[0]));
            q[0] = best[0];
            q[0][0] += 1.0;
        } else {
            assert!(!near_gimbal(&arm, &best[0]));
            q[0][3] += 0.1;
        }
    }
    let figures = figures(&arm, &humans(&arm, &oracle), &oracle, &postures);
    // Half of the left arm's frames are masked: 0.01 over 5 joints in 30 of 90 frames of an arm.
    assert!((some(figures.joint_mse_rad2) - 0.01 / 5.0 / 3.0).abs() < 1e-12, "{:?}", figures.joint_mse_rad2);
    assert!((some(figures.joint_mse_all_rad2) - (0.01 + 1.0) / 5.0 / 4.0).abs() < 1e-12);
}

#[test]
fn doubled_motion_doubles_jerk_and_jumps_count_separately() {
    let arm = arm();
    let oracle: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.2)).collect();
    let mut twice: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.4)).collect();
    let human = humans(&arm, &oracle);
    assert!((some(figures(&arm, &human, &oracle, &twice).jerk_ratio) - 2.0).abs() < 1e-9);
    twice[30][1][0] += 1.0;
    let with_jump = figures(&arm, &human, &oracle, &twice);
    let between = some(with_jump.jerk_ratio);
    assert!((between - 2.0).abs() < 0.1, "{between}");
    assert!(some(with_jump.jerk_ratio_with_jumps) > 10.0, "{:?}", with_jump.jerk_ratio_with_jumps);
    // One arm jumps there and back.
    let flips = 2.0 * 1000.0 / (2.0 * (FRAMES - 1) as f64);
    assert!((some(with_jump.flips_per_1000) - flips).abs() < 1e-9);
}

#[test]
fn joint_jump_during_a_jump_of_the_human_is_no_flip() {
    let arm = arm();
    let oracle: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.2)).collect();
    let mut postures = oracle.clone();
    postures[30][0][0] += 1.0;
    let mut human = humans(&arm, &oracle);
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.2);
    human[30][0].upper = turn * human[30][0].upper;
    assert_eq!(figures(&arm, &human, &oracle, &postures).flips_per_1000, Some(0.0));
}

#[test]
fn frame_counts_as_reachable_only_if_the_oracle_reaches_it() {
    let arm = arm();
    let oracle: Vec<Posture> = (0..FRAMES).map(|i| posture(&arm, i, 0.2)).collect();
    let mut human = humans(&arm, &oracle);
    let (far, near) = (20_f64.to_radians(), 1_f64.to_radians());
    for (frame, arms) in human.iter_mut().enumerate() {
        let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, if frame < FRAMES / 4 { far } else { near });
        for limbs in arms {
            limbs.upper = turn * limbs.upper;
        }
    }
    let figures = figures(&arm, &human, &oracle, &oracle);
    assert!((figures.reachable_share - 0.75).abs() < 1e-12);
    // One limb of two is off by one degree.
    assert!((some(figures.reachable_deg_mean) - 0.5).abs() < 1e-9);
    assert!((some(figures.reachable_deg_p99) - 1.0).abs() < 1e-9);
    assert!((figures.limb_deg_mean - 0.5 * (0.25 * 20.0 + 0.75)).abs() < 1e-9);
    assert!((figures.by_limb_deg[0] - (5.0 + 0.75)).abs() < 1e-9 && figures.by_limb_deg[1] < 1e-9);
}

#[test]
fn twist_about_the_bone_is_no_error_of_direction() {
    let arm = arm();
    let oracle: Vec<Posture> = (0..4).map(|i| posture(&arm, i, 0.2)).collect();
    let mut human = humans(&arm, &oracle);
    for limbs in human.iter_mut().flatten() {
        limbs.fore *= UnitQuaternion::from_euler_angles(0.0, 0.3, 0.0);
    }
    let figures = figures(&arm, &human, &oracle, &oracle);
    assert!(figures.direction_deg < 1e-5, "{}", figures.direction_deg);
    assert!((figures.limb_deg_mean - 0.15_f64.to_degrees()).abs() < 1e-6);
}
