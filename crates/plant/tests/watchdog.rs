//! Behaviour of the drives when setpoints stay away, and when they come back.

use crate::support::{ELBOW, HANDS, START, TICK_NS, config, rest, setpoint};
use messages::{JOINTS_MAX, Layout, Stamp, StopPlan};
use plant::{Config, Options, Plant, Reaction, Setpoint};

const WATCHDOG_NS: u64 = 10_000_000;
/// The speed at which setpoints stay away, rad/s.
const SPEED: f64 = 0.5;

/// Moves the elbow at [`SPEED`] until setpoints stay away. Returns the plant, the last setpoint and its time.
fn moving(reaction: Reaction) -> (Config, Plant, Setpoint, Stamp) {
    moving_with(HANDS[3], reaction)
}

fn moving_with(urdf: &str, reaction: Reaction) -> (Config, Plant, Setpoint, Stamp) {
    let options = Options { reaction, watchdog_ns: WATCHDOG_NS, delay_ns: 0, ..Options::default() };
    let config = Config::from_text(HANDS[0], HANDS[1], HANDS[2], urdf, &options).unwrap();
    let mut q = *config.home();
    let mut plant = Plant::new(&config, START, &q, 1);
    let (mut k, mut v) = (0, 0.0);
    let mut last = rest(0, q);
    while v < SPEED {
        assert!(plant.receive(&config, START.plus_ns(k * TICK_NS), &last));
        (k, v) = (k + 1, v + 2.0 / 1500.0);
        q[ELBOW] += v / 1500.0;
        let (mut speeds, mut a) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        (speeds[ELBOW], a[ELBOW]) = (v, if v < SPEED { 2.0 } else { 0.0 });
        last = setpoint(k, q, speeds, a);
    }
    // Stop from v, at rest in acceleration: jerk -j for t, then +j for t with j t^2 = v.
    let t = 0.25;
    last.plan.jerk[ELBOW] = [-last.v[ELBOW] / (t * t), last.v[ELBOW] / (t * t), 0.0];
    last.plan.duration_s[ELBOW] = [t, t, 0.0];
    let now = START.plus_ns(k * TICK_NS);
    assert!(plant.receive(&config, now, &last));
    (config, plant, last, now)
}

#[test]
fn silence_shorter_than_watchdog_is_extrapolated() {
    let (config, mut plant, last, now) = moving(Reaction::Hold);
    plant.advance(&config, now.plus_ns(WATCHDOG_NS));
    assert!(!plant.reacting());
    let expected = last.q[ELBOW] + SPEED * WATCHDOG_NS as f64 * 1e-9;
    assert!((plant.truth().q[ELBOW] - expected).abs() < 0.002);
    let mut next = last;
    (next.k, next.q[ELBOW]) = (last.k + 15, expected);
    assert!(plant.receive(&config, now.plus_ns(WATCHDOG_NS), &next));
    plant.advance(&config, now.plus_ns(WATCHDOG_NS + 1_000_000));
    assert!(!plant.reacting() && (plant.truth().v[ELBOW] - SPEED).abs() < 0.03);
}

/// A driver was suspended between making a setpoint and sending it.
#[test]
fn setpoint_older_than_watchdog_reaction_is_refused() {
    let (config, mut plant, last, now) = moving(Reaction::Hold);
    plant.advance(&config, now.plus_ns(600_000_000));
    let old = Setpoint { q: plant.truth().q, v: [0.0; JOINTS_MAX], k: last.k + 1, ..last };
    assert!(!plant.receive(&config, now.plus_ns(TICK_NS), &old), "it is near, and 0.6 s old");
    assert!(plant.reacting());
    let new = Setpoint { k: last.k + 900, ..old };
    assert!(plant.receive(&config, now.plus_ns(600_000_000), &new));
}

#[test]
fn setpoint_without_plan_is_braked_and_not_stopped_at_once() {
    let after = |plan: bool| {
        let (config, mut plant, mut last, now) = moving(Reaction::Play);
        if !plan {
            (last.k, last.plan) = (last.k + 1, StopPlan::ZERO);
            last.q[ELBOW] += SPEED * TICK_NS as f64 * 1e-9;
            assert!(plant.receive(&config, now.plus_ns(TICK_NS), &last));
        }
        plant.advance(&config, now.plus_ns(TICK_NS + WATCHDOG_NS + 15_000_000));
        assert!(plant.reacting());
        let speed = plant.truth().v[ELBOW];
        plant.advance(&config, now.plus_ns(700_000_000));
        (speed, plant.truth().v[ELBOW])
    };
    for plan in [true, false] {
        let (speed, rest) = after(plan);
        // 10 rad/s^2 for 15 ms take 0.15 rad/s. A reference that stands at once pulls a drive of 15 Hz to rest in
        // that time.
        assert!(speed > 0.6 * SPEED && rest.abs() < 1e-3, "with a plan: {plan}: {speed} rad/s, then {rest}");
    }
}

#[test]
fn hold_stops_within_braking_distance() {
    let (config, mut plant, last, now) = moving(Reaction::Hold);
    plant.advance(&config, now.plus_ns(WATCHDOG_NS + 1_000_000));
    assert!(plant.reacting() && plant.measure(&config, now.plus_ns(WATCHDOG_NS + 1_000_000)).reacting);
    plant.advance(&config, now.plus_ns(600_000_000));
    let way = plant.truth().q[ELBOW] - last.q[ELBOW];
    let a_max = config.body().joints[ELBOW].limits.a_max;
    let expected = SPEED * WATCHDOG_NS as f64 * 1e-9 + SPEED * SPEED / (2.0 * a_max);
    assert!((way - expected).abs() < 0.004, "{way} {expected}");
    assert!(plant.truth().v[ELBOW].abs() < 1e-3 && plant.reacting());
}

