//! Tests that no tick allocates, whatever its input.

use crate::support;
use judge::Attacker;
use messages::Stamp;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use support::{config_of, input, made_up};
use wbc::{Options, State, tick};

/// Number of blocks that this thread has allocated since counting began.
fn allocated() -> u64 {
    rt::allocations().0.allocated
}

#[test]
fn tick_under_attack_allocates_nothing() {
    rt::watch_allocations();
    let robot = made_up();
    let config = config_of(&robot, Options::default());
    let mut state = State::at_rest(&config, robot.home);
    let mut attacker = Attacker::new(&robot, Pcg64::seed_from_u64(77));
    let mut in_ticks = 0;
    for k in 0..10_000 {
        attacker.next(k, &state.planned().q);
        let input = input(k, &attacker);
        let before = allocated();
        tick(&config, &mut state, Stamp::NONE, input);
        in_ticks += allocated() - before;
    }
    let payload = robot::Payload { mass_kg: 0.5, center: nalgebra::Vector3::new(0.0, 0.1, 0.2) };
    let mut at_rest = State::at_rest(&config, robot.home);
    let before = allocated();
    assert_eq!(at_rest.carry(&config, &[payload; 2]), Ok(None));
    in_ticks += allocated() - before;
    assert_eq!(in_ticks, 0);
    assert!(allocated() > 0, "the counter counts");
}
