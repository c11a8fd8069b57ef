//! Tests the certificate on a motion whose clearance is known: an arm sweeps along an arc past a post just outside it.

use crate::support::{D_MIN_M, SEVEN_JOINTS, parts};
use messages::JOINTS_MAX;
use nalgebra::{Matrix3, Vector3};
use wbc::chain::{KinematicChain, KinematicLink, Placement};
use wbc::geometry::BodyCapsule;
use wbc::interval::Bounds;
use wbc::{Config, JointMotion, JointState, JointStop, Options, Parts, PlannedMotion, certify_plan};

const REACH_M: f64 = 0.5;
const RADIUS_M: f64 = 0.02;
/// The swing is fast and hardly brakes. Nearly all of the acceleration is centripetal, so B is nearly attained.
const BOUNDS: Bounds = Bounds { q_min: -6.0, q_max: 6.0, v_max: 8.0, a_max: 20.0, brake: 20.0, j_max: 4000.0 };

/// Joint 0 turns a carrier, and joint 1 on it swings a ball about the same kind of axis. The post stands on
/// body `post`.
fn robot(post: usize, gap_m: f64, angle: f64) -> Config {
    let link = |j: usize| KinematicLink {
        parent: usize::from(j == 1),
        parent_from_body: Placement { r: Matrix3::identity(), t: Vector3::zeros() },
        axis: Vector3::z(),
        prismatic: false,
        stroke: 6.0,
    };
    let ball = Vector3::new(REACH_M, 0.0, 0.0);
    let away = Vector3::new(angle.cos(), angle.sin(), 0.0) * (REACH_M + 2.0 * RADIUS_M + gap_m);
    let capsule = |body, p| BodyCapsule { body, a: p, b: p, radius_m: RADIUS_M };
    let parts = Parts {
        chain: KinematicChain::new(&(0..17).map(link).collect::<Vec<_>>(), SEVEN_JOINTS).unwrap(),
        controllers: wbc::Controllers::new([(1 << 17) - 1]),
        limits: [BOUNDS; JOINTS_MAX],
        home: [0.0; JOINTS_MAX],
        capsules: vec![capsule(2, ball), capsule(post, away)],
        pairs: vec![[0, 1]],
        ..parts()
    };
    Config::from_parts(parts, Options::default()).unwrap()
}

/// A swing at the highest speed from -0.4 rad, while the carrier turns too.
fn swing(carrier: f64) -> JointMotion {
    let mut planned = JointMotion::rest([0.0; JOINTS_MAX]);
    for (j, q, v) in [(0, 0.3, carrier), (1, -0.4, BOUNDS.v_max)] {
        planned.set_joint(j, JointState { q, v, a: 0.0 }, JointStop::new(v, 0.0, BOUNDS.a_max, BOUNDS.j_max));
    }
    planned
}

#[test]
fn swing_past_post_is_certified_only_with_enough_clearance() {
    for (post, carrier) in [(0, 0.0), (1, 0.0), (1, 5.0)] {
        let planned = swing(carrier);
        let mut tightest = f64::INFINITY;
        // The post stands where the ball passes. Its clearance is the gap, which is known without sampling.
        for angle in [-0.3, -0.2, 0.0, 0.3] {
            // The carrier at rest is turned by 0.3 rad relative to a post on the base.
            let seen = if post == 0 { angle + 0.3 } else { angle };
            for i in -40..=40 {
                let gap = D_MIN_M + f64::from(i) * 1e-4;
                let proved = certify_plan(&robot(post, gap, seen), &planned).blamed.is_none();
                assert!(!proved || gap >= D_MIN_M, "gap {gap} at {angle} was certified on body {post}");
                if proved {
                    tightest = tightest.min(gap);
                }
            }
        }
        assert!(tightest < D_MIN_M + 2e-3, "post on {post}, carrier {carrier}: nothing below {tightest} was proved");
    }
}
