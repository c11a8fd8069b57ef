//! Tests the bound between samples against dense samples.

use super::*;
use crate::interval::Bounds;
use crate::plan::{JointStop, PlannedMotion};
use crate::{Config, Options};
use messages::JointMotion;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const TOML: &str = include_str!("../../../../config/robots/tiago_dual.toml");
const URDF: &str = include_str!("../../../../config/robots/tiago_dual.urdf");

fn shipped() -> Config {
    let model = robot::Model::from_text("tiago_dual.toml", TOML, "tiago_dual.urdf", URDF).unwrap();
    Config::new(&model, Options::default()).unwrap()
}

/// Joints of TIAGo++.
const JOINTS: usize = 17;

/// A state within the limits, with a stop of any strength.
fn state(bounds: &[Bounds; JOINTS_MAX], rng: &mut Pcg64) -> JointMotion {
    let mut planned = JointMotion::rest([0.0; JOINTS_MAX]);
    let still = rng.random_range(0.0..1.0);
    for j in 0..JOINTS {
        let b = &bounds[j];
        let q = rng.random_range(b.q_min..b.q_max);
        if rng.random_bool(still) {
            planned.set_joint(j, JointState { q, v: 0.0, a: 0.0 }, JointStop::default());
            continue;
        }
        let (v, a) = (rng.random_range(-1.0..1.0) * b.v_max, rng.random_range(-1.0..1.0) * b.a_max);
        let brake = b.brake * rng.random_range(0.3..1.0);
        planned.set_joint(j, JointState { q, v, a }, JointStop::new(v, a, brake, b.j_max));
    }
    planned
}

/// Between two samples no torque differs from its chord by more than the bound, wherever the segment lies.
/// The bound is also not so wide that the test shows nothing.
#[test]
fn torques_between_samples_are_within_bound() {
    samples_are_within_the_bound(&[Payload::EMPTY; 2]);
}

/// The same with payloads that hands may carry, far off their axes.
#[test]
fn torques_of_laden_hands_are_within_bound() {
    let center = nalgebra::Vector3::new(0.2, -0.1, 0.4);
    samples_are_within_the_bound(&[Payload { mass_kg: 3.0, center }, Payload { mass_kg: 1.0, center: -center }]);
}

fn samples_are_within_the_bound(payload: &[Payload; 2]) {
    let config = shipped();
    let (mut load, chain) = (config.load.clone().unwrap(), &config.geometry.chain);
    load.carry(payload);
    let mut rng = Pcg64::seed_from_u64(3);
    let all = (1 << JOINTS) - 1;
    let mut closest = [0.0_f64; JOINTS_MAX];
    for _ in 0..4_000 {
        let motion = Trajectory::stops(&state(&config.bounds, &mut rng));
        let t0 = rng.random_range(0.0..0.3);
        let dt = 10.0_f64.powf(rng.random_range(-3.0..-1.0));
        let at = |t: f64| motion.joints.each_ref().map(|joint| joint.at(t));
        let (x0, x1) = (at(t0), at(t0 + dt));
        let arcs = std::array::from_fn(|j| motion.joints[j].arc(t0, t0 + dt, x0[j], x1[j]));
        let [curve, kink] = load.curves.slack(&arcs, all, all, dt);
        let slack: [f64; JOINTS_MAX] = std::array::from_fn(|j| curve[j] + kink[j]);
        let (from, to) = (load.torques(chain, &x0), load.torques(chain, &x1));
        for i in 1..20 {
            let share = f64::from(i) / 20.0;
            let between = load.torques(chain, &at(t0 + share * dt));
            for j in 0..JOINTS {
                let off = (between[j] - from[j] - share * (to[j] - from[j])).abs();
                assert!(off <= slack[j] + 1e-9, "joint {j}: {off} beyond {} in {dt} s", slack[j]);
                if off > 1e-3 * load.limit[j] {
                    closest[j] = closest[j].max(off / slack[j]);
                }
            }
        }
    }
    assert!(closest[4] > 0.2 && closest[6] > 0.2, "{closest:?}");
}

/// A proved motion keeps its limits at a thousand instants. Most motions that are not proved do not keep them.
#[test]
fn proved_motion_keeps_torque_limits_and_most_refused_do_not() {
    let config = shipped();
    let (load, chain) = (config.load.as_ref().unwrap(), &config.geometry.chain);
    let mut scratch = TorqueScratch::new();
    let mut rng = Pcg64::seed_from_u64(4);
    let (mut proved, mut refused, mut needlessly) = (0, 0, 0);
    for _ in 0..2_000 {
        let planned = state(&config.bounds, &mut rng);
        let motion = Trajectory::stops(&planned);
        scratch.begin_tick();
        let mut turned = UNTURNED;
        turn_joints(chain, |j| planned.q[j], chain.all(), &mut turned);
        let verdict = prove(load, chain, (&motion, &turned), (1 << JOINTS) - 1, &mut scratch);
        assert!(verdict.evaluations <= EVALUATIONS_MAX + 2);
        let now = load.torques(chain, &motion.joints.each_ref().map(|joint| joint.at(0.0)));
        let mut kept = true;
        for i in 0..=1_000 {
            let t = motion.end_s() * f64::from(i) / 1_000.0;
            let torques = load.torques(chain, &motion.joints.each_ref().map(|joint| joint.at(t)));
            kept &= (0..JOINTS).all(|j| torques[j].abs() <= load.limit[j].max(now[j].abs()) + 1e-6);
        }
        assert!(kept || verdict.blamed.is_some(), "proved and not kept: {planned:?}");
        proved += u32::from(verdict.blamed.is_none());
        refused += u32::from(verdict.blamed.is_some());
        needlessly += u32::from(verdict.blamed.is_some() && kept);
    }
    assert!(proved > 1_000 && refused > 100, "{proved} proved, {refused} refused");
    assert!(needlessly * 2 < refused, "{needlessly} of {refused}");
}
