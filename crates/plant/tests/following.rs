//! The joints follow the setpoints, and every fault has its effect.

use crate::support::{
    ELBOW, GRIPPERS, HANDS, JOINTS, OPENARM, START, Sines, TICK_NS, UR5E, body, config, rest, setpoint,
};
use messages::{JOINTS_MAX, Stamp};
use plant::{CATCH_UP_NS, Config, Injection, Judge, Options, Plant, STEP_NS, ViolationKind};
use rand::{RngExt, SeedableRng};

/// A robot without noise that stands at home, and the number of the next setpoint.
struct Bench {
    config: Config,
    plant: Plant,
    k: u64,
}

impl Bench {
    fn new(options: Options) -> Self {
        let config = config(HANDS, &Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, ..options });
        let plant = Plant::new(&config, START, config.home(), 1);
        Self { config, plant, k: 0 }
    }

    fn now(&self) -> Stamp {
        START.plus_ns(self.k * TICK_NS)
    }

    /// Sends the elbow to and fro with `ticks` setpoints. Returns how many were taken.
    fn swing_elbow(&mut self, ticks: u64) -> u64 {
        let mut taken = 0;
        for _ in 0..ticks {
            self.k += 1;
            let mut q = *self.config.home();
            let mut sent = rest(self.k, q);
            let (sin, cos) = (2.0 * self.k as f64 / 1500.0).sin_cos();
            q[ELBOW] += 0.1 * (1.0 - cos);
            (sent.q, sent.v[ELBOW], sent.a[ELBOW]) = (q, 0.2 * sin, 0.4 * cos);
            taken += u64::from(self.plant.receive(&self.config, self.now(), &sent));
        }
        taken
    }

    fn hold(&mut self, ticks: u64) -> u64 {
        let mut taken = 0;
        for _ in 0..ticks {
            self.k += 1;
            taken += u64::from(self.plant.receive(&self.config, self.now(), &rest(self.k, *self.config.home())));
        }
        taken
    }

    /// Returns the largest distance from home of any joint except `without`.
    fn away(&self, without: usize) -> f64 {
        let others = (0..JOINTS).filter(|&j| j != without);
        others.map(|j| (self.plant.truth().q[j] - self.config.home()[j]).abs()).fold(0.0, f64::max)
    }

    fn elbow(&self) -> f64 {
        self.plant.truth().q[ELBOW] - self.config.home()[ELBOW]
    }
}

#[test]
fn joints_lag_by_what_their_drives_do_not_know() {
    for texts in [HANDS, GRIPPERS, OPENARM, UR5E] {
        let config = config(texts, &Options::default());
        let (mut rng, mut most) = (rand_pcg::Pcg64::seed_from_u64(11), 0.0_f64);
        for seed in 0..4 {
            let sines = Sines::bearable(&config, &mut rng, 1.0);
            let mut plant = Plant::new(&config, START, &sines.centre, seed);
            let mut judge = Judge::new(&config, &sines.centre);
            for k in 0..6000 {
                let now = START.plus_ns(k * TICK_NS + rng.random_range(0..200_000));
                if k == 3000 {
                    // The sines are full from here on. Before, their growth adds to the accelerations.
                    judge = Judge::new(&config, &plant.truth().q);
                }
                assert!(plant.receive_judged(&config, now, &sines.at(k), &mut judge));
                let (wanted, since) = plant.followed();
                let (t, truth) = (plant.truth().stamp.since(since) as f64 * 1e-9, plant.truth());
                let lags = config.lags(&truth.q, &truth.v);
                for (j, joint) in config.body().joints.iter().enumerate().filter(|_| k >= 3000) {
                    // A drive that turns as fast as it may does not catch up.
                    if wanted.v[j].abs() < 0.9 * joint.urdf.v_max {
                        let q_ref = wanted.q[j] + t * (wanted.v[j] + t * wanted.a[j] / 2.0);
                        let share = (truth.q[j] - q_ref).abs() / lags[j];
                        assert!(share <= 1.0, "{}: joint {j} lags by {share} of {} at {k}", texts[0], lags[j]);
                        most = most.max(share);
                    }
                }
            }
            // These sines do not avoid collisions.
            let report = judge.report();
            assert_eq!(report.total(), report.count(ViolationKind::Clearance), "{:?}", report.first);
        }
        assert!(most > 0.75, "{}: no joint lags by more than {most} of its bound", texts[0]);
    }
}

