//! Common parts of these tests: a robot, settings, and a state machine that can be brought to any state.
#![allow(dead_code, unreachable_pub)]

pub mod adversary;
pub mod motion;

use messages::{Mode, Stamp, deadline};
use robot::Model;
use safety::engage::{self, Config, Input, Output, Settings, State};
use std::sync::LazyLock;

/// Joints of TIAGo++, and of them its lift and those of its left arm.
pub const JOINTS: usize = 17;
pub const TORSO: usize = 0;
pub const LEFT_ARM: std::ops::Range<usize> = 3..10;

/// The robot of the repository, for tests that do not change it.
pub static MODEL: LazyLock<Model> = LazyLock::new(model);

/// The robot of the repository.
pub fn model() -> Model {
    Model::from_text(
        "tiago_dual.toml",
        include_str!("../../../../config/robots/tiago_dual.toml"),
        "tiago_dual.urdf",
        include_str!("../../../../config/robots/tiago_dual.urdf"),
    )
    .expect("the robot of the repository loads")
}

/// The shipped settings, with the tracking error of soft drives.
pub fn settings() -> Settings {
    Settings {
        tracking_error_rad: 0.05,
        tracking_error_now_rad: 0.15,
        tracking_error_m: 0.01,
        tracking_error_now_m: 0.03,
        ..Settings::default()
    }
}

/// Number of ticks that cover `ms` milliseconds, plus one.
pub fn ticks(ms: u64) -> u64 {
    ms * 1500 / 1000 + 1
}

/// The streams that keep sending, tick by tick.
#[derive(Clone, Copy)]
pub struct Alive {
    pub target: bool,
    pub input: bool,
    pub state: bool,
    pub heartbeat: bool,
}

/// A state machine with its inputs. All inputs are good until a test changes them.
#[derive(Clone)]
pub struct Bench {
    pub config: Config,
    pub state: State,
    pub input: Input,
    pub alive: Alive,
    pub last: Option<Output>,
}

impl Bench {
    pub fn new() -> Self {
        let mut input = Input { k: 1_000_000, own_gap_ns: 666_667, realtime_ok: true, ..Input::default() };
        input.target.config_matches = true;
        input.target.input_fresh = true;
        input.target.incarnation = 7;
        input.target.session_nonce = 70;
        input.robot.config_matches = true;
        input.robot.commanded = true;
        input.robot.incarnation = 9;
        input.robot.reset_count = 41;
        input.robot.at_rest = true;
        input.robot.sample_ns = 666_667;
        input.motion.at_rest = true;
        let config = Config::new(&settings()).expect("the shipped figures are allowed");
        let alive = Alive { target: true, input: true, state: true, heartbeat: true };
        Self { config, state: State::default(), input, alive, last: None }
    }

    pub fn now(&self) -> Stamp {
        deadline(self.input.k)
    }

    /// Does one tick. Edges and events are cleared after it.
    pub fn step(&mut self) -> Output {
        self.input.k += 1;
        let now = self.now();
        for (alive, stamp) in [
            (self.alive.target, &mut self.input.target.received),
            (self.alive.input, &mut self.input.target.input_received),
            (self.alive.state, &mut self.input.robot.received),
            (self.alive.heartbeat, &mut self.input.operator.heartbeat_received),
        ] {
            if alive {
                *stamp = now;
            }
        }
        if !self.alive.state {
            self.input.robot.sample_ns = 0;
        }
        let out = engage::tick(&self.config, &mut self.state, now, self.input);
        let operator = &mut self.input.operator;
        operator.enable_edge = false;
        operator.recover_edge = false;
        operator.release_edge = false;
        operator.reset_edge = false;
        operator.estop_edge = false;
        self.input.own_gap_ns = 666_667;
        self.input.robot.sample_ns = 666_667;
        self.last = Some(out);
        out
    }

    pub fn steps(&mut self, count: u64) -> Output {
        let mut out = self.step();
        for _ in 1..count {
            out = self.step();
        }
        out
    }

    /// Steps until the mode is `mode`, and returns the number of ticks.
    pub fn until(&mut self, mode: Mode, at_most: u64) -> u64 {
        (1..=at_most).find(|_| self.step().mode == mode).unwrap_or_else(|| panic!("no {mode:?} in {at_most} ticks"))
    }

    pub fn disengaged(armed: bool) -> Self {
        let mut bench = Self::new();
        bench.steps(if armed { ticks(200) + 1 } else { 10 });
        bench
    }

    pub fn press(&mut self) {
        self.input.operator.connected = true;
        self.input.operator.enable_level = true;
        self.input.operator.enable_edge = true;
    }

    pub fn press_recovery(&mut self) {
        self.input.operator.connected = true;
        self.input.operator.recover_level = true;
        self.input.operator.recover_edge = true;
    }

    pub fn let_go(&mut self) {
        self.input.operator.enable_level = false;
        self.input.operator.recover_level = false;
        self.input.operator.release_edge = true;
    }

    pub fn engaging() -> Self {
        let mut bench = Self::disengaged(true);
        bench.press();
        assert_eq!(bench.step().mode, Mode::Engaging);
        bench.input.motion.at_rest = false;
        bench
    }

    pub fn engaged() -> Self {
        let mut bench = Self::engaging();
        bench.input.motion.aligned = true;
        bench.until(Mode::Engaged, ticks(1000) + 2);
        bench.input.motion.aligned = false;
        bench
    }

    /// Creates a bench in Holding that still moves. The cause of the hold is gone.
    pub fn holding(resumable: bool) -> Self {
        let mut bench = Self::engaged();
        if resumable {
            bench.input.target.input_fresh = false;
        } else {
            bench.let_go();
        }
        assert_eq!(bench.step().mode, Mode::Holding);
        bench.input.target.input_fresh = true;
        bench
    }

    /// Creates a bench in Holding that can resume. The cause was a measured posture close to a collision.
    pub fn holding_near() -> Self {
        let mut bench = Self::engaged();
        bench.input.robot.collision_near = true;
        bench.until(Mode::Holding, 100);
        bench.input.robot.collision_near = false;
        bench
    }

    /// Creates a disengaged bench with a joint measured outside its limits.
    pub fn outside() -> Self {
        let mut bench = Self::disengaged(true);
        bench.input.robot.outside_limits = true;
        bench.step();
        bench
    }

    /// Creates a bench in Recovering that moves.
    pub fn recovering() -> Self {
        let mut bench = Self::outside();
        bench.press_recovery();
        assert_eq!(bench.step().mode, Mode::Recovering);
        bench.input.motion.at_rest = false;
        bench
    }

    pub fn faulted() -> Self {
        let mut bench = Self::engaged();
        bench.input.operator.estop_edge = true;
        assert_eq!(bench.step().mode, Mode::Faulted);
        bench
    }
}
