//! Plays a motion from its first frame to rest, through every stage, in virtual time. `replay --offline` writes
//! the result.

use crate::world::{Links, Moment, Running, World, WorldConfig};
use client::{PlayOptions, Player};
use config::{ConfigError, Loaded};
use messages::{JOINTS_MAX, Layout, Mode, Status, TICK_HZ};
use motion::Motion;
use safety::engage::OperatorView;
use std::collections::BTreeMap;
use std::convert::Infallible;

/// Seed of the simulated robot's noise. An offline run is the same every time.
const SEED: u64 = 1;

/// Longest time from the enable to Engaged, ticks. Blending takes 3 s, and the torso's whole stroke takes 5 s.
const ENGAGED_WITHIN: u64 = 20 * TICK_HZ;

/// Longest time from release to rest, ticks: four times the longest stop.
const REST_WITHIN: u64 = 2 * TICK_HZ;

/// Ticks before the virtual operator enables: the time for which the enable must have been released, and a margin.
const SETTLE: u64 = TICK_HZ;

/// One row: commanded and target positions of tick `k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Tick since the enable.
    pub k: u64,
    /// Commanded joint positions.
    pub command: [f64; JOINTS_MAX],
    /// Target joint positions.
    pub target: [f64; JOINTS_MAX],
}

/// Reason for which a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OfflineEnd {
    /// The motion was played and the robot is at rest.
    AtRest,
    /// The robot was stopped, or did not engage.
    Stopped(String),
}

/// Report of a run.
#[derive(Clone, Debug, Default)]
pub struct OfflineReport {
    /// Rows produced.
    pub rows: u64,
    /// Every mode and the row at which it began.
    pub modes: Vec<(u64, Mode)>,
    /// Row at which each frame of the motion was published.
    pub frames: Vec<(usize, u64)>,
    /// Violations by kind, as the simulated robot counted them.
    pub violations: BTreeMap<String, u64>,
    /// Smallest clearance of the checked pairs over all executed commands, mm.
    pub min_clearance_mm: f64,
    /// Motions that were proposed but not certified.
    pub fallbacks: u32,
    /// Largest ratio of torque to its joint's effort limit, over all executed commands.
    pub torque_share_max: f64,
    /// Mean limb error of the target while engaged, deg.
    pub limb_error_deg_mean: f64,
    /// Mean limb error of the measured robot while engaged, deg.
    pub limb_error_measured_deg_mean: f64,
}

/// One tick of a run.
#[derive(Clone, Copy, Debug)]
pub struct PlayedTick<'a> {
    /// Events of the tick.
    pub moment: &'a Moment,
    /// The operator's input.
    pub operator: &'a OperatorView,
    /// Row of the tick. `None` before the enable, or if control has no command.
    pub row: Option<Row>,
    /// Frames of the motion played, and their total number.
    pub progress: (u64, u64),
    /// Newest frame of the motion as it is played. `None` before the motion begins.
    pub frame: Option<usize>,
    /// Largest ratio of torque to its joint's effort limit in the executed command, by the dynamics of the links.
    pub torque_share: f64,
}

/// A run in progress.
#[derive(Clone, Debug)]
pub struct Offline {
    config: WorldConfig,
    world: World,
    player: Player,
    mode: Mode,
    enabled: bool,
    released_at: Option<u64>,
    status: Status,
    report: OfflineReport,
    limb_sum_rad: f64,
    limb_measured_sum_rad: f64,
    limb_count: u64,
}

impl Offline {
    /// Creates a robot at rest in its home posture, with the first frame held and an operator about to enable.
    ///
    /// # Errors
    /// Returns an error if a stage rejects the settings.
    pub fn new(loaded: &Loaded, motion: &Motion, options: PlayOptions) -> Result<Self, ConfigError> {
        let config = WorldConfig::new(loaded)?;
        Ok(Self {
            world: World::new(&config, SEED, Links::default()),
            config,
            player: Player::new(motion, options, SEED, 1),
            mode: Mode::Disengaged,
            enabled: false,
            released_at: None,
            status: Status::ZERO,
            report: OfflineReport::default(),
            limb_sum_rad: 0.0,
            limb_measured_sum_rad: 0.0,
            limb_count: 0,
        })
    }

    /// Does the same without the robot's body: its joints are where the last command sent them.
    #[must_use]
    pub(crate) fn without_body(mut self) -> Self {
        self.world.robot_mut().without_body();
        self
    }

    /// Does the same with these faults of the links.
    #[must_use]
    pub fn over(mut self, links: Links) -> Self {
        self.world.set_links(links);
        self
    }