#[test]
fn damped_motors_stop_robot_later_than_held_ones() {
    let (config, mut plant, last, now) = moving(Reaction::Damp);
    plant.advance(&config, now.plus_ns(999_000_000));
    plant.advance(&config, now.plus_ns(1_900_000_000));
    let way = plant.truth().q[ELBOW] - last.q[ELBOW];
    let limits = &config.body().joints[ELBOW].limits;
    let (braked, damped) = (SPEED * SPEED / (2.0 * limits.a_max), SPEED * limits.v_max / limits.a_max);
    // Friction, which is not compensated now, shortens the way.
    assert!(way > 1.1 * braked && way < 0.9 * damped, "{way} {braked} {damped}");
    assert!(plant.truth().v.iter().all(|v| v.abs() < 0.005) && plant.reacting(), "{:?}", plant.truth().v);
    // Without friction only the motors damp.
    let smooth = HANDS[3].replace("effort=\"26\"/>", "effort=\"26\"/><dynamics damping=\"0\" friction=\"0\"/>");
    let (config, mut plant, last, now) = moving_with(&smooth, Reaction::Damp);
    plant.advance(&config, now.plus_ns(999_000_000));
    plant.advance(&config, now.plus_ns(1_900_000_000));
    let way = plant.truth().q[ELBOW] - last.q[ELBOW];
    assert!((way / damped - 1.0).abs() < 0.1, "{way} {damped}");
}

#[test]
fn play_reaction_follows_plan_to_its_end() {
    let (config, mut plant, last, now) = moving(Reaction::Play);
    // Within the first phase, J t^3 / 6 short of the way at full speed, with J = v / T^2.
    let (at_s, braked) = (0.15, last.v[ELBOW] / (0.25 * 0.25) * 0.15_f64.powi(3) / 6.0);
    plant.advance(&config, now.plus_ns(150_000_000));
    let way = plant.truth().q[ELBOW] - last.q[ELBOW];
    assert!((way - (last.v[ELBOW] * at_s - braked)).abs() < 0.002, "{way}");
    // Within the second phase, s seconds before its end at 2 T: J s^3 / 6 short of the end.
    let end = last.q[ELBOW] + last.v[ELBOW] * 0.25;
    plant.advance(&config, now.plus_ns(350_000_000));
    let short = last.v[ELBOW] / (0.25 * 0.25) * 0.15_f64.powi(3) / 6.0;
    assert!((plant.truth().q[ELBOW] - (end - short)).abs() < 0.001, "{}", plant.truth().q[ELBOW] - end);
    plant.advance(&config, now.plus_ns(700_000_000));
    // A stop of two equal phases takes v T.
    let expected = end;
    assert!((plant.truth().q[ELBOW] - expected).abs() < 0.001, "{} {expected}", plant.truth().q[ELBOW]);
    assert!(plant.truth().v[ELBOW].abs() < 1e-3 && plant.reacting());
}

#[test]
fn setpoint_after_reaction_is_accepted_only_near_robot_state() {
    for reaction in [Reaction::Hold, Reaction::Damp, Reaction::Play] {
        let (config, mut plant, last, now) = moving(reaction);
        plant.advance(&config, now.plus_ns(30_000_000));
        let here = rest(last.k + 1, plant.truth().q);
        assert!(!plant.receive(&config, now.plus_ns(30_000_000), &here), "{reaction:?}: it moves faster");
        let mut later = now.plus_ns(1_000_000_000);
        plant.advance(&config, later);
        later = later.plus_ns(900_000_000);
        plant.advance(&config, later);
        let stood = plant.truth().q;
        let mut elsewhere = stood;
        elsewhere[ELBOW] -= 0.03;
        assert!(!plant.receive(&config, later, &rest(last.k + 2, elsewhere)), "{reaction:?}: it began elsewhere");
        let mut fast = rest(last.k + 3, stood);
        fast.v[ELBOW] = 0.11;
        assert!(!plant.receive(&config, later, &fast), "{reaction:?}: it began too fast");
        assert!(plant.reacting());
        assert!(plant.receive(&config, later, &rest(last.k + 4, stood)));
        plant.advance(&config, later.plus_ns(2_000_000));
        assert!(!plant.reacting());
    }
}

#[test]
fn setpoint_that_is_not_newer_is_ignored() {
    let (config, mut plant, last, now) = moving(Reaction::Hold);
    let mut old = last;
    (old.k, old.q[ELBOW]) = (last.k - 1, last.q[ELBOW] - 0.3);
    assert!(plant.receive(&config, now.plus_ns(TICK_NS), &old));
    plant.advance(&config, now.plus_ns(6 * TICK_NS));
    assert_eq!(plant.followed().0.k, last.k);
}

/// The setpoint that ends a silence may still be under way when the watchdog would fire.
#[test]
fn setpoint_in_transport_delays_watchdog() {
    let options = Options { delay_ns: 5_000_000, watchdog_ns: WATCHDOG_NS, ..Options::default() };
    let config = config(HANDS, &options);
    for (gap_ns, reacts) in [(14_000_000, false), (16_000_000, true)] {
        let mut plant = Plant::new(&config, START, config.home(), 1);
        assert!(plant.receive(&config, START, &rest(1, *config.home())));
        // Without another one the watchdog fires at 5 ms + 10 ms.
        plant.receive(&config, START.plus_ns(gap_ns), &rest(2, *config.home()));
        plant.advance(&config, START.plus_ns(18_000_000));
        assert_eq!(plant.reacting(), reacts, "{gap_ns}");
    }
}
