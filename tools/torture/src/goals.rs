//! Counts how many collision-free random postures the robot reaches through both stages.

use crate::figures::Goals;
use crate::stages::{Stages, Subject};
use messages::{ALL_JOINTS, JOINTS_MAX, JointMotion, TICK_HZ, deadline};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use report::derived_seed;
use safety::engage::Permit;

/// Goals that one job visits in sequence, from home.
pub const PART_GOALS: u64 = 12;

/// Longest time to reach a goal, ticks: 8 s.
const PATIENCE: u64 = 8 * TICK_HZ;

/// Sends the robot to `goals` goals of part `part`, and home again after each.
pub fn run(subject: &Subject, seed: u64, part: u64, goals: u64) -> Goals {
    let mut rng = Pcg64::seed_from_u64(derived_seed(seed, part));
    let model = &subject.model;
    let mut stages = Stages::at_rest(subject, model.home);
    let (mut k, mut out) = (TICK_HZ, Goals::default());
    while out.goals < goals {
        let mut q = subject.robot.posture(&mut rng);
        // A lift is too slow to cross its whole range in 8 s. The body does not matter here.
        q[..model.body_count].copy_from_slice(&model.home[..model.body_count]);
        if !wbc::certify_rest(&subject.wbc, &q).0 {
            continue;
        }
        out.goals += 1;
        out.reached += u64::from(go(&mut stages, &mut k, &q));
        out.returned += u64::from(go(&mut stages, &mut k, &model.home));
    }
    out
}

fn go(stages: &mut Stages<'_>, k: &mut u64, q: &[f64; JOINTS_MAX]) -> bool {
    let target = wbc::Target { q, dq: &[0.0; JOINTS_MAX], ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
    (0..PATIENCE).any(|_| {
        *k += 1;
        let (out, _) = stages.tick(*k, deadline(*k), Some(target), Permit::Follow { speed_scale: 1.0 });
        out.proposed.on_target && standing(&out.motion)
    })
}

fn standing(motion: &JointMotion) -> bool {
    motion.v.iter().chain(&motion.a).all(|x| *x == 0.0)
}
