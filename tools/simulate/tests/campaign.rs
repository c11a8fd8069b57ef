//! Campaigns give the same result for any number of threads, pass on the product as it is, and find and shrink
//! a planted bug.

use messages::Mode;
use simulate::campaign::{self, Plan, Summary};
use simulate::kinds::{self, KIND_COUNT, KINDS, by_name, named};
use simulate::run::Bug;
use simulate::schedule::{self, Episode};
use simulate::subject::Subject;
use std::path::Path;

/// Hazards that the deterministic simulation must cover.
const SHOWN: [u32; 57] = [
    1, 2, 6, 7, 8, 9, 11, 12, 13, 14, 15, 16, 17, 20, 21, 22, 23, 24, 25, 26, 27, 29, 31, 33, 34, 35, 43, 44, 45, 46,
    47, 48, 49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, 62, 63, 64, 65, 66, 67, 68, 69, 70, 74, 78, 109,
];

fn subject() -> Subject {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    Subject::load(&config, None).expect("the settings of the repository")
}

fn plan(seeds: u64, ticks: u64, jobs: usize) -> Plan {
    Plan { first_seed: 1, seeds, ticks, jobs, kinds: kinds::all(false), ..Plan::default() }
}

/// Runs a campaign that must break no promise.
fn passed(subject: &Subject, plan: &Plan) -> Summary {
    let sum = campaign::run(subject, plan, || {}).expect("a campaign");
    let one = |f: &campaign::Failure| format!("{} {:?} {}", f.seed, f.smallest, schedule::to_text(&f.schedule));
    assert!(sum.failures.is_empty(), "{}", sum.failures.iter().map(one).collect::<Vec<_>>().join("\n"));
    sum
}

#[test]
fn replay_is_bit_identical_and_another_seed_differs() {
    let (subject, plan) = (subject(), plan(1, 4000, 1));
    let engaged = subject.engaged(false).expect("a clean start");
    let mut hashes = vec![];
    for seed in [4, 5] {
        let drawn = campaign::drawn(seed, &plan);
        let read = schedule::from_text(&schedule::to_text(&drawn)).expect("what is printed is read");
        assert_eq!(read, drawn, "a schedule survives its text");
        let first = campaign::single(&engaged, &subject, seed, &plan, &drawn);
        let second = campaign::single(&engaged, &subject, seed, &plan, &read);
        assert_eq!(first, second, "seed {seed}");
        assert_eq!(first.violation, None, "seed {seed}");
        hashes.push(first.hash);
    }
    assert_ne!(hashes[0], hashes[1], "the seed decides");
}

#[test]
fn campaign_results_do_not_depend_on_the_number_of_threads() {
    let subject = subject();
    let one = campaign::run(&subject, &plan(3, 4000, 1), || {}).expect("a campaign");
    let three = campaign::run(&subject, &plan(3, 4000, 3), || {}).expect("a campaign");
    assert_eq!(one, three);
}

/// Wires and clocks are bad beside all other faults. What arrives is judged by the true times.
#[test]
fn f126_operator_and_person_over_bad_wires_break_no_promise() {
    let plan = Plan { is_remote: true, ..plan(2, 11_000, 2) };
    let sum = passed(&subject(), &plan);
    assert!(sum.ticks_in[Mode::Engaged as usize] > 2_000, "{:?}", sum.ticks_in);
}

/// A policy leads beside all other faults, with faults of its own, and then with its own alone. A person takes over from it.
#[test]
fn f137_f138_f139_f140_f141_f142_f143_f144_policy_breaks_no_promise() {
    let subject = Subject { is_policy: true, ..subject() };
    let own: Vec<_> = (0..KIND_COUNT).filter(|&kind| kinds::is_policy(kind)).collect();
    for kinds in [kinds::all(true), own.clone()] {
        let plan = Plan { is_policy: true, kinds, ..plan(8, 11_000, 2) };
        let sum = passed(&subject, &plan);
        assert!(sum.ticks_in[Mode::Engaged as usize] > 20_000, "{:?}", sum.ticks_in);
        assert!(plan.kinds != own || own.iter().all(|&kind| sum.fired[kind] > 0), "{:?}", sum.fired);
    }
}

/// A landmarker's errors are beside all other faults: it loses the person, exchanges the sides and guesses arms.
#[test]
fn f017_person_before_a_camera_breaks_no_promise() {
    let subject = Subject { is_camera: true, ..subject() };
    let plan = Plan { is_camera: true, ..plan(2, 11_000, 2) };
    let sum = passed(&subject, &plan);
    assert!(sum.ticks_in[Mode::Engaged as usize] > 500, "{:?}", sum.ticks_in);
}

