use super::*;
use messages::{Layout, StopPlan, deadline};
use wbc::JointStop;

const A: f64 = 8.0;
const PERIOD: u64 = 6;
const START: u64 = 1_500;

/// A stream, the tick at which it is, and everything that it sent since.
struct Rig {
    stream: Stream,
    k: u64,
    pressed: Option<bool>,
    sent: Vec<(u64, Position)>,
}

impl Rig {
    fn new(weighs: bool) -> Self {
        let mut stream = Stream::new(2, PERIOD, weighs, [A; JOINTS_MAX]);
        stream.begin(&[0.3; JOINTS_MAX], deadline(START));
        Self { stream, k: START, pressed: Some(false), sent: Vec::new() }
    }

    fn sample(&self, off: f64) -> Sample {
        let q = self.stream.held().map(|q| q + off);
        Sample { measured: deadline(self.k), q, dq: [0.0; JOINTS_MAX] }
    }

    fn step(&mut self, commands: &[Command]) {
        self.k += PERIOD;
        let sample = self.sample(0.0);
        let known = Observation { now: deadline(self.k), sample: Some(&sample), pressed: self.pressed };
        if let Some(position) = self.stream.next(commands, &known) {
            self.sent.push((self.k, position));
        }
    }

    fn turn_for(&mut self, seconds: f64) {
        (0..(seconds / TICK_S) as u64 / PERIOD).for_each(|_| self.step(&[]));
    }

    fn speed_up(&mut self) {
        let begin = self.k;
        for _ in 0..50 {
            let k = self.k + PERIOD;
            self.step(&[Command { k, motion: moving((k - begin) as f64 * TICK_S) }]);
        }
        assert!(self.stream.follows() && self.stream.last.motion.v[0] > 0.3);
    }

    fn jolt(&self) -> f64 {
        let h = PERIOD as f64 * TICK_S;
        let q: Vec<f64> = self.sent.iter().map(|(_, position)| position.q[0]).collect();
        q.windows(3).map(|q| (q[2] - 2.0 * q[1] + q[0]).abs() / (h * h * A)).fold(0.0, f64::max)
    }

    /// Largest rate of the weight, 1/s.
    fn rate(&self) -> f64 {
        let rate = |pair: &[(u64, Position)]| {
            (pair[1].1.weight - pair[0].1.weight).abs() / ((pair[1].0 - pair[0].0) as f64 * TICK_S)
        };
        self.sent.windows(2).map(rate).fold(0.0, f64::max)
    }
}

/// A motion with 2 rad/s^2 from rest at 0.3 rad, `t` seconds after it began.
fn moving(t: f64) -> JointMotion {
    let mut motion = JointMotion::rest([0.3 + t * t; JOINTS_MAX]);
    let mut plan = StopPlan::ZERO;
    (motion.v, motion.a) = ([2.0 * t; JOINTS_MAX], [2.0; JOINTS_MAX]);
    for j in 0..JOINTS_MAX {
        JointStop::new(2.0 * t, 2.0, A, 320.0).store(&mut plan, j);
    }
    motion.plan = plan;
    motion
}

#[test]
fn weight_rises_and_falls_slowly_where_the_robot_is_held() {
    let mut rig = Rig::new(true);
    rig.turn_for(4.9);
    assert!(!rig.stream.follows(), "the loop may not move it yet");
    rig.turn_for(0.2);
    assert!(rig.stream.follows() && rig.stream.weight == 1.0);
    assert!(rig.sent.iter().all(|(_, position)| position.q == [0.3; JOINTS_MAX]));
    rig.stream.depart("the driver ends".to_owned());
    rig.turn_for(4.9);
    assert!(!rig.stream.is_released());
    rig.turn_for(0.2);
    assert!(rig.stream.is_released() && rig.stream.weight == 0.0);
    assert!((rig.rate() - WEIGHT_RATE_PER_S).abs() < 1e-9, "{}", rig.rate());
    let count = rig.sent.len();
    rig.step(&[Command { k: rig.k + PERIOD, motion: JointMotion::rest([0.3; JOINTS_MAX]) }]);
    assert!(rig.sent.len() == count && !rig.stream.follows(), "it was given back for good");
}

#[test]
fn f118_silent_loop_lets_the_thread_play_the_stop() {
    for weighs in [false, true] {
        let mut rig = Rig::new(weighs);
        rig.turn_for(5.1);
        rig.speed_up();
        let before = rig.stream.held()[0];
        rig.turn_for(1.0);
        assert!(rig.stream.departed().expect("it departed").contains("silent"));
        assert!(rig.stream.last.motion.is_at_rest() && rig.stream.held()[0] > before + 1e-3, "it stops ahead");
        assert_eq!(rig.stream.is_released(), !weighs);
    }
}

#[test]
fn stop_of_the_thread_keeps_the_acceleration() {
    let mut rig = Rig::new(false);
    rig.step(&[]);
    rig.speed_up();
    rig.stream.depart("the robot fell silent".to_owned());
    rig.turn_for(1.0);
    assert!(rig.stream.is_released() && rig.jolt() < 1.1, "{}", rig.jolt());
}

