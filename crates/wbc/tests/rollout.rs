//! Plays the stored plan of random ticks to rest in steps of a tenth of a millisecond. The judge shares no
//! code with the certificate: it measures the capsules by parry's segments.

use crate::support::{config_of, input, shipped};
use judge::{Attacker, Robot, Rollout};
use messages::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use wbc::{Options, State, tick};

const STEP_S: f64 = 1e-4;
/// Rounding of positions along a plan that another formula plays, and of the other distance. It is 1e-9 m,
/// far below the micrometre that commands keep beyond d_min.
const ROUNDING_M: f64 = 1e-9;

fn on_a_floor() -> Robot {
    let floor = robot::PlaneEntry { name: "floor".into(), normal: [0.0, 0.0, 1.0], offset_m: 0.0 };
    let environment = robot::Environment { planes: vec![floor], boxes: vec![] };
    Robot::new(shipped().with_environment("test", &environment).expect("the shipped robot on a floor"))
}

/// Returns the stops of random ticks under attack.
fn stops(robot: &Robot, seed: u64, ticks: u64, count: usize) -> Vec<Rollout> {
    let config = config_of(robot, Options::default());
    let mut state = State::at_rest(&config, robot.home);
    let mut attacker = Attacker::new(robot, Pcg64::seed_from_u64(seed));
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut stops = Vec::new();
    for k in 0..ticks {
        attacker.next(k, &state.planned().q);
        let out = tick(&config, &mut state, Stamp::NONE, input(k, &attacker));
        if rng.random_range(0..ticks) < count as u64 {
            stops.push(Rollout::new(&out.motion));
        }
    }
    stops
}

#[test]
fn plans_keep_clearance_until_rest() {
    let robot = on_a_floor();
    let (mut postures, mut least) = (0_u64, f64::INFINITY);
    for seed in 300..303 {
        for stop in stops(&robot, seed, 6000, 40) {
            for q in stop.postures(STEP_S) {
                least = least.min(robot.clearance(&q));
                postures += 1;
            }
        }
    }
    println!("{postures} postures, least clearance {:.6} mm", least * 1e3);
    assert!(postures > 50_000 && least >= robot.d_min_m - ROUNDING_M, "{postures} postures, {least} m");
    assert!(least < robot.d_min_m + 2e-3, "never close: {least} m");
}