#[test]
fn planted_bug_is_found_and_its_schedule_is_shrunk() {
    let subject = subject();
    let mut plan = plan(1, 9000, 1);
    plan.bug = Some(Bug::DeafWhileTargetsAreLost);
    let episode = |name: &str, start, ticks, param| Episode { kind: by_name(name).expect(name), start, ticks, param };
    // Only the two in the middle matter, and both are needed.
    let all = [
        episode("frame-nan", 10, 100, 1),
        episode("low-confidence", 20, 60, 2),
        episode("drop-target", 100, 300, 0),
        episode("estop-chatter", 150, 60, 4),
        episode("delay-raw", 120, 500, 5),
        episode("noise-burst", 160, 90, 6),
    ];
    let engaged = subject.engaged(false).expect("a clean start");
    let fails = |some: &[Episode]| campaign::single(&engaged, &subject, 2, &plan, some).violation;
    let found = fails(&all).expect("the bug is found");
    assert_eq!(found.invariant, "emergency stop");
    let (smallest, still) = simulate::shrink::smallest(&all, &found, fails);
    let names: Vec<_> = smallest.iter().map(|episode| KINDS[episode.kind].name.as_str()).collect();
    assert_eq!(names, ["drop-target", "estop-chatter"], "{}", schedule::to_text(&smallest));
    assert_eq!(still.invariant, "emergency stop");
    let lengths: Vec<_> = smallest.iter().map(|episode| episode.ticks).collect();
    assert!(lengths[0] < 300 && lengths[1] < 60, "they were made shorter too: {lengths:?}");
}

/// Every seed is dealt three kinds. `.ci/long` has 2,000 seeds.
#[test]
fn campaign_of_every_scheduled_fault_breaks_no_promise() {
    let subject = subject();
    let sum = passed(&subject, &plan(50, 11_000, 2));
    let missing = kinds::all(false).into_iter().filter(|&kind| sum.fired[kind] == 0);
    let missing: Vec<_> = missing.map(|kind| KINDS[kind].name.as_str()).collect();
    assert!(missing.is_empty(), "never fired: {missing:?}");
    let by_id = sum.by_id();
    for id in SHOWN {
        let count = by_id.get(format!("f{id:03}").as_str()).copied().unwrap_or(0);
        assert!(count > 0, "f{id:03} never fired");
    }
    let moving = sum.ticks_in[Mode::Engaging as usize] + sum.ticks_in[Mode::Engaged as usize];
    assert!(2 * moving > sum.ticks, "the robot moved in {moving} of {} ticks only", sum.ticks);
}

/// The first seed that breaks a promise ends the campaign, and is the same for any number of threads.
#[test]
fn campaign_until_found_ends_at_the_first_failing_seed() {
    let subject = subject();
    let kinds = ["drop-target", "estop-chatter"].map(|name| by_name(name).expect("a kind")).to_vec();
    let bug = Some(Bug::DeafWhileTargetsAreLost);
    let mut plan = Plan { until_found: true, kinds, bug, ..plan(50, 9000, 1) };
    let one = campaign::run(&subject, &plan, || {}).expect("a campaign");
    let [failure] = &one.failures[..] else { panic!("{} failures", one.failures.len()) };
    assert_eq!((failure.seed, failure.shrunk), (one.seeds, false), "it is the last that ran");
    assert!(one.seeds < 50, "the others did not run");
    plan.jobs = 3;
    assert_eq!(campaign::run(&subject, &plan, || {}).expect("a campaign"), one);
    plan.bug = None;
    plan.seeds = one.seeds;
    let sound = campaign::run(&subject, &plan, || {}).expect("a campaign");
    assert_eq!((sound.seeds, sound.failures.len()), (one.seeds, 0));
}

#[test]
fn malformed_schedule_is_refused_with_its_wrong_part() {
    for (text, part) in [("nonsense@1+2:3", "nonsense"), ("frame-nan@1", "frame-nan@1"), ("frame-nan@x+2:3", "@x+2")] {
        let error = schedule::from_text(text).expect_err(text);
        assert!(error.contains(part), "{error}");
    }
    assert_eq!(schedule::from_text("none"), Ok(vec![]));
    assert!(named("f109").len() > 1 && named("no such fault").is_empty());
}

/// The gate once took a new motion for the plan it stood on, and 7 ps were left over at the end of a phase.
#[test]
fn schedules_of_fixed_bugs_break_no_promise() {
    let subject = subject();
    let engaged = subject.engaged(false).expect("it engages");
    for (seed, text) in [
        (1097, "release@1250+600:76faa591,sequence-wrap@4366+18:f5f0c95d"),
        // A robot that was moved while no driver ran does not move when the driver starts.
        (139, "estop-engaging@1250+150:227df97b,pause-all@2082+1418:8316f7b5,found-outside@3480+1:f5856386"),
    ] {
        let episodes = schedule::from_text(text).expect("a schedule");
        let outcome = campaign::single(&engaged, &subject, seed, &plan(1, 12_000, 1), &episodes);
        assert_eq!(outcome.violation, None, "{text}");
    }
}
