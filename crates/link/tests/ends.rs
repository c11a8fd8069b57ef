//! Both ends over a wire that loses, delays, repeats and reorders, with two clocks that agree in nothing.

use crate::world::{Daemon, MS, World};
use link::{Down, FRAME_BYTES_MAX, OperatorEnd, Refusal, RobotEnd, Sent, Verdict};
use messages::{HOLDS_CLUTCH, HOLDS_ENABLE, OperatorRequest, Stamp};
use proptest::prelude::*;

/// A link whose enable is held.
fn pressed() -> World {
    let mut world = World::linked(5 * MS);
    world.press();
    world.run(10);
    world
}

#[test]
fn pressed_enable_a_release_and_a_payload_arrive_once_and_persons_are_young() {
    let mut world = World::linked(5 * MS);
    assert_eq!((world.verdict(), world.holds()), (Verdict::Ready, (0, 0)));
    world.press();
    world.run(10);
    assert_eq!(world.holds(), (1, HOLDS_ENABLE));
    world.let_go();
    (world.request.payload_count, world.request.payload_kg) = (1, 0.5);
    world.run(10);
    let last = world.daemon.requests.last().expect("a request");
    assert_eq!((last.enable_count, last.release_count, last.payload_count, last.payload_kg), (1, 1, 1, 0.5));
    assert!(world.daemon.persons.len() > 15 && world.daemon.persons.iter().all(|age| *age == 5 * MS));
    assert!(world.operator.is_linked(world.theirs()));
    let link = world.operator.link(world.theirs());
    assert_eq!((link.lost, link.answer.map(|answer| answer.verdict)), (0, Some(Verdict::Ready)));
    assert!(link.round_trip_ns.is_some_and(|ns| ns <= 10 * MS), "{link:?}");
}

#[test]
fn f125_partition_is_a_release_and_the_level_held_over_it_engages_nothing() {
    for broken in [[true, true], [true, false], [false, true]] {
        let mut world = pressed();
        let before = world.daemon.requests.len();
        world.broken = broken;
        world.run(30);
        assert!(!world.operator.is_linked(world.theirs()) || broken == [true, false], "{broken:?}");
        if broken[0] {
            assert_eq!(
                (world.daemon.connections, world.daemon.requests.len()),
                (0, before),
                "the connection is closed"
            );
        }
        // Pressed once more while nothing arrives.
        world.press();
        world.run(5);
        world.broken = [false; 2];
        world.run(100);
        assert_eq!(world.verdict(), Verdict::Ready);
        assert_eq!(world.holds().0, 0, "{broken:?}: no edge in the new session");
        world.press_again();
        assert_eq!(world.holds(), (1, HOLDS_ENABLE), "{broken:?}");
    }
}

#[test]
fn lost_datagrams_lose_no_edge() {
    let mut world = World::linked(5 * MS);
    world.press();
    for n in 0..60 {
        world.broken[0] = n % 3 != 2;
        world.step();
    }
    assert_eq!(world.holds(), (1, HOLDS_ENABLE));
    let state = world.robot.state(0, Stamp(world.now)).expect("an operator");
    assert!(state.lost > 60 && state.received > 60, "{state:?}");
}

#[test]
fn f127_enable_pressed_before_the_clocks_are_synchronised_counts_never() {
    let mut world = World::new([5 * MS; 2]);
    world.run(2);
    world.press();
    world.run(1);
    assert_eq!(world.verdict(), Verdict::Unsynchronised);
    assert!(world.refusals.contains(&Refusal::Clock), "a person without a clock");
    assert!(world.daemon.persons.is_empty());
    world.run(60);
    assert_eq!((world.verdict(), world.holds().0), (Verdict::Ready, 0));
    world.press_again();
    assert_eq!(world.holds(), (1, HOLDS_ENABLE));
}

#[test]
fn f127_uncertain_clocks_engage_nothing_and_keep_the_clutch() {
    // 30 ms each way: an uncertainty of 30 ms.
    let mut world = World::linked(30 * MS);
    assert_eq!(world.verdict(), Verdict::Uncertain);
    world.press();
    world.request.enable_level |= HOLDS_CLUTCH;
    world.run(10);
    assert_eq!(world.holds(), (0, HOLDS_CLUTCH));
    assert!(!world.daemon.persons.is_empty(), "persons are young enough");
}

#[test]
fn f126_late_persons_and_requests_are_refused() {
    let mut world = pressed();
    let before = world.daemon.persons.len();
    world.delays = [97 * MS, 5 * MS];
    world.run(20);
    assert!(world.refusals.iter().filter(|refusal| **refusal == Refusal::Old).count() > 10, "{:?}", world.refusals);
    assert_eq!(world.daemon.persons.len(), before);
    assert_eq!(world.daemon.connections, 0, "late heartbeats are none");
}

