//! No tick allocates, whatever its input.

use crate::support::{FREE, LIMB_MASK, Robot, arm, limb_trajectory, random_q};
use follow::Weights;
use follow::arm::ArmVector;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rt::count_allocations;

#[test]
fn tick_with_random_inputs_allocates_nothing() {
    let mut rng = Pcg64::seed_from_u64(77);
    let mut robot = Robot::at(&FREE, Weights::default());
    let mut person = [arm().limbs(&ArmVector::from(FREE)); 2];
    let mut in_ticks = 0;
    for k in 0..10_000 {
        if k % 500 == 0 {
            person = [arm().limbs(&random_q(&mut rng)), arm().limbs(&random_q(&mut rng))];
            robot.valid_mask = if rng.random_bool(0.7) { LIMB_MASK } else { rng.random() };
        }
        let first = robot.next_first();
        let mut trajectory = limb_trajectory(first, |_| person);
        if k % 7 == 0 {
            trajectory[rng.random_range(0..24)] = [[f32::NAN; 4]; 4];
        }
        let missed = if k % 11 == 0 { rng.random_range(1..40) } else { 1 };
        in_ticks += count_allocations(|| robot.step_after(missed, &trajectory, first)).1.allocated;
    }
    assert_eq!(in_ticks, 0);
    assert!(count_allocations(|| Box::new(1)).1.allocated > 0, "the counter counts");
}
