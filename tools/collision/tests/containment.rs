//! Fitted capsules contain their points, the check detects when they do not, and proofs are right.

use collision::check::sticks_out_m;
use collision::content::Content;
use collision::fit::{Shape, smallest_capsule};
use collision::plan::{Cut, Plan};
use collision::prove::{Verdict, clearance, prove};
use collision::scene::Scene;
use collision::split::{Matter, split};
use collision::write::fit_all;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use robot::{Capsule, Frames, Model, Pose};

const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");

/// A box, a cylinder and a sphere on two sides of a base, with one finger below.
const TOY: &str = include_str!("toy.urdf");

const TOY_PLAN: &str = include_str!("toy_plan.toml");

#[test]
fn capsule_fitted_to_capsule_points_contains_them_tightly() {
    let (a, b, r) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.2, 0.1, 0.1), 0.06);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let points: Vec<Vector3<f64>> = (0..3_000)
        .map(|_| {
            let around = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0_f64)).normalize();
            a + (b - a) * rng.random_range(0.0..1.0) + around * r
        })
        .collect();
    let found = smallest_capsule(&points, 0.0).unwrap();
    let wanted = Shape { a, b, radius_m: r };
    assert!(points.iter().all(|point| found.outside_m(point) < 1e-12));
    assert!(found.volume_m3() < 1.05 * wanted.volume_m3(), "{found:?}");
}

#[test]
fn fitted_capsules_contain_primitives_and_thinner_ones_do_not() {
    let robot = urdf_rs::read_from_string(TOY).unwrap();
    let plan = Plan::parse("toy", TOY_PLAN).unwrap();
    let scene = Scene::new(&robot, None, &plan.fingers);
    let capsules = fit_all(&plan, &scene).unwrap();
    assert_eq!(capsules.len(), 3 + 2 * 2);
    for link in ["base", "arm_left", "arm_right"] {
        let own: Vec<_> = capsules.iter().filter(|capsule| capsule.link == link).collect();
        let shapes: Vec<Shape> = own.iter().map(|capsule| capsule.shape).collect();
        for capsule in &own {
            assert!(sticks_out_m(&capsule.content.matter, &shapes) <= 0.0, "{}", capsule.name);
        }
        let thin: Vec<Shape> = shapes.iter().map(|s| Shape { radius_m: s.radius_m - 2.5e-3, ..*s }).collect();
        let out =
            own.iter().map(|capsule| sticks_out_m(&capsule.content.matter, &thin)).fold(f64::NEG_INFINITY, f64::max);
        assert!(out > 1e-4, "{link}: {out}");
    }
}

#[test]
fn capsules_of_a_cut_part_leave_no_hole() {
    let robot = urdf_rs::read_from_string(TOY).unwrap();
    let plan = Plan::parse("toy", TOY_PLAN).unwrap();
    let scene = Scene::new(&robot, None, &plan.fingers);
    let matter = scene.matter(&plan.groups[0]).unwrap();
    let cut = Cut { part: 0, normal: [1.0, 0.0, 0.0], offset_m: 0.05 };
    let cells = split(matter.clone(), 2, &[cut], 0.0);
    // A small margin, as always. Exactly at the cut both capsules only touch.
    let shapes: Vec<Shape> =
        cells.iter().map(|cell| Shape { radius_m: cell.shape.radius_m + 1e-3, ..cell.shape }).collect();
    assert!(sticks_out_m(&matter, &shapes) <= 0.0);
    // Corners alone are not enough. Two capsules at the ends contain all corners, but not the middle.
    let ends: Vec<Shape> = [-0.2, 0.2]
        .map(|x| Shape { a: Vector3::new(x, -0.15, 0.1), b: Vector3::new(x, 0.15, 0.1), radius_m: 0.11 })
        .to_vec();
    let points = matter.points();
    assert!(points.iter().all(|point| ends.iter().any(|end| end.outside_m(point) < 0.0)));
    assert!(sticks_out_m(&matter, &ends) > 0.0);
}

fn shipped() -> Model {
    Model::from_text("tiago_dual.toml", TOML, "tiago_dual.urdf", URDF).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn proofs_are_never_contradicted_by_samples() {
    let model = shipped();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(9);
    let ball = |body: usize, at: [f64; 3], radius_m: f64| {
        let a = Vector3::from(at);
        Capsule { name: "ball".into(), body, a, b: a * 0.5, radius_m }
    };
    let (mut clear, mut meets) = (0, 0);
    for _ in 0..60 {
        let mut random = || [(); 3].map(|()| rng.random_range(-0.15..0.15));
        let (first, second) = (ball(4, random(), 0.04), ball(6, random(), 0.04));
        let verdict = prove(&model, &first, &second, 0.012);
        let mut frames = Frames::default();
        let mut least = f64::INFINITY;
        for _ in 0..2_000 {
            let q = std::array::from_fn(|j| rng.random_range(model.limits[j].q_min..model.limits[j].q_max));
            model.forward(&q, &mut frames);
            least = least.min(clearance(&frames, &first, &second));
        }
        match verdict {
            Verdict::Clear { at_least_m } => {
                assert!(at_least_m > 0.012 && least >= at_least_m, "{least} {at_least_m}");
                clear += 1;
            }
            Verdict::Meets { clearance_m } => {
                assert!(clearance_m <= 0.012);
                meets += 1;
            }
            Verdict::Open => {}
        }
    }
    assert!(clear > 5 && meets > 5, "{clear} {meets}");
}

/// Rough hulls inside the whole ones decide faster, and in the same way.
#[test]
fn distance_by_rough_hulls_keeps_both_bounds() {
    let mut rng = rand_pcg::Pcg64::seed_from_u64(4);
    let mut sphere = |count: usize| -> Vec<Vector3<f64>> {
        (0..count).map(|_| Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize() * 0.1).collect()
    };
    let points = [sphere(3000), sphere(700)];
    let wholes = points.each_ref().map(|points| robot::Hull::new(points).unwrap());
    let contents = points.map(|points| Content::new(Matter { surface: Vec::new(), pieces: vec![points] }));
    let here = Pose::identity();
    let [a, b] = contents.each_ref().map(|content| content.solid(&here).unwrap());
    for step in 0..60 {
        let there = Pose { t: Vector3::new(0.005 * f64::from(step), 0.03, -0.02), ..here };
        let exact_m = wholes[0].distance_m(&here, &wholes[1], &there);
        for [least_m, enough_m] in [[0.0005, 0.02], [0.01, 0.04], [f64::NEG_INFINITY, 0.03]] {
            let value_m = a.distance_m(&here, b, &there, [least_m, enough_m]);
            if exact_m > enough_m {
                assert!(value_m > enough_m && value_m < exact_m + 1e-6, "{value_m} for {exact_m} m");
            } else if least_m.is_infinite() {
                assert!((value_m - exact_m).abs() < 1e-6, "{value_m} for {exact_m} m");
            } else if exact_m > least_m {
                assert!(value_m > least_m && value_m <= enough_m, "{value_m} for {exact_m} m");
            } else {
                assert!(value_m <= least_m, "{value_m} for {exact_m} m");
            }
        }
        let axis = there.t.normalize();
        let far_m = a.cloud.farthest_m(&axis, &there.t);
        let brute_m = wholes[0].corners().iter().map(|p| axis.cross(&(p - there.t)).norm()).fold(0.0, f64::max);
        assert!((far_m - brute_m).abs() < 1e-12, "{far_m} for {brute_m} m");
    }
}