#[test]
fn f126_enable_that_arrives_too_late_does_not_come_with_the_next_heartbeat() {
    let mut world = World::linked(5 * MS);
    world.delays[0] = 110 * MS;
    world.press();
    world.run(3);
    world.advance(world.now + 120 * MS);
    assert!(world.refusals.contains(&Refusal::Old), "{:?}", world.refusals);
    world.delays[0] = 5 * MS;
    world.run(3);
    assert_eq!((world.daemon.connections, world.holds()), (1, (0, HOLDS_ENABLE)), "the same session");
}

#[test]
fn f126_replayed_session_changes_nothing() {
    let mut world = pressed();
    let capture = world.captured.clone();
    world.let_go();
    world.run(3);
    // Within the session.
    let (requests, persons) = (world.daemon.requests.len(), world.daemon.persons.len());
    for bytes in capture.iter().rev().take(10) {
        assert!(matches!(world.arrive(bytes).outcome, Err(Refusal::Order | Refusal::Rate)));
    }
    // In the next one.
    world.cut(30);
    world.run(30);
    world.refusals.clear();
    for bytes in &capture {
        assert!(world.arrive(bytes).outcome.is_err());
        world.now += 5 * MS;
    }
    // Copies cost no token, so the operator keeps its rate.
    assert!(world.refusals.iter().all(|refusal| *refusal == Refusal::Order), "{:?}", world.refusals);
    world.run(30);
    assert_eq!((world.holds().0, world.daemon.stops), (0, 0));
    assert!(world.daemon.requests.len() > requests.min(20) && world.daemon.persons.len() > persons);
}

#[test]
fn f126_new_datagram_with_another_session_number_is_refused() {
    let mut world = World::linked(5 * MS);
    let mut out = [0; FRAME_BYTES_MAX];
    world.press();
    let length = world.operator.heartbeat(&world.request, world.theirs(), &mut out);
    // The session's number is the 16th byte and the seven after it.
    out[16] ^= 64;
    assert_eq!(world.arrive(&out[..length]).outcome, Err(Refusal::Session));
    out[16] ^= 64;
    assert!(matches!(world.arrive(&out[..length]).outcome, Ok(Sent::Request(_))));
}

#[test]
fn f127_clock_that_jumps_releases_and_has_to_be_synchronised_again() {
    for jump in [3_600_000 * MS as i64, -3_600_000 * MS as i64, 300 * MS as i64] {
        let mut world = World::linked(5 * MS);
        world.ahead = 5_000_000 * MS as i64;
        world.run(100);
        world.press_again();
        assert_eq!(world.holds(), (1, HOLDS_ENABLE));
        let jumps = world.robot.refused(0).count_of(Refusal::Jump);
        let sent = world.daemon.requests.len();
        world.ahead += jump;
        world.run(4);
        assert!(world.robot.refused(0).count_of(Refusal::Jump) > jumps, "{jump}: {:?}", world.robot.refused(0));
        let released = world.daemon.requests.iter().skip(sent).any(|request| request.enable_level == 0);
        assert!(released || world.daemon.requests.len() < sent, "{jump}: released, or in a new session");
        world.run(100);
        assert_eq!(world.verdict(), Verdict::Ready);
        assert_eq!(world.holds().1, HOLDS_ENABLE, "the level alone grants nothing");
        let edges = world.holds().0;
        world.press_again();
        assert_eq!(world.holds(), (edges + 1, HOLDS_ENABLE));
    }
}

#[test]
fn f125_emergency_stop_counts_without_clock_session_or_youth() {
    // Before anything is known.
    let mut world = World::new([5 * MS; 2]);
    world.request.estop_count = 1;
    world.run(1);
    assert_eq!(world.daemon.stops, 1);
    world.run(50);
    // The same press, in a hundred datagrams and another session.
    let stops =
        |world: &World| world.daemon.stops + world.daemon.requests.last().map_or(0, |last| last.estop_count as usize);
    world.cut(30);
    world.run(50);
    assert_eq!(stops(&world), 1);
    // In the session, by the request.
    world.request.estop_count = 2;
    world.run(3);
    assert_eq!(stops(&world), 2);
    // Too old.
    world.delays[0] = 500 * MS;
    world.request.estop_count = 3;
    world.run(30);
    assert_eq!(world.daemon.stops, 2);
    // A second program of the same operator presses it.
    let mut rival = OperatorEnd::new(78);
    let mut out = [0; FRAME_BYTES_MAX];
    let request = OperatorRequest { estop_count: 1, ..world.request };
    let length = rival.heartbeat(&request, world.theirs(), &mut out);
    assert!(world.arrive(&out[..length]).stop);
    let length = rival.heartbeat(&request, world.theirs(), &mut out);
    assert!(!world.arrive(&out[..length]).stop, "once");
}

