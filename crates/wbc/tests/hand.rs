//! Tests the bound on the speed of elbows and hands.

use crate::support::{shipped, towards};
use messages::{JOINTS_MAX, Stamp, TICK_S};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Frames, Model};
use wbc::{Candidate, Config, JointMotion, Options, PlannedMotion, State, tick};

fn points(model: &Model, q: &[f64; JOINTS_MAX]) -> [nalgebra::Vector3<f64>; 4] {
    let mut frames = Frames::default();
    model.forward(q, &mut frames);
    model.speed_points().map(|point| frames.base_from_body[point.body].transform_point(&point.at))
}

/// Speed of the fastest point of a plan, m/s, from its displacement in a quarter of a tick.
fn fastest(model: &Model, planned: &JointMotion) -> f64 {
    let dt = TICK_S / 4.0;
    let mut last = points(model, &planned.q);
    let mut most = 0.0_f64;
    for n in 1..=3000 {
        let later = planned.advanced(f64::from(n) * dt);
        let now = points(model, &later.q);
        most = last.iter().zip(&now).fold(most, |most, (a, b)| most.max((b - a).norm() / dt));
        last = now;
        if later.is_at_rest() {
            break;
        }
    }
    most
}

/// Result of following random postures: ticks with a fallback, ticks with a decision, the fastest point, and
/// goals reached.
struct Run {
    fallbacks: u32,
    fresh: u32,
    fastest: f64,
    rolled: f64,
    reached: u32,
}

fn follow(max: f64, ticks_a_goal: u64, goals: u64) -> Run {
    let model = shipped();
    let config = Config::new(&model, Options::default().hand_speed_m_per_s(max)).expect("the robot");
    let mut state = State::at_rest(&config, model.home);
    let mut rng = Pcg64::seed_from_u64(61);
    let mut run = Run { fallbacks: 0, fresh: 0, fastest: 0.0, rolled: 0.0, reached: 0 };
    let (mut last, mut k) = (points(&model, &model.home), 0);
    for goal in 0..goals {
        // Postures are around home, and most of them are free.
        let size = if goal % 2 == 0 { 0.0 } else { 0.5 };
        let q: [f64; JOINTS_MAX] = std::array::from_fn(|j| {
            let l = &model.limits[j];
            if j >= model.count {
                return 0.0;
            }
            let size = if model.prismatic[j] { 0.1 * size } else { size };
            (model.home[j] + size * rng.random_range(-1.0..=1.0)).clamp(l.q_min, l.q_max)
        });
        let mut on_target = false;
        for _ in 0..ticks_a_goal {
            k += 1;
            let out = tick(&config, &mut state, Stamp(0), towards(k, &q));
            run.fallbacks += u32::from(out.fallbacks > 0);
            run.fresh += u32::from(out.candidate != Candidate::Plan);
            on_target |= out.on_target;
            let now = points(&model, &out.motion.q);
            run.fastest = last.iter().zip(&now).fold(run.fastest, |most, (a, b)| most.max((b - a).norm() / TICK_S));
            last = now;
            if k % 50 == 0 {
                run.rolled = run.rolled.max(fastest(&model, state.planned()));
            }
        }
        run.reached += u32::from(on_target);
    }
    run
}

#[test]
fn reduced_hand_speed_is_kept_and_goals_are_reached() {
    let Run { fallbacks, fresh, fastest, rolled, reached } = follow(0.25, 12_000, 8);
    println!("{fallbacks} of {fresh} ticks fell back, fastest {fastest} m/s, in plans {rolled} m/s, {reached} reached");
    assert!(fastest <= 0.25 + 1e-9 && rolled <= 0.25 + 1e-9, "{fastest} {rolled}");
    assert!(fastest > 0.1, "the bound is not what keeps it slow: {fastest}");
    assert!(reached >= 6 && fallbacks < fresh / 1000, "{reached} reached, {fallbacks} fallbacks of {fresh}");
}

#[test]
fn same_motion_with_high_hand_speed_bound_is_faster() {
    let run = follow(3.0, 1500, 8);
    assert!(run.fastest > 0.4, "{}", run.fastest);
}

#[test]
fn hand_speed_of_zero_negative_or_non_finite_is_refused() {
    for max in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Config::new(&shipped(), Options::default().hand_speed_m_per_s(max)).is_err(), "{max}");
    }
}
