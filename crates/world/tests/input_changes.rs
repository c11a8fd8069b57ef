//! Reaction of an engaged robot to the clutch of its frames and to another person. Every stage runs in virtual time, from
//! the client's frame to the executed motion. `simulate` has the faulty frames.

use crate::support::scene::Scene;
use messages::{Fault, Mode, PersonChange, RawSkeleton, Subject, TICK_HZ, Transition, raw_flag};
use std::sync::LazyLock;
use world::Moment;

/// A scene that is engaged, two seconds into the motion.
static ENGAGED: LazyLock<Scene> = LazyLock::new(|| {
    let mut scene = Scene::new(6);
    run(&mut scene, TICK_HZ, &mut |_| true);
    scene.press_enable();
    while scene.mode != Mode::Engaged {
        scene.step();
        assert!(scene.world.ticks() < 14 * TICK_HZ, "{:?}", scene.mode);
    }
    run(&mut scene, 2 * TICK_HZ, &mut |_| true);
    assert_eq!(scene.mode, Mode::Engaged);
    scene
});

/// Runs some ticks, with a spoiled client. Returns the last one.
fn run(scene: &mut Scene, ticks: u64, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) -> Option<Moment> {
    (0..ticks).map(|_| scene.step_spoiled(spoil)).last()
}

/// The person goes on moving under the clutch.
#[test]
fn f119_robot_stands_under_the_clutch_of_the_frames_and_then_moves_slowly_to_the_person() {
    let mut scene = ENGAGED.clone();
    let robot = |moment: Option<Moment>| moment.and_then(|moment| moment.robot).expect("a robot");
    let stands = robot(run(&mut scene, 2 * TICK_HZ, &mut under_clutch)).q;
    let why = explain::newest_transitions(&scene.status, 1).next().expect("a transition").why;
    assert_eq!((scene.mode, why), (Mode::Holding, Fault::Clutch as u32));
    let (later, limits) = (robot(run(&mut scene, TICK_HZ, &mut under_clutch)).q, scene.config.control.model.limits);
    assert!(later.iter().zip(&stands).all(|(now, then)| (now - then).abs() < 1e-6), "it stands");
    let mut ticks = 0;
    while scene.mode != Mode::Engaging {
        scene.step();
        ticks += 1;
        assert!(ticks < TICK_HZ / 5, "{:?}", scene.mode);
    }
    for tick in 0..TICK_HZ - 5 {
        let robot = scene.step().robot.expect("a robot");
        let fastest = robot.v.iter().zip(&limits).fold(0.0, |most: f64, (v, limits)| most.max(v.abs() / limits.v_max));
        assert!(fastest <= 0.05 + 1e-6, "tick {tick}: {fastest} of a limit");
    }
    run(&mut scene, 5 * TICK_HZ, &mut |_| true);
    assert_eq!(scene.mode, Mode::Engaged);
    assert_eq!(scene.world.report().violations_total(), 0, "{:?}", scene.world.report().violations());
}

fn under_clutch(f: &mut RawSkeleton) -> bool {
    f.flags |= raw_flag::CLUTCH;
    true
}

/// Makes the left forearm half as long again.
fn stretch(f: &mut RawSkeleton) {
    for c in 0..3 {
        f.positions[20][c] = f.positions[18][c] + 1.5 * (f.positions[20][c] - f.positions[18][c]);
    }
}

#[test]
fn each_change_of_the_person_releases_the_robot_and_is_named() {
    type Change = fn(&mut RawSkeleton);
    // The change lasts for so many ticks, and then the other one. For another session the client has to be silent
    // until its lease ends.
    let cases: [(PersonChange, u64, Change, Change); 4] = [
        (PersonChange::FirstOfIngest, 0, |_| {}, |_| {}),
        (PersonChange::Session, TICK_HZ * 11 / 10, |_| {}, |f| f.session_nonce += 1),
        (PersonChange::Operator, 0, |_| {}, |f| f.operator_id += 1),
        (PersonChange::Doubtful, TICK_HZ * 6 / 10, stretch, |_| {}),
    ];
    for (change, ticks, spoil, after) in cases {
        let mut scene = ENGAGED.clone();
        if change == PersonChange::FirstOfIngest {
            scene.world.restart_ingest();
        }
        run(&mut scene, ticks, &mut |f| {
            spoil(f);
            change != PersonChange::Session
        });
        run(&mut scene, TICK_HZ, &mut |f| {
            after(f);
            true
        });
        let changed = |made: &&Transition| made.why == Fault::PersonChanged as u32;
        let about: Vec<_> = explain::newest_transitions(&scene.status, u32::MAX)
            .filter(changed)
            .map(|made| Subject::from_code(made.about))
            .collect();
        assert_eq!(about, [Some(Subject::Person(change))]);
        assert_eq!(scene.mode, Mode::Disengaged, "{change:?}: the enable is held, but the robot was released");
        assert_eq!(scene.world.report().violations_total(), 0, "{:?}", scene.world.report().violations());
    }
}
