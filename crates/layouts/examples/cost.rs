//! Measures the cost of a conversion, beside the check of the same frame: `cargo run --release -p layouts
//! --example cost`.

use layouts::{Layouts, Map};
use messages::{Layout, RawSkeleton, Stamp, raw_flag};
use std::hint::black_box;

/// Rounds, and conversions per round.
const ROUNDS: usize = 201;
const CONVERSIONS: u32 = 200;

/// Median of the rounds, us per call.
fn median_us(mut call: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = rt::now();
            (0..CONVERSIONS).for_each(|_| call());
            rt::now().since(start) as f64 * 1e-3 / f64::from(CONVERSIONS)
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}

fn main() {
    let mut layouts = Layouts::default();
    let text = include_str!("../../../config/skeletons/zed_body_38.toml");
    layouts
        .add("zed_body_38.toml", Map::parse("zed_body_38.toml", text).expect("shipped"))
        .expect("a number of its own");
    let (global, local) = (raw_flag::ROTATIONS, raw_flag::ROTATIONS | raw_flag::LOCAL);
    let frames = [
        (1, 22, global),
        (1, 22, local),
        (2, 24, global),
        (3, 24, global),
        (4, 33, 0),
        (5, 32, global),
        (6, 23, global),
    ];
    println!("layout             joints flags   convert us");
    let mut person = None;
    for (number, joints, flags) in frames.into_iter().chain([(7, 55, local), (1038, 38, 0)]) {
        let mut raw = RawSkeleton { layout: number, joint_count: joints, flags, ..RawSkeleton::ZERO };
        raw.header.origin = Stamp(1_000_000_000);
        raw.confidence.fill(1.0);
        raw.rotations.fill([0.0, 0.0, 0.0, 1.0]);
        let out = layouts.convert(&raw).expect("a frame");
        if flags == local {
            person = Some(out);
        }
        let us = median_us(|| _ = black_box(layouts.convert(black_box(&raw))));
        println!("{:<18} {joints:>6} {flags:>5} {us:>12.3}", layouts.find(number).map_or("", Map::name));
    }
    let person = person.expect("one of local rotations");
    let config = skeleton::Config::default();
    let tick = |state: &mut skeleton::State| {
        skeleton::tick(&config, state, Stamp(1_001_000_000), skeleton::Input { raw: black_box(&person), stored: None })
    };
    assert!(tick(&mut skeleton::State::new()).skeleton.is_some(), "a T-pose is a person");
    let us = median_us(|| _ = black_box(tick(&mut skeleton::State::new())));
    println!("check of the first frame of a session: {us:.3} us");
    println!("each the median of {ROUNDS} rounds of {CONVERSIONS}");
}
