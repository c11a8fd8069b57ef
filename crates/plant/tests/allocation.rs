//! Nothing allocates after construction.

use crate::support::{HANDS, START, Sines, TICK_NS, config};
use plant::{Injection, Judge, Obstacle, Options, Plant, Reaction};
use rand::SeedableRng;

/// Returns the number of new blocks of this thread since counting began.
fn allocated() -> u64 {
    rt::allocations().0.allocated
}

#[test]
fn plant_allocates_nothing_in_motion_silence_and_faults() {
    rt::watch_allocations();
    for reaction in [Reaction::Hold, Reaction::Damp, Reaction::Play] {
        let half_m = nalgebra::Vector3::new(0.3, 0.5, 0.02);
        let table = Obstacle::Box { center: nalgebra::Vector3::z(), r: nalgebra::Matrix3::identity(), half_m };
        let config = config(HANDS, &Options { reaction, obstacles: vec![table], ..Options::default() });
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let sines = Sines::bearable(&config, &mut rng, 1.0);
        let mut plant = Plant::new(&config, START, &sines.centre, 1);
        let mut judge = Judge::new(&config, &sines.centre);
        let before = allocated();
        let (mut taken, mut reacted) = (0, 0);
        for k in 0..4000 {
            let now = START.plus_ns(k * TICK_NS);
            if k % 1000 < 900 {
                taken += u64::from(plant.receive_judged(&config, now, &sines.at(k), &mut judge));
            }
            if k == 3000 {
                plant.inject(Injection::PowerLost { sag: 0.1 });
            }
            plant.advance_judged(&config, now, &mut judge);
            reacted += u64::from(plant.measure(&config, now).reacting);
        }
        assert_eq!(allocated(), before);
        assert!(taken >= 900 && reacted > 80 && judge.report().looks > 1000, "{taken} {reacted}");
    }
}
