//! The triangle of three key poses: it goes through its corners, is monotone between them, and gives a person
//! that `ingest` accepts.
#![expect(clippy::needless_range_loop, reason = "corners are clearer by their indices")]

use config::{Loaded, Overrides};
use messages::{RawSkeleton, Stamp};
use motion::{CalibrationMode, LoadOptions};
use poses::pose::read_pose;
use poses::triangle::{POSES, Triangle};
use retarget::{ARMS, ArmModel, ArmQ, Limbs, PRIOR_WEIGHT, features, limb_error_deg, refine};
use robot::{Frames, Model};
use std::path::Path;

fn loaded() -> Loaded {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    config::load(&config, Overrides::default()).expect("the shipped settings")
}

fn triangle(loaded: &Loaded, poses: &[&str]) -> Triangle {
    let poses: Vec<String> = poses.iter().map(|&pose| pose.to_owned()).collect();
    let weights = loaded.weights.as_ref().expect("the shipped weights");
    Triangle::new(&loaded.model, &weights.network, &poses).expect("three poses")
}

fn corner(n: usize) -> [f64; 3] {
    std::array::from_fn(|i| if i == n { 1.0 } else { 0.0 })
}

fn limbs(pose: &str) -> [Limbs; ARMS] {
    read_pose(pose, CalibrationMode::First10s, &LoadOptions::default()).expect("a pose")
}

/// Returns the robot at home, except for the arms' joints 1 to 5.
fn posture(model: &Model, q: &[ArmQ; ARMS]) -> [f64; messages::JOINTS_MAX] {
    let mut all = model.home;
    for (q, arm) in q.iter().zip(&model.arms) {
        arm.set_limbs(q, &mut all);
    }
    all
}

/// Points of the triangle, a `count`th of an edge apart.
fn points(count: u32) -> impl Iterator<Item = [f64; 3]> {
    let share = move |n: u32| f64::from(n) / f64::from(count);
    (0..=count).flat_map(move |a| (0..=count - a).map(move |b| [share(a), share(b), share(count - a - b)]))
}

#[test]
fn triangle_corner_decodes_to_its_own_pose() {
    let loaded = loaded();
    let (arm, network) = (ArmModel::from_model(&loaded.model, 0), &loaded.weights.as_ref().expect("weights").network);
    for poses in [POSES, ["rest", "clap", "box"], ["cross-arms", "wave-left", "point-forward"]] {
        let triangle = triangle(&loaded, &poses);
        assert_eq!(triangle.names(), &poses.map(str::to_owned));
        for (n, pose) in poses.iter().enumerate() {
            let q = triangle.q(&corner(n));
            for (human, q) in limbs(pose).iter().zip(&q) {
                let [start] = network.decode(&network.encode_human(&[features(human)]));
                let want = refine(&arm, human, &start, &start, PRIOR_WEIGHT, 2).q;
                assert!(q.iter().zip(want).all(|(q, want)| (q - want).abs() < 1e-6), "{pose}: {q:?}, not {want:?}");
                let error = limb_error_deg(&arm.forward(q), human);
                // Two steps of refinement leave 2.3 degrees for the worst of the named poses, and 1.1 for the
                // worst of these.
                assert!(error.iter().all(|degrees| *degrees < 1.5), "{pose}: {error:?} degrees from the human's limbs");
            }
        }
    }
}

#[test]
fn default_poses_are_apart_and_every_mix_is_collision_free() {
    let loaded = loaded();
    let (model, triangle) = (&loaded.model, triangle(&loaded, &POSES));
    let mut frames = Frames::default();
    let mut least = f64::INFINITY;
    for shares in points(40) {
        model.forward(&posture(model, &triangle.q(&shares)), &mut frames);
        least = least.min(model.clearance(&frames).0).min(model.obstacle_clearance(&frames).0);
    }
    println!("least clearance {least:.3} m, the robot's is {:.3} m", model.d_min_m);
    assert!(least > model.d_min_m, "{least} m");
    for n in 0..3 {
        let (a, b) = (triangle.q(&corner(n)), triangle.q(&corner((n + 1) % 3)));
        for side in 0..ARMS {
            let apart = a[side].iter().zip(&b[side]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart > 0.5, "{} and the next, side {side}: {apart} rad", POSES[n]);
        }
    }
}

/// Drags a handle at random, four times as fast as pages may. A share changes by a sixtieth per frame.
#[test]
fn ingest_accepts_all_frames_but_the_first_of_a_dragged_handle() {
    let loaded = loaded();
    let triangle = triangle(&loaded, &["hands-on-head", "cross-arms", "point-forward"]);
    let config =
        world::input_config(&loaded.settings.ingest, loaded.layouts.clone(), &loaded.operators, loaded.lifter.clone());
    let (mut state, mut now) = (ingest::State::default(), Stamp(1_000_000_000));
    let mut seed = 11_u64;
    // Knuth's linear congruential generator (MMIX).
    let mut draw = |below: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) % below
    };
    let (mut shares, mut to) = (corner(0), corner(1));
    let mut moved = 0.0_f64;
    for n in 0..7200_u64 {
        if draw(20) == 0 {
            to = corner(draw(3) as usize);
        }
        let before = shares;
        let far = (0..3).map(|i| (to[i] - shares[i]).abs()).fold(0.0, f64::max);
        let step = (1.0 / 60.0 / far.max(1e-12)).min(1.0);
        shares = std::array::from_fn(|i| shares[i] + step * (to[i] - shares[i]));
        now = now.plus_ns(16_666_667);
        let mut raw: RawSkeleton = triangle.raw(&shares, n as f64 / 60.0);
        (raw.header.sequence, raw.header.stamp, raw.header.origin, raw.session_nonce) = (n + 1, now, now, 5);
        let seen = ingest::tick(&config, &mut state, now, &raw).skeleton;
        // The first frame of a session is never used.
        assert!(seen.is_some() || n == 0, "frame {n} at {shares:?}");
        let (a, b) = (triangle.q(&before), triangle.q(&shares));
        moved = a.as_flattened().iter().zip(b.as_flattened()).fold(moved, |most, (a, b)| most.max((a - b).abs()));
    }
    println!("the fastest joint moves by {moved:.3} rad from frame to frame");
    assert!(moved < 0.2, "{moved} rad");
}

#[test]
fn triangle_of_wrong_number_or_unknown_poses_is_refused() {
    let loaded = loaded();
    let network = &loaded.weights.as_ref().expect("weights").network;
    for (poses, expected) in [
        (vec!["t-pose", "rest"], "pose t-pose,rest: 2 poses; a triangle needs 3"),
        (vec!["t-pose", "rest", "clap", "box"], "4 poses"),
        (vec![], "0 poses"),
        (vec!["t-pose", "rest", "headstand"], "pose headstand: must be FILE.bvh:FRAME"),
        (vec!["t-pose", "rest", "missing.bvh@1"], "missing.bvh"),
    ] {
        let poses: Vec<String> = poses.into_iter().map(str::to_owned).collect();
        let error = Triangle::new(&loaded.model, network, &poses).expect_err("is refused").to_string();
        assert!(error.contains(expected), "{error}");
    }
}
