//! Checks what the capsules represent. The manufacturer's collision meshes stay apart while the robot is attacked. The
//! test runs only if the meshes are present.

use driver::PlanPlayback;
use judge::{Attacker, Meshes};
use messages::{JOINTS_MAX, JointMotion, deadline};
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::path::Path;
use torture::cli::Changes;
use torture::stages::{Stages, Subject, permit, target};

const TICKS: u64 = 30_000;
/// Ticks between two judgements of a posture and of the end of its plan: 30 ms.
const EVERY: u64 = 45;

/// Returns the posture at which the plan of a command rests.
fn rest(motion: &JointMotion) -> [f64; JOINTS_MAX] {
    let mut motion = *motion;
    motion.play(u64::MAX);
    motion.q
}

/// Returns the least distance over an attack.
fn attack(subject: &Subject, meshes: &Meshes, seed: u64, ticks: u64) -> (f64, String) {
    let mut stages = Stages::at_rest(subject, subject.model.home);
    let mut attacker = Attacker::new(&subject.robot, Pcg64::seed_from_u64(seed));
    let (mut q, mut least) = (subject.model.home, (f64::INFINITY, String::new()));
    for k in 1..=ticks {
        attacker.next(k, &q);
        let (out, _) = stages.tick(k, deadline(k), target(&attacker), permit(&attacker));
        q = out.motion.q;
        if k.is_multiple_of(EVERY) {
            meshes.nearest(&q, &mut least);
            meshes.nearest(&rest(&out.motion), &mut least);
        }
    }
    least
}

#[test]
#[ignore = "needs the manufacturer's meshes in ../shared/robots/tiago_dual"]
fn meshes_under_attack_stay_apart_only_with_certificate() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let load = |changes| Subject::load(&config, None, changes).unwrap();
    let subject = load(Changes::default());
    let meshes = Meshes::read(&subject.model.joint_names);
    let [pieces, pairs] = meshes.counts();
    assert!(pieces > 20 && pairs > 200, "{pieces} {pairs}");
    let (least_m, pair) = attack(&subject, &meshes, 3, TICKS);
    println!("{pieces} meshes, {pairs} pairs: least distance {:.2} mm, {pair}", least_m * 1e3);
    assert!(least_m > 0.0, "{pair} touch");
    let without = load(Changes { no_certificate: true, ..Changes::default() });
    let (without_m, pair) = attack(&without, &meshes, 3, TICKS);
    assert!(without_m == 0.0, "without the certificate nothing touched: {without_m} m, {pair}");
}
