//! Arms keep off the robot where the person's posture would touch it.

use crate::support::{FREE, Robot, arm, clearance_m, model, posture, random_q};
use follow::Weights;
use follow::arm::ArmVector;
use follow::gap::{Gap, Gaps};
use messages::TICK_HZ;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A robot that follows a person at `q` for three seconds.
fn followed(q: ArmVector, weights: Weights) -> Robot {
    let mut robot = Robot::solid(&FREE, weights);
    robot.propose(&q.into());
    let person = arm().limbs(&q);
    for _ in 0..3 * TICK_HZ {
        robot.step(|_| [person; 2]);
    }
    robot
}

#[test]
fn arms_keep_off_the_body_that_the_person_has_not() {
    let (model, mut rng) = (model(), Pcg64::seed_from_u64(23));
    let without = Weights { gap: 0.0, ..Weights::default() };
    let (mut cases, mut clear, mut clear_without) = (0, 0, 0);
    while cases < 16 {
        let q = random_q(&mut rng);
        // The limbs are up to 60 mm inside. The hands have wrists to turn them away.
        if !(-0.06..-0.02).contains(&clearance_m(&model, &posture(&model, &q.into()), false)) {
            continue;
        }
        cases += 1;
        let distance_m = |weights| clearance_m(&model, &followed(q, weights).q, true);
        clear += u32::from(distance_m(Weights::default()) > model.d_min_m);
        clear_without += u32::from(distance_m(without) > 0.0);
    }
    println!("{clear} of {cases} postures are clear, {clear_without} without gaps");
    assert!(clear >= 14 && clear_without <= 4, "{clear} of {cases} are clear, {clear_without} without gaps");
}

#[test]
fn narrowest_gaps_are_kept() {
    let mut rng = Pcg64::seed_from_u64(24);
    let (mut gaps, q) = (Gaps::none(), ArmVector::zeros());
    let mut missing: Vec<f64> = Vec::new();
    for _ in 0..40 {
        let gap = Gap::new(rng.random_range(-0.02..0.005), ArmVector::zeros(), &q);
        missing.push(gap.missing(&q));
        gaps.insert(4, gap);
    }
    missing.sort_by(|a, b| b.total_cmp(a));
    let kept: Vec<f64> = gaps.at_node(follow::NODES - 1).iter().map(|gap| gap.missing(&q)).collect();
    assert!(kept.len() >= 4 && kept == missing[..kept.len()], "{kept:?} of {missing:?}");
    assert!(gaps.at_node(0).is_empty());
}
