//! Every stage in virtual time, with a person who plays a motion, and an operator.

use super::loaded;
use client::{PlayOptions, Player};
use config::Loaded;
use messages::{JointCommand, Layout, Mode, RawSkeleton, Status, TICK_S};
use motion::{CalibrationMode, Motion};
use safety::engage::OperatorView;
use world::{Links, Moment, Running, World, WorldConfig};

/// A world, a client that plays a motion in a loop, and an operator.
#[derive(Clone)]
pub struct Scene {
    pub config: WorldConfig,
    pub world: World,
    pub player: Player,
    pub hand: OperatorView,
    /// Number of chunks of a policy so far.
    pub sequence: u64,
    pub mode: Mode,
    /// The person stands still, or nobody is there.
    pub stands: bool,
    pub nobody: bool,
    pub status: Status,
    pub command: JointCommand,
    /// Largest step of a commanded velocity beyond what the acceleration limits allow, rad/s and m/s.
    pub worst_step: f64,
}

/// A client that plays the motion in a loop, at `speed` times its speed.
pub fn player(motion: &Motion, speed: f64, session: u64) -> Player {
    let options = PlayOptions { speed, looped: true, calibration: CalibrationMode::First10s };
    Player::new(motion, options, session, session as u32)
}

impl Scene {
    /// Creates a scene with the shipped settings and the built-in motion.
    pub fn new(seed: u64) -> Self {
        Self::with(&loaded(), player(&motion::builtin(), 1.0, 1), seed)
    }

    pub fn with(loaded: &Loaded, player: Player, seed: u64) -> Self {
        let config = WorldConfig::new(loaded).expect("the shipped settings");
        Self {
            world: World::new(&config, seed, Links::default()),
            config,
            player,
            hand: OperatorView { connected: true, ..OperatorView::default() },
            sequence: 0,
            mode: Mode::Disengaged,
            stands: false,
            nobody: false,
            status: Status::ZERO,
            command: JointCommand::ZERO,
            worst_step: f64::NEG_INFINITY,
        }
    }

    /// Presses the enable, and holds it from the next tick on.
    pub fn press_enable(&mut self) {
        (self.hand.enable_edge, self.hand.enable_level) = (true, true);
    }

    pub fn step(&mut self) -> Moment {
        self.step_spoiled(&mut |_| true)
    }

    /// Runs one tick. `spoil` gets each frame of the client, and may change it or drop it. The edges of the enable are cleared.
    pub fn step_spoiled(&mut self, spoil: &mut dyn FnMut(&mut RawSkeleton) -> bool) -> Moment {
        let now = self.world.now();
        self.hand.heartbeat_received = now;
        if let Some((_, mut raw)) = self.player.due(now, self.mode == Mode::Engaged && !self.stands)
            && !self.nobody
            && spoil(&mut raw)
        {
            self.world.publish(&raw);
        }
        let moment = self.world.step(&self.config, &self.hand, Running::ALL);
        (self.hand.enable_edge, self.hand.release_edge) = (false, false);
        let control = moment.control.expect("control runs");
        self.status = control.status;
        self.mode = Mode::from_u32(control.status.mode).expect("a mode");
        if let Some(command) = control.command {
            if self.command.k + 1 == command.k {
                for (j, limits) in self.config.control.model.limits.iter().enumerate() {
                    let step = (command.v[j] - self.command.v[j]).abs() - limits.a_max * TICK_S;
                    self.worst_step = self.worst_step.max(step);
                }
            }
            self.command = command;
        }
        moment
    }
}
