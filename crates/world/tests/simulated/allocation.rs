//! No tick allocates.

use super::{Bench, ELBOW, behind};
use driver::Interface;
use world::simulated::Options;

/// Returns the number of new blocks of this thread since counting began.
fn allocated() -> u64 {
    rt::allocations().0.allocated
}

#[test]
fn tick_with_either_interface_allocates_nothing() {
    rt::watch_allocations();
    for interface in [Interface::Direct, Interface::Jtc100, Interface::Jtc100Restart] {
        allocates_nothing(&Options { driver: behind(interface), ..Options::default() });
    }
}

fn allocates_nothing(options: &Options) {
    let mut bench = Bench::new(options, 1);
    let before = allocated();
    for n in 0..10_000_u64 {
        // To and fro, with a silence now and then.
        let jerk = if n % 40 < 10 || n % 40 >= 30 { 100.0 } else { -100.0 };
        let command = bench.next(ELBOW, jerk);
        let command = (n % 1000 < 900).then_some(&command);
        bench.tick(bench.command.k, command);
    }
    assert_eq!(allocated(), before);
    let follower = bench.state.follower();
    assert!(follower.accepted > 800 && follower.latched, "commands, silence and refusals were among them");
}
