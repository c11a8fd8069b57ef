//! Tests that no tick allocates, whatever its input.

use crate::support::{config_of, input, made_up};
use judge::Attacker;
use messages::Stamp;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use rt::count_allocations;
use wbc::{Options, State, tick};

#[test]
fn tick_under_attack_allocates_nothing() {
    let robot = made_up();
    let config = config_of(&robot, Options::default());
    let mut state = State::at_rest(&config, robot.home);
    let mut attacker = Attacker::new(&robot, Pcg64::seed_from_u64(77));
    let mut in_ticks = 0;
    for k in 0..10_000 {
        if k % 500 == 0 {
            state = state.clone();
        }
        attacker.next(k, &state.planned().q);
        let input = input(k, &attacker);
        in_ticks += count_allocations(|| tick(&config, &mut state, Stamp::NONE, input)).1.allocated;
    }
    let payload = robot::Payload { mass_kg: 0.5, center: nalgebra::Vector3::new(0.0, 0.1, 0.2) };
    let mut at_rest = State::at_rest(&config, robot.home);
    let (carried, counted) = count_allocations(|| at_rest.carry(&config, &[payload; 2]));
    assert_eq!((carried, in_ticks + counted.allocated), (Ok(None), 0));
    assert!(count_allocations(|| Box::new(1)).1.allocated > 0, "the counter counts");
}
