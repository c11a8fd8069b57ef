//! Tests the distance of segments against parry, brute force and itself.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{segment_distance, segment_distance_oracle};

fn random(rng: &mut rand_pcg::Pcg64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0))
}

#[test]
fn segment_distance_matches_parry_on_random_segments() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(11);
    for _ in 0..20_000 {
        let [a0, a1, b0, b1] = [(); 4].map(|()| random(&mut rng));
        let ours = segment_distance(&a0, &a1, &b0, &b1).distance_m;
        let theirs = segment_distance_oracle(&a0, &a1, &b0, &b1);
        assert!((ours - theirs).abs() < 1e-9, "{ours} {theirs}");
    }
}

#[test]
fn segment_distance_is_never_above_distance_of_grid_points() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(12);
    for case in 0..2_000 {
        let [a0, a1, b0, mut b1] = [(); 4].map(|()| random(&mut rng));
        let mut a1 = a1;
        match case % 4 {
            // Nearly parallel, exactly parallel, and points.
            0 => b1 = b0 + (a1 - a0) * 0.7 + random(&mut rng) * 1e-9,
            1 => b1 = b0 - (a1 - a0),
            2 => (a1, b1) = (a0, if case % 8 == 2 { b0 } else { b1 }),
            _ => {}
        }
        let found = segment_distance(&a0, &a1, &b0, &b1);
        let at = |s: f64, t: f64| ((a0 + (a1 - a0) * s) - (b0 + (b1 - b0) * t)).norm();
        assert!((at(found.s, found.t) - found.distance_m).abs() < 1e-12);
        assert!((0.0..=1.0).contains(&found.s) && (0.0..=1.0).contains(&found.t));
        let grid = 60;
        for i in 0..=grid {
            for j in 0..=grid {
                let (s, t) = (f64::from(i) / f64::from(grid), f64::from(j) / f64::from(grid));
                assert!(found.distance_m <= at(s, t) + 1e-9, "case {case}: {} {}", found.distance_m, at(s, t));
            }
        }
        let swapped = segment_distance(&b0, &b1, &a0, &a1).distance_m;
        assert!((swapped - found.distance_m).abs() < 1e-9);
    }
}