#[test]
fn f125_emergency_stop_that_was_heard_is_not_repeated_by_a_restart() {
    let mut world = World::linked(5 * MS);
    world.request.estop_count = 1;
    world.run(20);
    for heard in [true, false] {
        // The way down carries what was heard. Cut, the press may have been lost with the robot's end.
        world.broken[1] = !heard;
        world.request.estop_count += u32::from(!heard);
        world.run(5);
        (world.robot, world.daemon) = (RobotEnd::default(), Daemon::default());
        world.broken[1] = false;
        world.run(40);
        assert_eq!(world.daemon.stops, usize::from(!heard), "heard {heard}");
        world.request.estop_count += 1;
        world.run(20);
        let relayed = world.daemon.requests.last().map_or(0, |last| last.estop_count as usize);
        assert_eq!(world.daemon.stops + relayed, 1 + usize::from(!heard), "the next press, heard {heard}");
    }
}

#[test]
fn f125_emergency_stop_that_waits_for_the_daemon_is_repeated_by_a_restart() {
    let mut world = World::linked(5 * MS);
    world.request.estop_count = 1;
    world.robot.stop_waits = true;
    world.run(20);
    (world.robot, world.daemon) = (RobotEnd::default(), Daemon::default());
    world.run(20);
    assert_eq!(world.daemon.stops, 1);
}

#[test]
fn f129_second_program_of_an_operator_waits_until_the_first_is_silent() {
    let mut world = pressed();
    let mut rival = OperatorEnd::new(78);
    let mut out = [0; FRAME_BYTES_MAX];
    let length = rival.heartbeat(&world.request, world.theirs(), &mut out);
    assert_eq!(world.arrive(&out[..length]).outcome, Err(Refusal::Busy));
    let length = world.robot.answer_rival(0, Stamp(world.now), &mut out).expect("an answer");
    let received = rival.receive(&out[..length], world.theirs()).expect("an answer");
    assert!(matches!(received, Down::Answer(answer) if answer.verdict == Verdict::Busy), "{received:?}");
    assert_eq!(world.robot.answer_rival(0, Stamp(world.now), &mut out), None);
    world.run(5);
    assert_eq!(world.holds(), (1, HOLDS_ENABLE), "undisturbed");
    world.broken = [true; 2];
    world.run(15);
    let length = rival.heartbeat(&world.request, world.theirs(), &mut out);
    assert_eq!(world.arrive(&out[..length]).outcome, Ok(Sent::Began));
    let length = world.robot.answer(0, Stamp(world.now), &mut out).expect("an answer");
    rival.receive(&out[..length], world.theirs()).expect("the session");
    assert!(rival.is_linked(world.theirs()));
}

#[test]
fn f128_flood_is_refused_above_the_rate_and_disturbs_no_other_operator() {
    let mut world = World::linked(5 * MS);
    let mut flood = OperatorEnd::new(5);
    let mut out = [0; FRAME_BYTES_MAX];
    let mut admitted = 0;
    for n in 0..10_000_u64 {
        // 10,000 datagrams in a second, from another place.
        let length = flood.heartbeat(&world.request, Stamp(1 + n), &mut out);
        let taken = world.robot.receive(1, &out[..length], Stamp(world.now + n * MS / 10), || 9);
        admitted += u64::from(taken.outcome != Err(Refusal::Rate));
    }
    assert!((250..=266).contains(&admitted), "{admitted}");
    assert_eq!(world.robot.refused(1).count_of(Refusal::Rate), 10_000 - admitted);
    world.press();
    world.run(10);
    assert_eq!((world.holds(), world.robot.refused(0).count_of(Refusal::Rate)), ((1, HOLDS_ENABLE), 0));
}

#[test]
fn restarted_robot_end_gets_a_new_session_and_engages_nothing() {
    let mut world = pressed();
    world.robot = RobotEnd::default();
    world.daemon = Daemon::default();
    world.run(60);
    assert_eq!((world.verdict(), world.holds().0), (Verdict::Ready, 0));
    assert!(world.operator.is_linked(world.theirs()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    /// Loss, jitter, reordering and repeats, with a press now and then.
    #[test]
    fn no_wire_makes_a_person_old_or_an_edge_out_of_nothing(
        wire in prop::collection::vec((0_u64..160, 0_u64..160, 0_u8..10, any::<bool>()), 400),
        ahead_ms in -900_000_i64..900_000,
    ) {
        let mut world = World::new([0; 2]);
        world.ahead = ahead_ms * MS as i64;
        let mut presses = 0;
        for (n, (there, back, luck, calm)) in wire.into_iter().enumerate() {
            let calm = calm || n % 100 < 50;
            world.delays = if calm { [2 * MS; 2] } else { [there * MS, back * MS] };
            world.broken = [luck < 2 && !calm, luck == 1 && !calm];
            if n % 40 == 39 {
                world.let_go();
            }
            if n % 40 == 0 {
                world.press();
                presses += 1;
            }
            world.step();
            if luck == 9 {
                let again = world.captured[world.captured.len() / 2].clone();
                world.arrive(&again);
            }
            prop_assert!(world.daemon.persons.iter().all(|age| *age <= 100 * MS));
            let edges = world.daemon.requests.last().map_or(0, |last| last.enable_count);
            prop_assert!(edges <= presses);
        }
        prop_assert!(!world.daemon.persons.is_empty());
    }
}
