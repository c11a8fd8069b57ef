//! Tests that a tick never allocates.

use crate::support::motion::resting;
use crate::support::{Bench, model};
use messages::Stamp;
use rand::{Rng, SeedableRng};
use robot::{Frames, Pose};
use rt::count_allocations;
use safety::gate::{Config, State, tick};
use safety::monitor;

#[test]
fn engage_and_gate_ticks_allocate_nothing() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let mut gate = State::at_rest(model.home);
    let mut bench = Bench::engaged();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut near = monitor::Near::new();
    let mut frames = Frames { base_from_body: [Pose::identity(); messages::JOINTS_MAX + 1] };
    let mut ticks = || {
        for k in 1..=10_000 {
            bench.input.motion.gate_denied = k % 7 == 0;
            bench.input.operator.estop_edge = k % 1000 == 0;
            bench.step();
            let mut proposed = resting(k, model.home);
            // Both clearance checks run, because the command is new. It serves no other purpose.
            proposed.motion.a[1] = if k % 2 == 0 { 1e-7 } else { f64::from_bits(rng.next_u64()) };
            tick(&config, &mut gate, Stamp(k), proposed);
            let clearance = monitor::measured_clearance(&model, &mut frames, &proposed.motion.q);
            near.update(&model, clearance.distance_m);
            monitor::outside_limits(&model, &proposed.motion.q);
            monitor::tracking_error(&model, &proposed.motion.q, &proposed.motion.v, &proposed.motion.q, 0.0);
        }
    };
    assert_eq!(count_allocations(&mut ticks).1.allocated, 0);
    assert_eq!(count_allocations(|| Box::new(1)).1.allocated, 1, "the counter counts");
}
