//! Tests the bound B on the acceleration of a body's points against finite differences, on random chains of
//! revolute and prismatic joints.

use crate::support::{JOINTS, SEVEN_JOINTS};
use messages::JOINTS_MAX;
use nalgebra::{Rotation3, UnitVector3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::chain::{KinematicChain, KinematicLink, Placement};
use wbc::geometry::{BodyCapsule, Geometry};
use wbc::trajectory::Swing;

fn vector(rng: &mut Pcg64, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..=size))
}

/// One serial chain. The offsets of joints that do not matter here are zero.
fn links(rng: &mut Pcg64) -> [KinematicLink; JOINTS_MAX] {
    let straight = rng.random_bool(0.3);
    std::array::from_fn(|j| {
        let mut axis = UnitVector3::new_normalize(vector(rng, 1.0) + Vector3::new(1e-3, 0.0, 0.0));
        let mut turn = Rotation3::new(vector(rng, 3.0));
        let mut offset = vector(rng, 0.3);
        if straight {
            // The chain is stretched out in a plane, where the bound is attained.
            (axis, turn, offset) = (Vector3::z_axis(), Rotation3::identity(), Vector3::new(0.3, 0.0, 0.0));
        }
        let prismatic = rng.random_bool(0.3);
        if straight && prismatic {
            axis = Vector3::y_axis();
        }
        KinematicLink {
            parent: j,
            parent_from_body: Placement { r: turn.into_inner(), t: offset },
            axis: axis.into_inner(),
            prismatic,
            stroke: 0.2,
        }
    })
}

#[test]
fn curve_bound_is_never_below_point_acceleration() {
    let mut rng = Pcg64::seed_from_u64(11);
    let (mut worst, mut worst_mixed) = (0.0_f64, 0.0_f64);
    for _ in 0..20_000 {
        let links = links(&mut rng);
        let body = rng.random_range(1..=JOINTS);
        let point = vector(&mut rng, 0.2);
        let capsule = BodyCapsule { body, a: point, b: point, radius_m: 0.01 };
        let chain = KinematicChain::new(&links, SEVEN_JOINTS).unwrap();
        let geometry = Geometry::new(chain.clone(), &[capsule], &[], 0.01).unwrap();
        let moving: Vec<usize> = (0..rng.random_range(1..4)).map(|_| rng.random_range(0..body)).collect();
        let mut pick = |size: f64| -> [f64; JOINTS_MAX] {
            std::array::from_fn(|j| if moving.contains(&j) { rng.random_range(-size..=size) } else { 0.0 })
        };
        let still = pick(0.2);
        let (v, a) = (pick(2.0), if worst > 0.5 { pick(4.0) } else { [0.0; JOINTS_MAX] });
        let swings = std::array::from_fn(|j| Swing { v: v[j].abs(), a: a[j].abs(), path: 0.0 });
        let (bound, _) = geometry.curve_bound(0, &swings);
        let at = |t: f64| {
            let q = std::array::from_fn(|j| still[j] + v[j] * t + a[j] * t * t / 2.0);
            let mut placements = [Placement::identity(); JOINTS_MAX + 1];
            chain.forward(&q, (1 << JOINTS_MAX) - 1, &mut placements);
            placements[body].point(&point)
        };
        let h = 1e-4;
        let acceleration = ((at(h) - at(0.0)) - (at(0.0) - at(-h))).norm() / (h * h);
        // The difference quotient has an error of its own: rounding 1e-16 / h^2, and fourth derivatives times h^2.
        assert!(acceleration <= bound * (1.0 + 1e-5) + 1e-5, "{acceleration} > {bound}");
        if bound > 0.1 {
            worst = worst.max(acceleration / bound);
            let slides = moving.iter().any(|&j| links[j].prismatic) && moving.iter().any(|&j| !links[j].prismatic);
            if slides {
                worst_mixed = worst_mixed.max(acceleration / bound);
            }
        }
    }
    // Without one of the terms of B, these ratios would exceed 1.
    assert!(worst > 0.9 && worst_mixed > 0.9, "never near the bound: {worst} {worst_mixed}");
}
