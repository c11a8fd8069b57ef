//! Tests that no tick allocates, whatever its input.

mod support;

use messages::Stamp;
use support::attack::Attacker;
use support::checker::Checker;
use wbc::{Input, Options, State, Target, tick};

#[global_allocator]
static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;

/// Number of blocks that this thread has allocated since counting began.
fn allocated() -> u64 {
    rt::allocations().0.allocated
}

#[test]
fn tick_under_attack_allocates_nothing() {
    rt::watch_allocations();
    let subject = support::Subject::made_up();
    let config = subject.config(Options::default());
    let mut state = State::at_rest(&config, subject.home);
    let checker = Checker::new(&subject, state.planned());
    let mut attacker = Attacker::new(&subject, 77);
    let mut in_ticks = 0;
    for k in 0..10_000 {
        attacker.next(k, state.planned(), &checker);
        let target =
            Target { q: &attacker.q, dq: &attacker.dq, ddq: &[0.0; messages::JOINTS], valid_mask: attacker.valid_mask };
        let input = Input { k, target: Some(target), permit: attacker.permit };
        let before = allocated();
        tick(&config, &mut state, Stamp::NONE, input);
        in_ticks += allocated() - before;
    }
    let payload = robot::Payload { mass_kg: 0.5, center: nalgebra::Vector3::new(0.0, 0.1, 0.2) };
    let mut at_rest = State::at_rest(&config, subject.home);
    let before = allocated();
    assert_eq!(at_rest.carry(&config, &[payload; 2]), Ok(None));
    in_ticks += allocated() - before;
    assert_eq!(in_ticks, 0);
    assert!(allocated() > 0, "the counter counts");
}
