//! Shares of the key postures.

use view::Shares;

/// A linear congruential generator (Knuth, MMIX) with values from -2 to 2.
fn draw(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 53) as f64 * 4.0 - 2.0
}

fn is_in_triangle(shares: Shares) -> bool {
    shares.get().iter().all(|&x| (0.0..=1.0 + 1e-9).contains(&x))
        && (shares.get().iter().sum::<f64>() - 1.0).abs() < 1e-9
}

#[test]
fn nearest_share_is_in_triangle_and_non_finite_is_refused() {
    for asked in [[1.0, 0.0, 0.0], [0.25, 0.25, 0.5], [0.0, 0.5, 0.5]] {
        assert_eq!(Shares::nearest(asked).map(Shares::get), Some(asked), "what is in it stays");
    }
    for (asked, becomes) in [
        ([0.0, 0.0, 0.0], [1.0 / 3.0; 3]),
        ([7.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([-1.0, 0.6, 0.6], [0.0, 0.5, 0.5]),
        ([f64::MAX, f64::MIN, 0.0], [1.0, 0.0, 0.0]),
        ([1e300, 1e300, -1e300], [0.5, 0.5, 0.0]),
    ] {
        let found = Shares::nearest(asked).expect("numbers").get();
        assert!(found.iter().zip(becomes).all(|(a, b)| (a - b).abs() < 1e-9), "{asked:?}: {found:?}");
    }
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(Shares::nearest([bad, 0.5, 0.5]), None);
        assert_eq!(Shares::nearest([0.0, 1.0, bad]), None);
    }
    let mut seed = 3;
    for _ in 0..100_000 {
        let asked = [draw(&mut seed), draw(&mut seed), draw(&mut seed)];
        let found = Shares::nearest(asked).expect("numbers");
        assert!(is_in_triangle(found), "{asked:?}: {found:?}");
        // This point is nearest: no step from it into the triangle comes nearer.
        let away = |point: [f64; 3]| -> f64 { point.iter().zip(asked).map(|(a, b)| (a - b).powi(2)).sum() };
        for corner in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            let beside = std::array::from_fn(|i| found.get()[i] + 1e-3 * (corner[i] - found.get()[i]));
            assert!(away(beside) >= away(found.get()) - 1e-12, "{asked:?}: {found:?}");
        }
    }
}

#[test]
fn shares_move_by_one_step_at_most_and_reach_their_goal() {
    let step = 1.0 / 120.0;
    let (mut seed, mut at) = (5, Shares::FIRST);
    for _ in 0..2000 {
        let to = Shares::nearest([draw(&mut seed), draw(&mut seed), draw(&mut seed)]).expect("numbers");
        for _ in 0..1 + (draw(&mut seed).abs() * 60.0) as usize {
            let next = at.toward(to, step);
            let moved = (0..3).map(|i| (next.get()[i] - at.get()[i]).abs()).fold(0.0, f64::max);
            assert!(moved <= step + 1e-12 && is_in_triangle(next), "{at:?} to {next:?}");
            at = next;
        }
    }
    let to = Shares::nearest([0.0, 1.0, 0.0]).expect("numbers");
    let mut at = Shares::FIRST;
    for n in 1..=120 {
        at = at.toward(to, step);
        let along = f64::from(n) / 120.0;
        assert!((at.get()[1] - along).abs() < 1e-9 && at.get()[2] == 0.0, "{n}: {at:?}");
    }
    assert!((at.get()[1] - 1.0).abs() < 1e-9);
    assert_eq!(at.toward(to, step), to, "it arrives, and not only nearly");
}
