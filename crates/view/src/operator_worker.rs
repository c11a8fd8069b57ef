//! A page's own connection to the operator socket. A page can only send requests, and `control` decides.

use crate::worker::Worker;
use instance::Instance;
use messages::{Mode, Status};
use operator::{Client, OperatorError, StopPress};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Time between two heartbeats: 50 Hz.
const HEARTBEAT: Duration = Duration::from_millis(20);
/// Timeout of a held enable. The page repeats it ten times a second. After five missed periods the enable is released.
pub const HOLD_FOR: Duration = Duration::from_millis(500);
/// Time after which an enable without effect counts as refused. It is many times a poll of the socket and a tick.
const REFUSED_AFTER: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorCommand {
    /// Press the enable, without the arm that is left out: 0 is the left one, 1 the right one.
    Engage {
        /// See above.
        left_out: Option<usize>,
    },
    /// The enable or the clutch is still held. Does nothing by itself.
    Keep,
    /// Hold the clutch, or let go of it.
    Clutch(bool),
    Release,
    Reset,
    Stop,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct CommandOutcome {
    pub held: bool,
    pub text: Option<String>,
}

/// The page's connection. Dropping it releases a held enable.
pub type OperatorWorker = Worker<OperatorCommand, CommandOutcome>;

impl OperatorWorker {
    pub fn new(instance: &Instance) -> std::io::Result<Self> {
        let instance = instance.clone();
        Self::start("hand", |asked, answer| {
            Grip { instance, client: None, held: None, clutch_until: None, reset: None, stop: None, answer }.work(asked)
        })
    }
}

#[derive(Clone, Copy)]
struct Held {
    since: Instant,
    until: Instant,
    /// Control's transition count before the enable. `None` until its first answer.
    transitions: Option<u32>,
}

struct Grip {
    instance: Instance,
    client: Option<Client>,
    held: Option<Held>,
    /// Time at which a held clutch counts as lost.
    clutch_until: Option<Instant>,
    /// Answers of control since a reset was pressed. `None` once its outcome is known.
    reset: Option<u32>,
    /// A press of the emergency stop that the robot has not answered yet, and whether the page was told why.
    stop: Option<(StopPress, bool)>,
    answer: Sender<CommandOutcome>,
}

impl Grip {
    fn work(mut self, asked: &Receiver<OperatorCommand>) {
        let mut beat = Instant::now();
        loop {
            let mut pressed = false;
            match asked.recv_timeout(beat.saturating_duration_since(Instant::now())) {
                // Everything that waits is obeyed before the next exchange, which may take long. So a release overtakes the
                // repetitions before it.
                Ok(ask) => {
                    for ask in std::iter::once(ask).chain(asked.try_iter()) {
                        // A press has an exchange of its own after a release.
                        if pressed && matches!(ask, OperatorCommand::Engage { .. }) {
                            self.beat();
                        }
                        pressed |= ask != OperatorCommand::Keep;
                        self.obey(ask);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            let now = Instant::now();
            let due = now >= beat;
            if due {
                beat = now + HEARTBEAT;
            }
            if self.held.is_some_and(|held| held.until < now) || self.clutch_until.is_some_and(|until| until < now) {
                self.let_go("The page stopped answering, so the enable was released.".to_owned());
                pressed = true;
            }
            if due || pressed {
                self.beat();
            }
        }
        if self.held.is_some() || self.clutch_until.is_some() {
            self.let_go(String::new());
            self.beat();
        }
    }

    fn obey(&mut self, ask: OperatorCommand) {
        if ask == OperatorCommand::Keep {
            if let Some(held) = &mut self.held {
                held.until = Instant::now() + HOLD_FOR;
            }
            self.clutch_until = self.clutch_until.map(|_| Instant::now() + HOLD_FOR);
            return;
        }
        match ask {
            OperatorCommand::Stop => self.stop = Some((StopPress::new(&self.instance.operator_socket()), false)),
            OperatorCommand::Engage { .. } | OperatorCommand::Reset => self.stop = None,
            _ => {}
        }
        if self.client.is_none() {
            match Client::connect(self.instance.operator_socket()) {
                Ok(client) => self.client = Some(client),
                Err(error) => return self.send_report(format!("control does not answer: {error}")),
            }
        }
        let Some(client) = &mut self.client else { return };
        match ask {
            OperatorCommand::Engage { left_out } => {
                match left_out {
                    None => client.enable(),
                    Some(arm) => client.enable_without(arm),
                };
                let now = Instant::now();
                self.held = Some(Held { since: now, until: now + HOLD_FOR, transitions: None });
                self.send_report(String::new());
            }
            OperatorCommand::Clutch(held) => {
                client.clutch(held);
                self.clutch_until = held.then(|| Instant::now() + HOLD_FOR);
            }
            OperatorCommand::Release => self.let_go(String::new()),
            OperatorCommand::Reset => {
                client.reset();
                self.reset = Some(0);
            }
            OperatorCommand::Stop => self.let_go(String::new()),
            OperatorCommand::Keep => {}
        }
    }

    /// Releases the enable, and the clutch with it. Like every release, it also withdraws the enable of another connection.
    fn let_go(&mut self, text: String) {
        (self.held, self.clutch_until) = (None, None);
        if let Some(client) = &mut self.client {
            client.release().clutch(false);
        }
        self.send_report(text);
    }

    /// Presses the emergency stop until the robot has answered.
    fn press_stop(&mut self) {
        let Some((press, is_told)) = &mut self.stop else { return };
        match press.step() {
            Ok(None) => {}
            Ok(Some(_)) => self.stop = None,
            Err(error) => {
                if !std::mem::replace(is_told, true) {
                    // Its own connection may have no place. The one that is open presses, too.
                    if let Some(client) = &mut self.client {
                        client.estop();
                    }
                    self.send_report(format!("STOP is pressed until the robot answers. It has not yet: {error}"));
                }
            }
        }
    }

    fn beat(&mut self) {
        self.press_stop();
        let Some(client) = &mut self.client else { return };
        match client.heartbeat() {
            Ok(status) => {
                self.report_refusal(&status);
                self.watch(&status);
            }
            // One late reply does not end the connection. The socket stays open, and control judges the silence.
            Err(OperatorError::Timeout { .. }) => {}
            Err(error) => {
                (self.client, self.held, self.clutch_until) = (None, None, None);
                self.send_report(format!("The connection to control is lost: {error}"));
            }
        }
    }

    /// Reports why a reset was refused. Control answered the press before it read it, so the next answer tells.
    fn report_refusal(&mut self, status: &Status) {
        match self.reset.take() {
            None => {}
            Some(0) => self.reset = Some(1),
            Some(_) => {
                if let Some(why) = operator::reset_refusal(status) {
                    self.send_report(format!("The reset was refused: {why}."));
                }
            }
        }
    }

    /// Releases an enable that control has refused or withdrawn. Nothing engages again by itself.
    fn watch(&mut self, status: &Status) {
        let Some(held) = &mut self.held else { return };
        let before = *held.transitions.get_or_insert(status.transition_count);
        let follows = Mode::from_u32(status.mode).is_some_and(|mode| !matches!(mode, Mode::Disengaged | Mode::Faulted));
        let changed = status.transition_count != before;
        if follows || !changed && held.since.elapsed() < REFUSED_AFTER {
            return;
        }
        // The page shows the cause in one place, below the mode.
        let what = if changed { "The robot no longer follows." } else { "The enable was refused." };
        self.let_go(format!("{what} See the cause below the mode."));
    }

    fn send_report(&self, text: String) {
        let _ = self
            .answer
            .send(CommandOutcome { held: self.held.is_some(), text: Some(text).filter(|text| !text.is_empty()) });
    }
}