    /// Plays to the end. `each` gets every tick.
    pub fn play(&mut self, mut each: impl FnMut(&PlayedTick<'_>)) -> OfflineEnd {
        let Ok(end) = self.try_play(|tick| {
            each(tick);
            Ok::<_, Infallible>(())
        });
        end
    }

    /// As [`Offline::play`], but an error of `each` ends the run.
    ///
    /// # Errors
    /// Returns the error of `each`.
    pub fn try_play<E>(&mut self, mut each: impl FnMut(&PlayedTick<'_>) -> Result<(), E>) -> Result<OfflineEnd, E> {
        for _ in 0..SETTLE {
            let (moment, operator) = self.moment();
            each(&self.played(&moment, &operator, None))?;
        }
        self.report.modes.push((0, self.mode));
        loop {
            let k = self.report.rows;
            if let Some(end) = self.end(k) {
                return Ok(end);
            }
            if self.released_at.is_none() && self.player.finished() {
                self.released_at = Some(k);
            }
            self.enabled = self.released_at.is_none();
            let (moment, operator) = self.moment();
            self.report.rows += 1;
            let command = moment.control.and_then(|control| control.command);
            let row =
                command.zip(moment.target).map(|(command, target)| Row { k, command: command.q, target: target.q });
            each(&self.played(&moment, &operator, row))?;
            if row.is_none() {
                return Ok(OfflineEnd::Stopped("control had no command to continue from".into()));
            }
        }
    }

    /// The run so far.
    pub fn report(&mut self) -> &OfflineReport {
        let simulated = self.world.report();
        self.report.violations = simulated.violations().iter().map(|&(kind, count)| (kind.to_owned(), count)).collect();
        self.report.min_clearance_mm = simulated.min_clearance_m * 1e3;
        self.report.torque_share_max = simulated.largest_torque_share().0;
        let mean_deg = |sum_rad: f64| (sum_rad / self.limb_count.max(1) as f64).to_degrees();
        self.report.limb_error_deg_mean = mean_deg(self.limb_sum_rad);
        self.report.limb_error_measured_deg_mean = mean_deg(self.limb_measured_sum_rad);
        &self.report
    }

    /// The newest status of `control`, which says why a robot was stopped.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// Frames per second of the motion as it is played.
    pub(crate) fn played_rate_hz(&self) -> f64 {
        self.player.motion().frame_rate_hz
    }

    /// Judgement of the joints' true motion so far.
    pub fn judged(&self) -> &plant::Report {
        self.world.judged()
    }

    fn played<'a>(&self, moment: &'a Moment, operator: &'a OperatorView, row: Option<Row>) -> PlayedTick<'a> {
        let frame = self.report.frames.last().map(|(frame, _)| *frame);
        let torque_share = self.world.report().torque_share;
        PlayedTick { moment, operator, row, progress: self.player.progress(), frame, torque_share }
    }

    /// Returns the reason if the run ends before row `k`.
    fn end(&self, k: u64) -> Option<OfflineEnd> {
        let released = self.released_at;
        let stopped = |why: &str| Some(OfflineEnd::Stopped(why.into()));
        if self.mode == Mode::Faulted {
            return stopped("the robot was stopped by a fault");
        }
        if released.is_some() && self.mode == Mode::Disengaged {
            return Some(OfflineEnd::AtRest);
        }
        if released.is_none() && self.player.started() && self.mode == Mode::Disengaged {
            return stopped("the robot was released before the end of the motion");
        }
        if released.is_none() && !self.player.started() && k > ENGAGED_WITHIN {
            return stopped("the robot did not engage");
        }
        if released.is_some_and(|at| k > at + REST_WITHIN) {
            return stopped("the robot did not come to rest");
        }
        None
    }

    /// Runs client, operator, and one tick of all stages.
    fn moment(&mut self) -> (Moment, OperatorView) {
        let k = self.report.rows;
        let now = self.world.now();
        if let Some((frame, raw)) = self.player.due(now, self.mode == Mode::Engaged) {
            // The last frame is held until the robot is released. It is counted once.
            if self.player.started() && self.report.frames.last().is_none_or(|(last, _)| *last != frame) {
                self.report.frames.push((frame, k));
            }
            self.world.publish(&raw);
        }
        let operator = OperatorView {
            connected: true,
            enable_level: self.enabled,
            enable_edge: self.enabled && k == 0,
            release_edge: self.released_at == Some(k),
            heartbeat_received: now,
            ..OperatorView::default()
        };
        let moment = self.world.step(&self.config, &operator, Running::ALL);
        if let Some(control) = &moment.control {
            (self.status, self.report.fallbacks) = (control.status, control.status.fallbacks);
            let mode = Mode::from_u32(control.status.mode).unwrap_or(Mode::Faulted);
            if mode != self.mode {
                self.mode = mode;
                self.report.modes.push((k, mode));
            }
            if mode == Mode::Engaged {
                self.limb_sum_rad += control.status.limb_error_target_rad;
                self.limb_measured_sum_rad += control.status.limb_error_measured_rad;
                self.limb_count += 1;
            }
        }
        (moment, operator)
    }
}
