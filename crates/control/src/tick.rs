//! The tick: engage, follow, limit, gate, send.

use crate::following::{Following, Reference};
use crate::gripping::Gripping;
use crate::one_arm::Anchor;
use crate::report::Report;
use crate::robot_state::Robot;
use crate::target::{Target, Targets};
use crate::{Commanded, Commander, Config, Continue, Input, Output, Stream};
use messages::{GripperMotion, Header, JointCommand, JointMotion, Layout, Mode, Stamp, command_flag, reduced_flag};
use safety::engage::{self, MotionView};
use safety::gate;

/// State between two ticks.
#[derive(Clone, Debug)]
pub struct State {
    incarnation: u32,
    sequence: u64,
    last_k: Option<u64>,
    targets: Targets,
    robot: Robot,
    stream: Option<Stream>,
    engage: engage::State,
    following: Following,
    anchor: Anchor,
    pub(super) commander: Commander,
    gripping: Gripping,
    motion: MotionView,
    pub(super) report: Report,
}

impl State {
    /// Creates the state of a control process that has just started.
    pub fn new(config: &Config, incarnation: u32) -> Self {
        Self {
            incarnation,
            sequence: 0,
            last_k: None,
            targets: Targets::default(),
            robot: Robot::new(&config.model),
            stream: None,
            engage: engage::State::default(),
            following: Following::default(),
            anchor: Anchor::default(),
            commander: Commander::at_rest(&config.wbc, config.model.home),
            gripping: Gripping::default(),
            motion: MotionView::default(),
            report: Report::default(),
        }
    }
}

/// Motion of arms and grippers that both gates have passed.
pub(super) struct Gated {
    pub(super) arms: Commanded,
    pub(super) grippers: GripperMotion,
    /// Reason of a denial, of the arms or of a gripper.
    pub(super) denied: Option<gate::Denial>,
}

/// Advances control to tick `k`. Never allocates, blocks, reads a clock or panics.
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: Input<'_>) -> Output {
    let missed = state.receive(config, now, &input);
    let continues = state.continue_stream(input.k);
    let target = state.targets.reduced(&config.model, input.operator.left_out);

    let decided = state.engage(config, now, &input, missed);
    let command = continues.then(|| {
        let target = target.as_ref().filter(|target| target.may_be_followed);
        let reference = state.follow(config, &input, &decided, target);
        let limited = state.limit(config, now, input.k, decided.permit, reference.as_ref());
        let gated = state.gate(config, now, input.k, &decided, limited, target);
        state.view_motion(config, &gated, target);
        state.report.record_command(config, decided.mode, reference.as_ref(), &gated);
        state.send(config, now, input.k, &decided, &gated, target)
    });
    state.record(config, now, &input, &decided, missed, target.as_ref());
    Output { command, status: state.report.status, transition: decided.transition }
}

impl State {
    /// Takes what is new since the last tick. Returns the number of ticks that were missed.
    fn receive(&mut self, config: &Config, now: Stamp, input: &Input<'_>) -> u64 {
        let missed = self.last_k.map_or(0, |last| input.k.saturating_sub(last + 1));
        self.last_k = Some(input.k);
        self.targets.receive(config, now, [input.target, input.policy]);
        let &JointMotion { q, .. } = self.commander.commanded();
        let takes_over = [0, 1].map(|side| input.operator.takes_over[side] && !input.operator.left_out[side]);
        self.targets.lead(&config.model, now, takes_over, &q, self.engage.mode());
        let first_second = self.report.status.speed_scale <= engage::SPEED_SCALE_FIRST;
        let begins = self.engage.mode() == Mode::Engaging && first_second;
        self.robot.receive(config, now, input.robot, begins);
        self.report.receive(now, input.ingest);
        missed
    }

    /// Prepares the stream for index `k`. If the driver has left it, every stage continues from the driver's state.
    /// Returns false if there is nothing to continue from.
    fn continue_stream(&mut self, k: u64) -> bool {
        match Stream::prepare(&mut self.stream, self.robot.state(), k, self.incarnation) {
            Continue::Nothing => false,
            Continue::Own => true,
            Continue::From(motion) => {
                self.commander.reseed(&motion);
                if let Some(executed) = self.robot.state() {
                    self.gripping.reseed(&executed.grippers);
                }
                true
            }
        }
    }

    /// Decides which motion is allowed.
    fn engage(&mut self, config: &Config, now: Stamp, input: &Input<'_>, missed: u64) -> engage::Output {
        let (robot, posture) = self.robot.view(config, self.engage.mode(), &self.commander);
        if let Some(posture) = posture {
            self.report.record_robot(config, &self.robot, &posture, self.motion);
        }
        let observed = engage::Input {
            k: input.k,
            own_gap_ns: (missed + 1) * 1_000_000_000 / messages::TICK_HZ,
            deadlines_missed: u32::try_from(missed).unwrap_or(u32::MAX),
            realtime_ok: input.realtime_ok,
            operator: input.operator,
            target: self.targets.view(),
            robot,
            motion: self.motion,
        };
        let mut decided = engage::tick(&config.engage, &mut self.engage, now, observed);
        if let Some(transition) = &mut decided.transition
            && let Some(subject) = self.report.subject_of(transition, self.targets.change)
        {
            transition.about = subject;
        }
        self.set_payloads(config, &input.operator.payload, &decided);
        decided
    }

