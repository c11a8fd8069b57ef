//! Control and a simulated robot in virtual time, with targets that a test chooses.
#![allow(dead_code, unreachable_pub)]

pub mod scene;

use config::{Loaded, Overrides};
use messages::{
    ALL_JOINTS, Faults, Header, JOINTS_MAX, JointTarget, Layout, Mode, RobotState, Stamp, Status, TICK_HZ,
    TRAJECTORY_NODE_TICKS, Transition, deadline, target_flag,
};
use rand::RngExt;
use robot::{Frames, Model};
use safety::engage::OperatorView;
use std::path::{Path, PathBuf};
use world::simulated;

/// Joints of TIAGo++, and of them its lift, those of its left arm, and the left elbow.
pub const JOINTS: usize = 17;
pub const TORSO: usize = 0;
pub const LEFT_ARM: std::ops::Range<usize> = 3..10;
pub const ELBOW: usize = 6;

/// Tick at which virtual time begins. A stamp of zero means "never".
const FIRST_K: u64 = 1500;

/// A file of the shipped configuration.
pub fn shipped(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(file)
}

/// The settings of the repository.
pub fn loaded() -> Loaded {
    config::load(&shipped("teleop.toml"), Overrides::default()).expect("the settings of the repository")
}

/// Writes the settings of the repository with a changed text to this folder. They name the shipped files by their whole paths.
pub fn write_settings(folder: &Path, edit: impl FnOnce(String) -> String) -> PathBuf {
    let text = std::fs::read_to_string(shipped("teleop.toml")).expect("shipped");
    let whole = |start: &str| format!("\"{}", shipped(start).display());
    let text = text.replace("\"robots/", &whole("robots/")).replace("\"../weights/", &whole("../weights/"));
    let path = folder.join("teleop.toml");
    std::fs::write(&path, edit(text)).expect("written");
    path
}

/// The configuration of `ingest` with these settings.
pub fn input_config(loaded: &Loaded) -> ingest::Config {
    let layouts = loaded.layouts.clone();
    world::input_config(&loaded.settings.ingest, layouts, &loaded.operators, loaded.lifter.clone())
}

/// Control, the robot, and an operator.
#[derive(Clone)]
pub struct Bench {
    pub config: control::Config,
    control: Box<control::State>,
    robot_config: Box<simulated::Config>,
    pub robot: Box<simulated::State>,
    hash: u64,
    k: u64,
    echo: Option<RobotState>,
    pub target: Option<[f64; JOINTS_MAX]>,
    /// The rest of a target. Without a limb trajectory, the joints are followed.
    pub person: Box<JointTarget>,
    /// Flags of the target beside `INPUT_FRESH`.
    pub more_flags: u32,
    pub hand: OperatorView,
    pub status: Status,
    /// Flags of the last command.
    pub command_flags: u32,
}

impl Bench {
    /// Creates a robot at rest at `initial`, which may be any posture.
    pub fn new(loaded: &Loaded, initial: [f64; JOINTS_MAX], seed: u64) -> Self {
        let options = simulated::Options {
            driver: checker::Options { initial_outside: true, ..checker::Options::default() },
            robot: plant::Options { initial_outside: true, ..plant::Options::default() },
            initial: Some(initial),
        };
        Self::with_options(loaded, &options, seed)
    }

    /// Creates a robot with these options, at rest.
    pub fn with_options(loaded: &Loaded, options: &simulated::Options, seed: u64) -> Self {
        let config = world::control_config(loaded, true).expect("control");
        let robot_config = Box::new(simulated::Config::new(&loaded.model, options).expect("the simulated robot"));
        Self {
            control: Box::new(control::State::new(&config, 1)),
            robot: Box::new(simulated::State::new(&robot_config, FIRST_K, seed)),
            robot_config,
            config,
            hash: loaded.hash,
            k: FIRST_K,
            echo: None,
            target: None,
            person: Box::new(JointTarget::ZERO),
            more_flags: 0,
            hand: OperatorView { connected: true, ..OperatorView::default() },
            status: Status::ZERO,
            command_flags: 0,
        }
    }

    /// Creates a robot that is Disengaged at home, with commands accepted and home as the target.
    pub fn at_home(seed: u64) -> Self {
        let loaded = loaded();
        let mut bench = Self::new(&loaded, loaded.model.home, seed);
        bench.target = Some(loaded.model.home);
        bench.settle();
        bench
    }

    /// Creates a robot that is Engaged at home.
    pub fn engaged(seed: u64) -> Self {
        let mut bench = Self::at_home(seed);
        bench.engage();
        bench
    }

    /// Replaces the driver's process by a new one.
    pub fn restart_driver(&mut self) -> bool {
        self.robot.restart_driver(&self.robot_config, self.k, deadline(self.k), 2)
    }

    /// Presses the enable and waits for Engaged.
    pub fn engage(&mut self) {
        self.press_enable();
        for _ in 0..5 * TICK_HZ {
            self.step();
            if self.mode() == Mode::Engaged {
                return;
            }
        }
        panic!("not engaged: {:?} {:?}", self.mode(), Faults(self.status.faults));
    }

    pub fn model(&self) -> &Model {
        &self.config.model
    }

    pub fn mode(&self) -> Mode {
        Mode::from_u32(self.status.mode).expect("a mode")
    }

    pub fn commanded(&self) -> messages::JointMotion {
        self.robot.follower().motion
    }