#[test]
fn unknown_load_lowers_arm_slightly() {
    let mut bench = Bench::new(Options { hands_kg: [Some(0.3), None], ..Options::default() });
    bench.hold(1500);
    assert!((1e-5..5e-3).contains(&bench.away(JOINTS)), "{}", bench.away(JOINTS));
}

#[test]
fn simulation_steps_do_not_depend_on_call_times() {
    let config = config(HANDS, &Options::default());
    let (mut one, mut two) = [1, 1].map(|seed| Plant::new(&config, START, config.home(), seed)).into();
    let sent: Vec<_> = (0..150).map(|k| setpoint(k, *config.home(), [0.005; JOINTS_MAX], [0.0; JOINTS_MAX])).collect();
    for (k, sent) in sent.iter().enumerate() {
        let now = START.plus_ns(k as u64 * TICK_NS);
        for part in 1..7 {
            two.advance(&config, Stamp(now.0.saturating_sub(TICK_NS * (7 - part) / 7).max(two.truth().stamp.0)));
        }
        assert_eq!(one.receive(&config, now, sent), two.receive(&config, now, sent));
    }
    let end = START.plus_ns(300_000_000);
    one.advance(&config, end);
    two.advance(&config, end);
    assert_eq!(one.truth(), two.truth());
}

#[test]
fn time_beyond_bound_of_one_call_is_simulated_by_next_calls() {
    let mut bench = Bench::new(Options::default());
    let now = START.plus_ns(2 * CATCH_UP_NS + CATCH_UP_NS / 2);
    for left in [3, 1, 0] {
        bench.plant.advance(&bench.config, now);
        assert_eq!(bench.plant.behind_ns(now), left * CATCH_UP_NS / 2);
    }
    bench.plant.advance(&bench.config, now.plus_ns(STEP_NS - 1));
    assert_eq!(bench.plant.truth().stamp, now);
}

#[test]
fn setpoint_acts_after_transport_delay() {
    let mut bench = Bench::new(Options { delay_ns: 5_000_000, ..Options::default() });
    let mut q = *bench.config.home();
    q[ELBOW] += 0.01;
    assert!(bench.plant.receive(&bench.config, START, &rest(1, q)));
    bench.plant.advance(&bench.config, START.plus_ns(5_000_000));
    assert!(bench.elbow().abs() < 1e-9);
    bench.plant.advance(&bench.config, START.plus_ns(6_000_000));
    assert!(bench.elbow() > 1e-5);
}

#[test]
fn joint_ends_at_its_mechanical_stop() {
    let mut bench = Bench::new(Options::default());
    let stop = bench.config.body().joints[ELBOW].urdf.q_max;
    let mut q = *bench.config.home();
    for k in 1..4500 {
        q[ELBOW] = (q[ELBOW] + 0.0005).min(stop + 0.1);
        bench.plant.receive(&bench.config, START.plus_ns(k * TICK_NS), &rest(k, q));
    }
    assert_eq!((bench.plant.truth().q[ELBOW], bench.plant.truth().v[ELBOW]), (stop, 0.0));
}

#[test]
fn encoder_has_steps_and_noise() {
    let config = config(HANDS, &Options::default());
    let mut plant = Plant::new(&config, START, config.home(), 7);
    let mut squares = 0.0;
    // The lift slides: its noise and its step in m are a fifth of the others' in rad.
    let steps = (0..JOINTS).map(|j| if j == 0 { 0.2 } else { 1.0 } * Options::default().encoder_step_rad);
    let steps: Vec<f64> = steps.collect();
    for n in 0..2000 {
        let now = START.plus_ns(n * STEP_NS);
        let measured = plant.measure(&config, now);
        assert_eq!(measured, plant.measure(&config, now), "a second look draws no new noise");
        assert_eq!(measured.stamp, now);
        for ((q, home), step) in measured.q.iter().zip(config.home()).zip(&steps) {
            assert!((q / step - (q / step).round()).abs() < 1e-6);
            squares += ((q - home) / step).powi(2);
        }
    }
    // Variance of the noise plus that of the step, step^2 / 12.
    let deviation = (squares / (2000.0 * JOINTS as f64)).sqrt();
    assert!((deviation - (1.0_f64 + 1.0 / 12.0).sqrt()).abs() < 0.02, "{deviation}");
}