    /// Computes where the arms should be. An arm that is left out stays.
    fn follow(
        &mut self,
        config: &Config,
        input: &Input<'_>,
        decided: &engage::Output,
        target: Option<&Target>,
    ) -> Option<Reference> {
        let &JointMotion { q, v, .. } = self.commander.commanded();
        let reference = self.following.reference(config, input.k, (&q, &v), decided.permit, target, is_late(decided));
        self.anchor.hold(&config.model, reference, &q, input.operator.left_out)
    }

    /// Limits the reference to what is certified.
    fn limit(
        &mut self,
        config: &Config,
        now: Stamp,
        k: u64,
        permit: engage::Permit,
        reference: Option<&Reference>,
    ) -> wbc::Output {
        self.commander.propose(&config.wbc, k, now, reference.map(Reference::as_target), permit)
    }

    /// Passes the motion of the arms and that of the grippers through their gates. A denied gripper stops the robot from
    /// the next tick on. The arms' motion of this tick was not denied.
    fn gate(
        &mut self,
        config: &Config,
        now: Stamp,
        k: u64,
        decided: &engage::Output,
        limited: wbc::Output,
        target: Option<&Target>,
    ) -> Gated {
        let arms = self.commander.check(&config.gate, k, now, limited, decided.permit);
        let target = target.filter(|_| !is_late(decided));
        let (grippers, gripper_denied) = self.gripping.tick(config, decided.mode, target);
        Gated { denied: arms.denied.or(gripper_denied), arms, grippers }
    }

    /// Builds the command of this tick, and continues the stream with it.
    fn send(
        &mut self,
        config: &Config,
        now: Stamp,
        k: u64,
        decided: &engage::Output,
        gated: &Gated,
        target: Option<&Target>,
    ) -> JointCommand {
        let Commanded { motion, denied, proposed } = &gated.arms;
        let chain = self.stream.as_mut().map(|stream| {
            stream.sent(k, *motion);
            stream.chain()
        });
        self.sequence += 1;
        JointCommand {
            header: Header {
                sequence: self.sequence,
                stamp: now,
                origin: target.map_or(Stamp::NONE, |target| target.origin),
                config_hash: config.config_hash,
                incarnation: self.incarnation,
                reserved: 0,
            },
            robot: config.model.id(),
            k,
            seed_k: chain.map_or(0, |chain| chain.seed_k),
            seed_played: chain.map_or(0, |chain| chain.seed_played),
            target_stamp: target.map_or(Stamp::NONE, |target| target.stamp),
            mode: decided.mode as u32,
            flags: proposed.command_flags(denied.is_some()) | sources(decided, target) << command_flag::SOURCES_SHIFT,
            reset_count: decided.reset_count,
            grippers: gated.grippers,
            ..JointCommand::ZERO
        }
        .with_motion(motion)
    }

    /// Keeps what engagement will see of this command in the next tick.
    fn view_motion(&mut self, config: &Config, gated: &Gated, target: Option<&Target>) {
        let motion = &gated.arms.motion;
        let closeness = self.following.closeness(config, target, &motion.q, &motion.v);
        self.motion = MotionView {
            at_rest: motion.v.iter().chain(&motion.a).all(|value| value.abs() <= driver::REST_TOLERANCE),
            aligned: closeness.aligned,
            behind: closeness.behind,
            settled: closeness.settled,
            gate_denied: gated.denied.is_some(),
        };
    }

    /// Completes the status of this tick.
    fn record(
        &mut self,
        config: &Config,
        now: Stamp,
        input: &Input<'_>,
        decided: &engage::Output,
        missed: u64,
        target: Option<&Target>,
    ) {
        self.report.record_tick(config, (now, missed), input, decided, self.incarnation);
        self.report.record_payload(&self.commander.wbc().payload());
        self.report.record_following(config, now, &self.robot, target);
        self.report.status.sources = sources(decided, target.filter(|target| target.may_be_followed));
    }
}

/// Bits of `source_flag`: who leads each arm. Zero while nobody is followed.
fn sources(decided: &engage::Output, target: Option<&Target>) -> u32 {
    let follows = matches!(decided.permit, engage::Permit::Follow { .. });
    target.filter(|_| follows).map_or(0, |target| target.sources)
}

/// A late target is where the person was, not where the person is going.
fn is_late(decided: &engage::Output) -> bool {
    decided.reduced & reduced_flag::TARGET_LATE != 0
}
