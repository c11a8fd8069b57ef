//! The executed motion is continuous for every timing of the two processes. It follows once both are on time again.

use crate::world::{FIRST_K, Moment, World};
use messages::JOINTS_MAX;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Ticks on time after which every index is executed by its own command. The driver shows a lost chain in its
/// next echo, `control` reseeds, and the driver takes the new chain. There are two such rounds if the first one
/// used a late echo.
const FOLLOWS_WITHIN: u64 = 4;
/// The same if the driver must first come to rest and then be reset. The longest plan of the test is 150 ticks,
/// and `control` tries a reset every 5 ticks.
const FOLLOWS_FROM_REST_WITHIN: u64 = 200;

/// Puts both processes on time and expects every index to be executed by its command.
fn expect_following(world: &mut World, within: u64, story: &dyn std::fmt::Debug) {
    let mut calm = || world.run(&Moment::CALM);
    for _ in 0..within {
        calm();
    }
    for _ in 0..8 {
        let tally = calm();
        assert_eq!((tally.commands, tally.plan_ticks, tally.refused), (1, 0, 0), "does not follow after {story:?}");
    }
}

#[test]
fn motion_after_three_interleaved_ticks_is_continuous_and_resumes() {
    assert_continuous_after_every_story_of(3);
}

#[test]
#[ignore = "takes two minutes: .ci/long"]
fn motion_after_four_interleaved_ticks_is_continuous_and_resumes() {
    assert_continuous_after_every_story_of(4);
}

/// Tries every story of this many ticks.
fn assert_continuous_after_every_story_of(length: u32) {
    let controls = [Some(0), Some(3), None];
    let drivers = [0b1111, 0b0100, 0b0000];
    let delays = [(0, 0), (0, 4), (3, 0)];
    let mut moments = Vec::new();
    for control in controls {
        for driver in drivers {
            for (command_delay, echo_delay) in delays {
                moments.push(Moment { control, driver, command_delay, echo_delay });
            }
        }
    }
    let stories = moments.len().pow(length);
    let mut plan_ticks = 0;
    for trusts_itself in [false, true] {
        let mut started = World::new(7);
        started.control.trusts_itself = trusts_itself;
        expect_following(&mut started, 3, &"the start");
        for index in 0..stories {
            let mut world = started.clone();
            let mut rest = index;
            let story: Vec<Moment> = (0..length).map(|_| (moments[rest % 27], rest /= 27).0).collect();
            for moment in &story {
                plan_ticks += world.run(moment).plan_ticks;
            }
            expect_following(&mut world, FOLLOWS_WITHIN, &story);
        }
    }
    println!("{} stories of {length} ticks, {plan_ticks} plan ticks", 2 * stories);
    assert!(plan_ticks > stories as u64, "the stories disturb something");
}

/// Draws the next events. `trouble` in 0..=1 is the share of them that goes wrong.
struct Weather {
    rng: Pcg64,
    trouble: f64,
    control_sleeps: u64,
    driver_sleeps: u64,
}

impl Weather {
    fn moment(&mut self) -> Moment {
        let (rng, trouble) = (&mut self.rng, self.trouble);
        if rng.random_bool(0.1 * trouble) {
            self.control_sleeps = rng.random_range(0..8);
        }
        if rng.random_bool(0.1 * trouble) {
            self.driver_sleeps = rng.random_range(0..8);
        }
        if rng.random_bool(0.003 * trouble) {
            self.driver_sleeps = rng.random_range(8..40);
        }
        if rng.random_bool(0.003 * trouble) {
            self.control_sleeps = rng.random_range(10..40);
        }
        let mut moment = Moment { control: Some(rng.random_range(0..2)), ..Moment::CALM };
        moment.driver = rng.random_range(0..8_u8) << 1 | 0b0100;
        moment.command_delay = rng.random_range(0..1);
        moment.echo_delay = rng.random_range(0..2);
        if rng.random_bool(0.2 * trouble) {
            moment.control = Some(rng.random_range(0..4));
            moment.command_delay = rng.random_range(0..12);
            moment.echo_delay = rng.random_range(0..12);
            moment.driver = rng.random_range(0..16);
        }
        if self.control_sleeps > 0 {
            self.control_sleeps -= 1;
            moment.control = None;
        }
        if self.driver_sleeps > 0 {
            self.driver_sleeps -= 1;
            moment.driver = 0;
        }
        moment
    }
}

#[test]
fn f059_motion_under_random_faults_is_continuous_and_resumes() {
    assert_continuous_under_random_faults(if cfg!(debug_assertions) { 60 } else { 300 });
}

#[test]
#[ignore = "takes two minutes: .ci/long"]
fn f059_motion_under_more_random_faults_is_continuous_and_resumes() {
    assert_continuous_under_random_faults(10_000);
}

fn assert_continuous_under_random_faults(runs: u64) {
    let (mut commands, mut plan_ticks, mut refused, mut latched, mut restarts, mut suspensions) = (0, 0, 0, 0, 0, 0);
    for seed in 0..runs {
        let mut world = World::new(seed);
        let rng = Pcg64::seed_from_u64(seed);
        let mut weather = Weather { rng, trouble: 0.0, control_sleeps: 0, driver_sleeps: 0 };
        weather.trouble = weather.rng.random_range(0.1..1.0);
        for storm in 0..4 {
            let mut from_rest = storm == 0;
            for _ in 0..200 {
                let moment = weather.moment();
                let tally = world.run(&moment);
                commands += tally.commands;
                plan_ticks += tally.plan_ticks;
                refused += tally.refused;
                suspensions += tally.suspensions;
                if weather.rng.random_bool(0.003 * weather.trouble) {
                    world.restart_control();
                    (from_rest, restarts) = (true, restarts + 1);
                }
                if weather.rng.random_bool(0.002 * weather.trouble) {
                    for _ in 0..3 {
                        world.run(&Moment { driver: 0, ..moment });
                    }
                    world.restart_driver();
                    (from_rest, restarts) = (true, restarts + 1);
                }
            }
            (weather.control_sleeps, weather.driver_sleeps) = (0, 0);
            // Messages that are still under way arrive within three ticks.
            for _ in 0..3 {
                suspensions += world.run(&Moment::CALM).suspensions;
            }
            latched += u64::from(world.follower.latched);
            let at_once = !from_rest && !world.follower.latched;
            let within = if at_once { FOLLOWS_WITHIN } else { FOLLOWS_FROM_REST_WITHIN };
            expect_following(&mut world, within, &(seed, storm));
        }
    }
    println!(
        "{runs} runs: {commands} commands, {plan_ticks} plan ticks, {refused} refused, {latched} latched, {restarts} restarts, {suspensions} suspensions"
    );
    assert!(
        commands > 100 * runs && plan_ticks > 10 * runs && refused > 10 * runs,
        "the weather is neither calm nor dead"
    );
    assert!(latched > 0 && restarts > runs / 10 && suspensions > runs / 10, "silence, restarts and suspensions occur");
}

#[test]
fn driver_without_commands_begins_by_holding() {
    let mut world = World::new(1);
    world.run(&Moment { control: None, ..Moment::CALM });
    assert_eq!(world.follower.executed_k, FIRST_K);
    assert_eq!(world.follower.motion.q, [0.1; JOINTS_MAX]);
}