#[test]
fn joint_that_is_not_where_it_was_sent_departs() {
    let names = ["a".to_owned(), "b".to_owned()];
    // Behind, the way of the last 0.14 s comes on top: 0.05 rad at the end of this motion.
    for (off, departs) in [(0.0, false), (0.04, false), (-0.08, false), (0.06, true), (-0.12, true), (f64::NAN, true)] {
        let mut rig = Rig::new(false);
        rig.step(&[]);
        rig.speed_up();
        let sample = rig.sample(off);
        rig.stream.compare(&sample, &names);
        assert_eq!(rig.stream.departed().is_some(), departs, "{off}");
    }
    // A joint that lags by 0.1 s is where it was sent then, and no farther.
    let mut rig = Rig::new(false);
    rig.step(&[]);
    rig.speed_up();
    let sample = Sample { q: rig.sent[rig.sent.len() - 26].1.q, ..rig.sample(0.0) };
    rig.stream.compare(&sample, &names);
    assert_eq!(rig.stream.departed(), None);
}

#[test]
fn jump_or_step_of_the_speed_is_never_sent() {
    for (off, v) in [(0.2, 0.0), (0.01, 0.0), (0.0, -0.4)] {
        let mut rig = Rig::new(false);
        rig.step(&[]);
        rig.speed_up();
        let mut command = rig.stream.last;
        command.k = rig.k + PERIOD;
        command.motion.q = command.motion.q.map(|q| q + off);
        command.motion.v = command.motion.v.map(|before| before + v);
        rig.step(&[command]);
        assert!(!rig.stream.follows(), "{off}, {v}");
        let step = rig.sent[rig.sent.len() - 1].1.q[0] - rig.sent[rig.sent.len() - 2].1.q[0];
        assert!(step.abs() < 0.003, "{off}, {v}: {step}");
    }
}

#[test]
fn robot_that_stood_during_a_pause_is_not_set_in_motion_again() {
    for has_command in [false, true] {
        let mut rig = Rig::new(false);
        rig.step(&[]);
        rig.speed_up();
        let last = rig.sent[rig.sent.len() - 1].1.q;
        rig.k += STOOD_TICKS;
        let mut command = rig.stream.last;
        command.k = rig.k + PERIOD;
        command.motion.q = command.motion.q.map(|q| q + 0.01);
        rig.step(if has_command { std::slice::from_ref(&command) } else { &[] });
        assert!(!rig.stream.follows());
        rig.turn_for(0.5);
        assert!(rig.stream.is_released() && rig.sent[rig.sent.len() - 1].1.q == last, "{has_command}");
    }
}

#[test]
fn pressed_robot_gets_where_it_is_and_is_joined_again_there() {
    let mut rig = Rig::new(false);
    rig.step(&[]);
    rig.speed_up();
    rig.pressed = Some(true);
    rig.turn_for(0.1);
    let sagged = Sample { q: [0.25; JOINTS_MAX], ..rig.sample(0.0) };
    rig.k += PERIOD;
    let known = Observation { now: deadline(rig.k), sample: Some(&sagged), pressed: Some(true) };
    assert_eq!(rig.stream.next(&[], &known).expect("it is due").q, sagged.q);
    rig.pressed = Some(false);
    rig.turn_for(0.1);
    assert!(rig.stream.is_released());
    let names = ["a".to_owned(), "b".to_owned()];
    rig.stream.compare(&rig.sample(0.0), &names);
    let command = |k: u64, q: f64| [Command { k, motion: JointMotion::rest([q; JOINTS_MAX]) }];
    rig.step(&command(rig.k + PERIOD, 0.25));
    assert!(!rig.stream.follows(), "it has not stood yet");
    rig.turn_for(0.3);
    rig.step(&command(rig.k + PERIOD, 0.26));
    assert!(!rig.stream.follows(), "the loop is elsewhere");
    let stale = Sample { measured: deadline(rig.k - 100), ..rig.sample(0.0) };
    let known = Observation { now: deadline(rig.k), sample: Some(&stale), pressed: Some(false) };
    rig.stream.next(&command(rig.k, 0.25), &known);
    assert!(!rig.stream.follows(), "nothing was heard of it");
    rig.step(&command(rig.k + PERIOD, 0.25));
    assert!(rig.stream.follows() && rig.stream.departed().is_none());
}

#[test]
fn robot_that_sags_before_its_stop_shows_gets_where_it_is() {
    let mut rig = Rig::new(false);
    rig.step(&[]);
    rig.speed_up();
    rig.stream.depart("a joint is elsewhere".to_owned());
    rig.turn_for(1.0);
    assert!(rig.stream.is_released());
    rig.pressed = Some(true);
    let look = |rig: &mut Rig, q: f64| {
        rig.k += PERIOD;
        let sagged = Sample { q: [q; JOINTS_MAX], ..rig.sample(0.0) };
        let known = Observation { now: deadline(rig.k), sample: Some(&sagged), pressed: Some(true) };
        rig.stream.next(&[], &known).map(|position| position.q)
    };
    assert_eq!(look(&mut rig, 0.2), Some([0.2; JOINTS_MAX]));
    rig.stream.depart("the robot fell silent".to_owned());
    assert_eq!(look(&mut rig, 0.1), Some([0.1; JOINTS_MAX]), "silence does not leave it at an old position");
    rig.stream.end();
    look(&mut rig, 0.1);
    assert!(rig.stream.is_released() && look(&mut rig, 0.0).is_none(), "the end of the program ends it");
}
