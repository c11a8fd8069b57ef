//! Times kinematics and clearance: `cargo run --release -p robot --example time -- ROBOT.toml ROBOT.urdf`.

use robot::{Frames, Model, segment_distance};
use std::hint::black_box;
use std::time::Instant;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut text = || {
        let path = arguments.next().expect("two files: robot file and URDF");
        (std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}")), path)
    };
    let ((toml, toml_name), (urdf, urdf_name)) = (text(), text());
    let model = Model::from_text(&toml_name, &toml, &urdf_name, &urdf).unwrap_or_else(|error| panic!("{error}"));
    let mut frames = Frames::default();
    // Takes the minimum of many short runs, which is the time without interruptions.
    let least_ns = |work: &mut dyn FnMut(u32)| {
        (0..2_000)
            .map(|_| {
                let start = Instant::now();
                (0..50).for_each(&mut *work);
                start.elapsed().as_nanos() as f64 / 50.0
            })
            .fold(f64::INFINITY, f64::min)
    };
    let mut q = model.home;
    let forward = least_ns(&mut |i| {
        q[3] = model.home[3] + 1e-3 * f64::from(i);
        model.forward(black_box(&q), &mut frames);
        black_box(&frames);
    });
    let sines = least_ns(&mut |i| {
        for angle in &q[1..] {
            black_box(f64::sin_cos(black_box(angle + f64::from(i))));
        }
    });
    let clearance = least_ns(&mut |_| {
        black_box(model.clearance(black_box(&frames)));
    });
    let capsule = |i: usize| (&model.capsules[i].a, &model.capsules[i].b);
    let ((a0, a1), (b0, b1)) = (capsule(0), capsule(5));
    let segment = least_ns(&mut |_| {
        black_box(segment_distance(black_box(a0), a1, black_box(b0), b1));
    });
    println!("forward   {forward:8.0} ns, {:.2} x the 16 sines and cosines in it", forward / sines);
    println!("segment   {segment:8.1} ns");
    println!("clearance {clearance:8.0} ns for {} pairs", model.pairs.len());
}
