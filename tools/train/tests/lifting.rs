//! The lifter's loss, its draws, and a short training.

use layouts::{DIRECTIONS, LIFTER_OUTPUTS, Lifter};
use nalgebra::Vector3;
use rand::RngExt;
use rand_pcg::Pcg64;
use train::lifting::{Pair, Pairs, People, begin, directions, draw, judge, loss, step};

/// A person who faces the camera, m, y up: arms in front at random, as the network's points.
fn body(rng: &mut Pcg64) -> [Vector3<f64>; 27] {
    let mut body = [Vector3::new(0.0, 1.6, 0.1); 27];
    let mut set = |point: usize, x: f64, y: f64, z: f64| {
        body[point] = Vector3::new(x, y, z);
        body[point + 1] = Vector3::new(-x, y, z);
    };
    for (point, x, y, z) in [(1, 0.03, 1.64, 0.08), (3, 0.08, 1.62, 0.0), (5, 0.18, 1.4, 0.0), (17, 0.1, 0.9, 0.0)] {
        set(point, x, y, z);
    }
    for (point, x, y, z) in [(19, 0.1, 0.5, 0.0), (21, 0.1, 0.1, 0.0), (23, 0.1, 0.05, -0.05), (25, 0.1, 0.02, 0.12)] {
        set(point, x, y, z);
    }
    for side in 0..2 {
        let mut at = body[5 + side];
        for (point, long) in [(7, 0.28), (9, 0.25)] {
            let aim =
                Vector3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(0.0..1.0));
            at += aim.normalize() * long;
            body[point + side] = at;
        }
        for (n, point) in [11, 13, 15].into_iter().enumerate() {
            body[point + side] = at + Vector3::new(0.02 * n as f64 - 0.02, 0.0, 0.08);
        }
    }
    body
}

fn people(count: usize) -> People {
    let mut rng = Pcg64::new(5, 5);
    People::new((0..count).map(|_| body(&mut rng)).collect(), vec![(1.0, 0, count)])
}

#[test]
fn gradient_of_loss_matches_differences() {
    let mut rng = Pcg64::new(1, 2);
    for _ in 0..50 {
        let truth: [Vector3<f64>; DIRECTIONS] =
            std::array::from_fn(|_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize());
        let outputs: Vec<f32> = (0..LIFTER_OUTPUTS).map(|_| rng.random_range(-2.0..2.0)).collect();
        let mut gradient = vec![0.0; LIFTER_OUTPUTS];
        loss(&outputs, &truth, 1.0, &mut gradient);
        for i in 0..LIFTER_OUTPUTS {
            let at = |step: f32| {
                let mut moved = outputs.clone();
                moved[i] += step;
                loss(&moved, &truth, 1.0, &mut [0.0; LIFTER_OUTPUTS]).0
            };
            let want = (at(1e-3) - at(-1e-3)) / 2e-3;
            assert!((f64::from(gradient[i]) - want).abs() < 2e-2 * want.abs().max(1.0), "{i}: {} {want}", gradient[i]);
        }
    }
}

#[test]
fn drawn_image_has_the_directions_of_its_person() {
    let people = people(200);
    let (mut rng, mut rows) = (Pcg64::new(3, 3), 0);
    for _ in 0..500 {
        let view = draw(&people, None, &mut rng);
        let [across, up] = [view.directions[6], view.directions[7]];
        assert!(across.dot(&up).abs() < 1e-9 && view.directions.iter().all(|d| (d.norm() - 1.0).abs() < 1e-9));
        // The person's up is up in the image: y points down.
        assert!(up.y < 0.0, "{up}");
        rows += usize::from(view.inputs.iter().all(|x| x.is_finite()));
    }
    assert_eq!(rows, 500);
}

#[test]
fn short_training_halves_the_error_of_guessing() {
    let people = people(3_000);
    let mut fit = begin(300, 1);
    let first = step(&mut fit, &people, None);
    let last: f64 = (0..299).map(|_| step(&mut fit, &people, None)).skip(279).sum::<f64>() / 20.0;
    assert!(last < 0.6 * first, "{first} to {last} degrees");
    // On images whose points are true the network is better still, and knows in which ones it is.
    let mut rng = Pcg64::new(9, 9);
    let pairs: Vec<Pair> = (0..400).map(|_| Pair::seen_well(&body(&mut rng))).collect();
    let own = directions(&pairs[0].truth);
    assert!((own[7] - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-9, "{}", own[7]);
    let pairs = Pairs { clips: vec![("clip".into(), pairs)] };
    let judged = judge(&pairs, Some(&Lifter::new(&fit.layers())));
    assert!(judged.mean_deg < 35.0 && judged.halves_deg[0] < judged.halves_deg[1], "{judged}");
    assert!(judge(&pairs, None).mean_deg < 1e-4, "the truth itself");
}
