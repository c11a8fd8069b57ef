//! The operator: engages, holds, releases, resets and engages again, as a sensible person would.

use crate::active::{Active, Faults};
use crate::kinds::{Fault, OperatorFault as Of};
use crate::remote::Remote;
use messages::{Fault as Reason, Faults as Reasons, Mode, Stamp, Status, TICK_HZ};
use operator::OperatorEdges;
use rand::RngExt;
use safety::engage::OperatorView;

/// Ticks between two looks of the operator at the status. Control sends it 50 times a second.
const LOOK: u64 = TICK_HZ / 50;
/// Pause of the operator between two actions, ticks: 0.3 s. This is longer than the enable must be released.
const REST: u64 = TICK_HZ * 3 / 10;
/// How long the operator waits for a requested change, ticks: 0.2 s.
const WAIT: u64 = TICK_HZ / 5;
/// How long every second press of an operator at another machine is held without effect, ticks: 1 s. A session of the link ends
/// and begins in less.
const REMOTE_WAIT: u64 = TICK_HZ;
/// How long the operator waits for a robot that holds, ticks: 0.8 s.
const HOLD: u64 = TICK_HZ * 4 / 5;
/// Age at which the operator server revokes the enable of a silent client, ticks: `operator::LEASE_NS`.
const LEASE: u64 = operator::LEASE_NS * TICK_HZ / 1_000_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Act {
    #[default]
    Idle,
    Enabling,
    Recovering,
}

#[derive(Clone, Default)]
pub struct OperatorModel {
    view: operator::OperatorCounts,
    edges: OperatorEdges,
    /// The view that control received last.
    counted: operator::OperatorCounts,
    act: Act,
    since: u64,
    /// Ticks since the last heartbeat got through.
    silent: u64,
    mode: Mode,
    reasons: Reasons,
}

impl OperatorModel {
    /// Creates an operator who has just connected.
    pub(crate) fn new() -> Self {
        let view = operator::OperatorCounts { connections: 1, ..Default::default() };
        Self { view, ..Self::default() }
    }

    pub fn read(&mut self, k: u64, status: &Status) {
        if k.is_multiple_of(LOOK) {
            self.mode = Mode::from_u32(status.mode).unwrap_or(Mode::Faulted);
            self.reasons = Reasons(status.faults);
        }
    }

    pub fn has_let_go(&self) -> bool {
        !self.view.held.enable_level && !self.view.held.recover_level
    }

    /// Has arms taken over from a policy, as long as it is called in every tick.
    pub fn take_over(&mut self, arms: [bool; 2]) {
        self.view.held.takes_over = arms;
    }

    fn let_go(&mut self) {
        if !self.has_let_go() {
            self.view.release_edges += 1;
        }
        self.hold_nothing();
    }

    fn hold_nothing(&mut self) {
        let held = &mut self.view.held;
        (held.enable_level, held.recover_level, held.clutch_level, held.left_out) = (false, false, false, [false; 2]);
        (self.act, self.since) = (Act::Idle, 0);
    }

    /// Decides what a sensible person does next, at another machine or here.
    fn decide(&mut self, is_remote: bool) {
        let start = Reasons::NONE.with(Reason::StartOutsideLimits).with(Reason::StartInCollision);
        match self.act {
            Act::Idle if self.since < REST => {}
            Act::Idle if self.mode == Mode::Faulted => {
                self.view.reset_edges += 1;
                self.since = 0;
            }
            Act::Idle if self.mode == Mode::Disengaged => {
                self.since = 0;
                if self.reasons.0 & start.0 != 0 {
                    self.view.recover_edges += 1;
                    (self.view.held.recover_level, self.act) = (true, Act::Recovering);
                } else {
                    self.view.enable_edges += 1;
                    (self.view.held.enable_level, self.act) = (true, Act::Enabling);
                }
            }
            Act::Idle => {}
            Act::Enabling => {
                let is_patient = is_remote && self.view.enable_edges.is_multiple_of(2);
                let wait = if is_patient { REMOTE_WAIT } else { WAIT };
                let refused = matches!(self.mode, Mode::Disengaged | Mode::Faulted) && self.since > wait;
                let held_up = self.mode == Mode::Holding && self.since > HOLD;
                if matches!(self.mode, Mode::Engaging | Mode::Engaged) {
                    self.since = 0;
                }
                if refused || held_up {
                    self.let_go();
                }
            }
            Act::Recovering if self.mode != Mode::Recovering && self.since > WAIT => self.let_go(),
            Act::Recovering => {}
        }
    }