#[test]
fn feedback_faults_distort_only_measurement() {
    use Injection::{EncoderJump, EncoderSpike, FeedbackInverted, FeedbackSwapped, FrozenEncoder, NanFeedback};
    let (j, with) = (ELBOW, ELBOW + 1);
    let faults = [
        EncoderJump { joint: j, by: 0.3 },
        EncoderSpike { joint: j, by: 0.3 },
        FrozenEncoder { joint: j },
        Injection::FrozenFeedback,
        NanFeedback { joint: j },
        FeedbackInverted { joint: j },
        FeedbackSwapped { joint: j, with },
    ];
    for fault in faults {
        let mut bench = Bench::new(Options::default());
        bench.swing_elbow(300);
        let before = bench.plant.measure(&bench.config, bench.now());
        bench.plant.inject(fault);
        bench.swing_elbow(300);
        let measured = bench.plant.measure(&bench.config, bench.now());
        let truth = *bench.plant.truth();
        assert!((truth.q[j] - before.q[j]).abs() > 0.01, "it moves on");
        let expected = match fault {
            EncoderJump { .. } | EncoderSpike { .. } => truth.q[j] + 0.3,
            FrozenEncoder { .. } | Injection::FrozenFeedback => before.q[j],
            FeedbackInverted { .. } => 2.0 * before.q[j] - truth.q[j],
            FeedbackSwapped { .. } => truth.q[with],
            _ => f64::NAN,
        };
        let same = (measured.q[j] - expected).abs() < 1e-6;
        assert!(same || (expected.is_nan() && measured.q[j].is_nan()), "{fault:?}: {} {expected}", measured.q[j]);
        bench.swing_elbow(1);
        let next = bench.plant.measure(&bench.config, bench.now().plus_ns(STEP_NS));
        let spike = matches!(fault, EncoderSpike { .. });
        assert_eq!(spike, (next.q[j] - bench.plant.truth().q[j]).abs() < 1e-6, "{fault:?}: only a spike passes");
        bench.plant.repair();
        let repaired = bench.plant.measure(&bench.config, bench.now().plus_ns(2 * STEP_NS));
        assert!((repaired.q[j] - bench.plant.truth().q[j]).abs() < 1e-6);
    }
}

#[test]
fn braked_joint_stands_while_others_follow() {
    for (fault, reported) in
        [(Injection::NotFollowed { joint: ELBOW }, false), (Injection::DriveFault { joint: ELBOW }, true)]
    {
        let mut bench = Bench::new(Options::default());
        bench.swing_elbow(300);
        bench.plant.inject(fault);
        assert_eq!(bench.swing_elbow(300), 300);
        let stopped = bench.elbow();
        bench.swing_elbow(300);
        assert_eq!((bench.elbow(), bench.plant.truth().v[ELBOW]), (stopped, 0.0));
        assert!(bench.away(ELBOW) < 0.003);
        let measured = bench.plant.measure(&bench.config, bench.now());
        assert_eq!(measured.drives.fault, reported);
        assert_eq!(measured.tau[ELBOW], 0.0, "the brake holds it, not the motor");
    }
}

#[test]
fn joint_with_swapped_sign_moves_in_opposite_direction() {
    let mut bench = Bench::new(Options::default());
    bench.plant.inject(Injection::SignSwapped { joint: ELBOW });
    bench.swing_elbow(900);
    let wanted = bench.plant.followed().0.q[ELBOW] - bench.config.home()[ELBOW];
    assert!(wanted > 0.06 && (bench.elbow() + wanted).abs() < 0.005, "{} {wanted}", bench.elbow());
}