    /// The robot's last state.
    pub fn echo(&self) -> RobotState {
        self.echo.expect("the robot has spoken")
    }

    fn last_transition(&self) -> Transition {
        let kept = messages::TRANSITIONS_KEPT;
        self.status.transitions[(self.status.transition_count as usize + kept - 1) % kept]
    }

    /// Cause of the last transition.
    pub fn last_why(&self) -> u32 {
        self.last_transition().why
    }

    /// Runs one tick of everything. It clears the edges.
    pub fn step(&mut self) {
        self.step_measuring(|_| {});
    }

    /// Runs this number of ticks.
    pub fn steps(&mut self, ticks: u64) {
        (0..ticks).for_each(|_| self.step());
    }

    /// Runs one tick in which the operator presses the reset.
    pub fn reset(&mut self) {
        self.hand.reset_edge = true;
        self.step();
    }

    /// Runs one tick of everything. `wrong` changes the robot's state on its way to control.
    pub fn step_measuring(&mut self, wrong: impl Fn(&mut RobotState)) {
        self.k += 1;
        let now = deadline(self.k);
        let target = self.target.map(|q| JointTarget {
            header: self.header(now, 7),
            robot: self.config.model.id(),
            k: self.k,
            q,
            input_received: now,
            valid_mask: ALL_JOINTS,
            flags: target_flag::INPUT_FRESH | self.more_flags,
            session_nonce: 70,
            trajectory_first: self.k / TRAJECTORY_NODE_TICKS + 1,
            ..*self.person
        });
        self.hand.heartbeat_received = now;
        let robot = self.echo.map(|mut state| {
            wrong(&mut state);
            state
        });
        let input = control::Input {
            k: self.k,
            target: target.as_ref(),
            policy: None,
            robot: robot.as_ref(),
            operator: self.hand,
            ingest: None,
            realtime_ok: true,
        };
        let out = control::tick(&self.config, &mut self.control, now, input);
        self.status = out.status;
        self.command_flags = out.command.map_or(0, |command| command.flags);
        let hand = &mut self.hand;
        (hand.enable_edge, hand.recover_edge, hand.release_edge) = (false, false, false);
        (hand.reset_edge, hand.estop_edge) = (false, false);
        hand.payload = [None; 2];
        let input = driver::DriveInput { due_k: self.k, command: out.command.as_ref() };
        let mut state = simulated::tick(&self.robot_config, &mut self.robot, now, input).state;
        state.header = self.header(now, 9);
        self.echo = Some(state);
    }

    fn header(&self, now: Stamp, incarnation: u32) -> Header {
        Header { sequence: self.k, stamp: now, origin: now, config_hash: self.hash, incarnation, reserved: 0 }
    }

    /// Waits until control has seen the enable released and the driver accepts commands.
    pub fn settle(&mut self) {
        self.steps(TICK_HZ / 4);
        assert_eq!(self.mode(), Mode::Disengaged);
    }

    pub fn press_enable(&mut self) {
        (self.hand.enable_edge, self.hand.enable_level, self.hand.recover_level) = (true, true, false);
    }

    pub fn press_recovery(&mut self) {
        (self.hand.recover_edge, self.hand.recover_level, self.hand.enable_level) = (true, true, false);
    }

    pub fn let_go(&mut self) {
        (self.hand.release_edge, self.hand.enable_level, self.hand.recover_level) = (true, false, false);
    }

    /// Checks that no executed step broke a limit, by the robot's own checker.
    pub fn assert_no_violations(&self, context: &str) {
        let report = self.robot.report();
        assert_eq!(report.violations_total(), 0, "{context}: {:?}", report.first_violation);
    }
}

/// A random posture within the limits. `inset` is the share of a joint's range that is left out at each end.
pub fn random_posture(model: &Model, rng: &mut impl RngExt, inset: f64) -> [f64; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let limits = &model.limits[j];
        let inset = inset * (limits.q_max - limits.q_min);
        if j < model.count { rng.random_range(limits.q_min + inset..limits.q_max - inset) } else { 0.0 }
    })
}

/// Distances of all checked pairs, and of moving parts from all obstacles, at a posture, m, by the arithmetic of
/// `robot`.
pub fn distances(model: &Model, frames: &mut Frames, q: &[f64; JOINTS_MAX]) -> Vec<f64> {
    model.forward(q, frames);
    let axes: Vec<_> = model.capsules.iter().map(|capsule| capsule.ends(frames)).collect();
    let between = |pair: &robot::Pair| {
        let (a, b) = (&axes[pair.a], &axes[pair.b]);
        let radii = model.capsules[pair.a].radius_m + model.capsules[pair.b].radius_m;
        robot::segment_distance(&a[0], &a[1], &b[0], &b[1]).distance_m - radii
    };
    let mut out: Vec<f64> = model.pairs.iter().map(between).collect();
    for (axis, capsule) in axes.iter().zip(&model.capsules).filter(|(_, capsule)| capsule.body != 0) {
        let from = |obstacle: &robot::Obstacle| obstacle.solid.segment_distance(&axis[0], &axis[1]) - capsule.radius_m;
        out.extend(model.obstacles.iter().map(from));
    }
    out
}

/// The smallest of [`distances`].
pub fn clearance(model: &Model, frames: &mut Frames, q: &[f64; JOINTS_MAX]) -> f64 {
    distances(model, frames, q).into_iter().fold(f64::INFINITY, f64::min)
}