    /// Advances to the next tick, at `now`. Returns two views if `control` runs: the one that `control`
    /// receives, and the true one that the oracle uses. Edges wait until `control` runs. An operator at another machine is
    /// what arrives of him.
    pub fn tick(
        &mut self,
        k: u64,
        now: Stamp,
        runs: bool,
        faults: &mut Faults,
        remote: Option<&mut Remote>,
    ) -> Option<[OperatorView; 2]> {
        self.since += 1;
        self.silent += 1;
        let mut speaks = true;
        let mut decides = k.is_multiple_of(LOOK);
        let of_hand = |fault| if let Fault::Operator(of) = fault { Some(of) } else { None };
        faults.each(of_hand, |active, of| {
            let free = matches!(of, Of::Elsewhere | Of::Stuck | Of::Conflict | Of::Disconnect | Of::Silent);
            decides &= !free;
            self.suffer(active, of, &mut speaks)
        });
        if decides {
            self.decide(remote.is_some());
        }
        if speaks {
            self.view.connections = 1;
            self.view.held.heartbeat_received = now;
            self.silent = 0;
        }
        let arrived = remote.map_or(self.view, |remote| remote.view(k, now, speaks, &self.view));
        runs.then(|| {
            self.edges.add(&arrived);
            let (view, before, is) = (self.edges.drain(), self.counted, arrived);
            self.counted = is;
            let done = OperatorView {
                connected: view.connected,
                enable_edge: is.enable_edges != before.enable_edges,
                recover_edge: is.recover_edges != before.recover_edges,
                release_edge: is.release_edges != before.release_edges,
                reset_edge: is.reset_edges != before.reset_edges,
                estop_edge: is.estop_edges != before.estop_edges,
                payload: view.payload,
                ..is.held
            };
            [view, done]
        })
    }

    fn suffer(&mut self, active: &mut Active, of: Of, speaks: &mut bool) -> bool {
        let moving = matches!(self.mode, Mode::Engaging | Mode::Engaged);
        match of {
            Of::Release if self.view.held.enable_level && active.rng.random_range(0..20) == 0 => self.let_go(),
            Of::Silent => {
                *speaks = false;
                // In half of the episodes the server notices the silence. In the others, control notices it by
                // the age of the view.
                if active.episode.param.is_multiple_of(2) && self.silent == LEASE {
                    self.lose();
                }
                return self.silent.is_multiple_of(LOOK);
            }
            Of::Disconnect => {
                *speaks = false;
                if active.age == 0 {
                    self.lose();
                    self.view.connections = 0;
                    return true;
                }
                return false;
            }
            Of::Stop if moving && active.rng.random_range(0..40) == 0 => self.view.estop_edges += 1,
            Of::StopEngaging if self.mode == Mode::Engaging && active.rng.random_range(0..60) == 0 => {
                self.view.estop_edges += 1;
            }
            Of::StopChatter if active.rng.random_range(0..5) == 0 => {
                self.view.estop_edges += 1;
                self.view.reset_edges += u64::from(active.rng.random::<bool>());
            }
            // The reset comes at once, while the robot still moves.
            Of::StopChatter if active.rng.random_range(0..8) == 0 => self.view.reset_edges += 1,
            Of::Elsewhere => {
                if active.age == 0 {
                    self.let_go();
                }
                return false;
            }
            Of::Stuck => {
                self.view.held.enable_level = active.age + 1 < active.episode.ticks;
                let pressed = active.age.is_multiple_of(100);
                self.view.enable_edges += u64::from(pressed);
                (self.act, self.since) = (Act::Idle, 0);
                return pressed;
            }
            Of::Conflict => {
                let mut some = || u64::from(active.rng.random_range(0..3) == 0);
                self.view.enable_edges += some();
                self.view.recover_edges += some();
                self.view.release_edges += some();
                self.view.reset_edges += some();
                self.view.estop_edges += some() * some();
                self.view.held.enable_level = some() == 0;
                self.view.held.recover_level = !self.view.held.enable_level && some() == 1;
                self.view.held.clutch_level = some() == 1;
                self.view.held.left_out = [some() == 1, some() == 1];
                (self.act, self.since) = (Act::Idle, 0);
                if active.age + 1 >= active.episode.ticks {
                    self.let_go();
                }
            }
            Of::ResetHeld => self.view.reset_edges += 1,
            Of::Release | Of::Stop | Of::StopEngaging | Of::StopChatter => return false,
        }
        true
    }

    /// The server revokes the enable of a client that it lost.
    fn lose(&mut self) {
        if !self.has_let_go() {
            self.view.holders_lost += 1;
        }
        self.hold_nothing();
    }
}
