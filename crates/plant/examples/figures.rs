//! Prints how well the plant follows commands and how long its steps take:
//! `cargo run --release -p plant --example figures`.

#[path = "../tests/support/mod.rs"]
#[allow(dead_code)]
mod support;

use messages::JOINTS_MAX;
use plant::{Config, Frames, Judge, Options, Payload, Plant, Report};
use rand::{RngExt, SeedableRng};
use std::time::Instant;
use support::{GRIPPERS, HANDS, START, Sines, TICK_NS, Texts};

/// The worst values over one motion of 6 s.
#[derive(Default)]
struct Worst {
    /// |q - q_ref| of each joint, rad or m.
    error: [f64; JOINTS_MAX],
    /// |v| / v_max over the largest |v_ref| / v_max.
    speed: f64,
    /// Distance of any end of a capsule from its place in the reference, m.
    place_m: f64,
    /// The largest |torque| / limit.
    effort: f64,
}

fn follow(config: &Config, sines: &Sines, seed: u64, worst: &mut Worst) -> Report {
    let mut plant = Plant::new(config, START, &sines.centre, seed);
    let mut judge = Judge::new(config, &sines.centre);
    let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
    let (mut true_frames, mut wanted_frames) = (Frames::default(), Frames::default());
    for k in 0..9000 {
        let jitter_ns = rng.random_range(0..200_000);
        let now = START.plus_ns(k * TICK_NS + jitter_ns);
        assert!(plant.receive_judged(config, now, &sines.at(k), &mut judge));
        let (truth, (wanted, since)) = (*plant.truth(), plant.followed());
        let t = truth.stamp.since(since) as f64 * 1e-9;
        let q_ref: [f64; JOINTS_MAX] = std::array::from_fn(|j| wanted.q[j] + t * (wanted.v[j] + t * wanted.a[j] / 2.0));
        for (j, joint) in config.body().joints.iter().enumerate() {
            worst.error[j] = worst.error[j].max((truth.q[j] - q_ref[j]).abs());
            worst.speed = worst.speed.max(truth.v[j].abs() / joint.limits.v_max);
            worst.effort = worst.effort.max(truth.tau[j].abs() / joint.limits.effort_max);
        }
        config.body().forward(&truth.q, &mut true_frames);
        config.body().forward(&q_ref, &mut wanted_frames);
        for capsule in &config.body().capsules {
            let [a, b] = [&true_frames, &wanted_frames]
                .map(|f| capsule.ends.map(|end| f.base_from_body[capsule.body].point(&end)));
            worst.place_m = worst.place_m.max((a[0] - b[0]).norm()).max((a[1] - b[1]).norm());
        }
    }
    *judge.report()
}

fn tracking(name: &str, texts: Texts, payload_kg: f64, hand: &str, share: f64) {
    let payloads = ["left", "right"].map(|side| Payload { link: hand.replace("SIDE", side), mass_kg: payload_kg });
    let config = support::config(texts, &Options { payloads: payloads.into(), ..Options::default() });
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut worst = Worst::default();
    for seed in 0..20 {
        let sines = Sines::bearable(&config, &mut rng, share);
        follow(&config, &sines, seed, &mut worst);
    }
    println!(
        "{name}, payload {payload_kg} kg, 20 motions of 6 s at {share} of the limits in force, as motors can bear it:"
    );
    let mrad: Vec<String> = worst.error.iter().map(|e| format!("{:.2}", e * 1e3)).collect();
    println!("  tracking error, mm of the lift, then mrad: {}", mrad.join(" "));
    println!(
        "  speed / limit {:.3}, torque / limit {:.3}, place of capsules {:.2} mm",
        worst.speed,
        worst.effort,
        worst.place_m * 1e3
    );
}

fn timing(texts: Texts) {
    let config = support::config(texts, &Options::default());
    let mut rng = rand_pcg::Pcg64::seed_from_u64(2);
    let sines = Sines::bearable(&config, &mut rng, 1.0);
    let mut plant = Plant::new(&config, START, &sines.centre, 1);
    let mut judge = Judge::new(&config, &sines.centre);
    let mut best = [f64::INFINITY; 3];
    for round in 0..200_u64 {
        let now = START.plus_ns((round + 1) * 50_000_000);
        let begin = Instant::now();
        plant.advance(&config, now);
        best[0] = best[0].min(begin.elapsed().as_nanos() as f64 / 100.0);
        let begin = Instant::now();
        for _ in 0..100 {
            judge.look(&config, plant.truth());
        }
        best[1] = best[1].min(begin.elapsed().as_nanos() as f64 / 100.0);
        let begin = Instant::now();
        let copy = (plant.clone(), judge.clone());
        best[2] = best[2].min(begin.elapsed().as_nanos() as f64);
        std::hint::black_box(&copy);
    }
    println!(
        "least of 200 rounds: {:.0} ns a step, {:.0} ns a look, {:.0} ns a copy of both",
        best[0], best[1], best[2]
    );
    println!("{} bytes of plant, {} pairs", size_of::<Plant>(), config.body().pairs.len());
}

fn main() {
    timing(HANDS);
    for share in [0.5, 1.0] {
        tracking("hands", HANDS, 0.0, "hand_SIDE_grasping_frame", share);
        tracking("hands", HANDS, 0.7, "hand_SIDE_grasping_frame", share);
        tracking("grippers", GRIPPERS, 0.0, "arm_SIDE_7_link", share);
    }
}