#[test]
fn joint_with_swing_fault_swings_about_its_setpoint() {
    let mut bench = Bench::new(Options::default());
    bench.plant.inject(Injection::Swing { joint: ELBOW, amplitude: 0.02, frequency: 4.0 });
    let (mut least, mut most) = (0.0_f64, 0.0_f64);
    for _ in 0..1500 {
        bench.hold(1);
        (least, most) = (least.min(bench.elbow()), most.max(bench.elbow()));
    }
    assert!((least + 0.02).abs() < 0.003 && (most - 0.02).abs() < 0.003, "{least} {most}");
    assert!(bench.away(ELBOW) < 0.003);
}

#[test]
fn emergency_stop_brakes_and_refuses_setpoints() {
    let mut bench = Bench::new(Options::default());
    bench.swing_elbow(300);
    bench.plant.inject(Injection::EmergencyStopPressed);
    assert_eq!(bench.swing_elbow(300), 0);
    assert_eq!(bench.plant.truth().v, [0.0; JOINTS_MAX]);
    assert!(bench.plant.measure(&bench.config, bench.now()).drives.emergency_stop);
    let stopped = bench.plant.truth().q;
    bench.plant.inject(Injection::EmergencyStopReleased);
    assert_eq!(bench.swing_elbow(300), 0, "they begin elsewhere");
    assert!((bench.plant.truth().q[ELBOW] - stopped[ELBOW]).abs() < 1e-6, "the release moves nothing");
    bench.k += 1;
    assert!(bench.plant.receive(&bench.config, bench.now(), &rest(bench.k, stopped)));
}

#[test]
fn joints_without_power_sink_at_configured_rate() {
    let mut bench = Bench::new(Options::default());
    bench.hold(30);
    bench.plant.inject(Injection::PowerLost { sag: 0.05 });
    assert_eq!(bench.hold(1500), 0);
    let measured = bench.plant.measure(&bench.config, bench.now());
    assert!(!measured.drives.powered && measured.tau == [0.0; JOINTS_MAX]);
    assert!((bench.elbow() - 0.05).abs() < 0.002, "{}", bench.elbow());
    bench.plant.inject(Injection::PowerReturned);
    bench.plant.advance(&bench.config, bench.now().plus_ns(200_000_000));
    let (stood, speed) = (bench.elbow(), bench.plant.truth().v[ELBOW]);
    assert!(speed.abs() < 1e-3 && stood < 0.055, "the drives stop it where it is: {stood} {speed}");
}

#[test]
fn setpoint_with_non_finite_number_is_refused() {
    let mut bench = Bench::new(Options::default());
    let home = *bench.config.home();
    for n in 0..6 {
        let mut sent = rest(1, home);
        let bad = if n % 2 == 0 { f64::NAN } else { f64::INFINITY };
        match n {
            0 => sent.q[3] = bad,
            1 => sent.v[3] = bad,
            2 => sent.a[3] = bad,
            3 => sent.plan.jerk[3][1] = bad,
            4 => sent.plan.duration_s[3][1] = bad,
            _ => sent.plan.duration_s[3][2] = -1e-9,
        }
        assert!(!bench.plant.receive(&bench.config, START, &sent), "{n}");
    }
    assert!(bench.plant.receive(&bench.config, START, &rest(1, home)));
}

#[test]
fn options_out_of_bounds_are_refused_by_name() {
    let rows = [
        (Options { natural_frequency_hz: 0.0, ..Options::default() }, "natural_frequency_hz"),
        (Options { damping_ratio: f64::NAN, ..Options::default() }, "damping_ratio"),
        (Options { delay_ns: 1_000_000_000, ..Options::default() }, "delay_ns"),
        (Options { watchdog_ns: 0, ..Options::default() }, "watchdog_ns"),
        (Options { encoder_noise_rad: -1.0, ..Options::default() }, "encoder_noise_rad"),
        (Options { hands_kg: [Some(21.0), None], ..Options::default() }, "hands_kg left"),
    ];
    for (options, name) in rows {
        let error = Config::new(body(HANDS), &options).expect_err(name).to_string();
        assert!(error.contains(name), "{error}");
    }
}
