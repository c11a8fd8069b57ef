//! The driver's port: wait-free on the loop's side, DDS in a thread of its own.

use crate::connection::{Connection, ControllerStatus};
use crate::estimate::{Sample, Sent};
use crate::interface::{disagreement, period_ticks};
use crate::lag::Lag;
use crate::preflight;
use crate::reference::HELD;
use crate::trajectory::{Command, Executed};
use config::{Loaded, Policy, Ros2Settings};
use driver::{Driver, Drives, Measured, Setpoint};
use messages::{GripperMotion, GripperState, JOINTS_MAX, JointMotion, Stamp, StopPlan, TICK_S};
use robot::{Model, SetpointKind};
use rtrb::{Consumer, Producer, RingBuffer};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// SCHED_FIFO priority of the threads of DDS. It is far below that of the loops. Without it other work delayed messages by
/// 54 ms on two busy cores.
const PRIORITY: u8 = 10;
/// Period of the thread of DDS, ns.
const LOOK_NS: u64 = 1_000_000;
/// Least time between two log lines on the robot's state, ns. Assumption: a person reads one line a second.
const LINE_NS: u64 = 1_000_000_000;
/// Capacity of the rings of commands and updates. The thread empties them once a millisecond, so a full ring means that it
/// hangs.
const RING: usize = 64;
/// An encoder counts as stuck if its measurement stays exactly the same while the joint is commanded to move by more than
/// this, rad or m. `safety` uses the same distance.
const STUCK: f64 = 0.02;
/// Least number of equal samples in a row: 0.1 s at 50 Hz.
const STUCK_SAMPLES: u32 = 5;

/// Longest time for which a driver that ends waits for its thread: a stop of 0.5 s, and 5 s in which a weight falls.
const END_WITHIN: Duration = Duration::from_millis(6_500);

/// Message from the loop to the thread: the command, and the grippers' motion once they were measured.
type Order = (Command, Option<GripperMotion>);

/// Message from the thread to the loop.
#[derive(Clone, Copy, Debug)]
struct RobotUpdate {
    sample: Sample,
    /// Positions at which the controllers hold the robot, rad or m.
    reference: [f64; JOINTS_MAX],
    drives: Drives,
    /// True while the robot executes the sent setpoints.
    joined: bool,
    gripped: Option<GripperState>,
}

pub struct Ros2 {
    /// None once the driver ends.
    commands: Option<Producer<Order>>,
    grippers: Option<GripperMotion>,
    thread: Option<JoinHandle<()>>,
    period_ticks: u64,
    updates: Consumer<RobotUpdate>,
    newest: RobotUpdate,
    sent: Sent,
    last_k: u64,
    delay_ns: u64,
    expected_ns: u64,
    stuck: Stuck,
    lag: Lag,
    servo_lag_ms: f64,
}

/// Detects stuck encoders. `safety` cannot, because the estimate moves between samples.
#[derive(Clone, Copy, Debug)]
struct Stuck {
    q: [f64; JOINTS_MAX],
    sent: [f64; JOINTS_MAX],
    same: [u32; JOINTS_MAX],
    found: bool,
}

impl Stuck {
    fn judge(&mut self, measured: &[f64; JOINTS_MAX], sent: &[f64; JOINTS_MAX]) {
        self.found = false;
        for j in 0..JOINTS_MAX {
            if measured[j] != self.q[j] {
                (self.q[j], self.sent[j], self.same[j]) = (measured[j], sent[j], 0);
            } else {
                self.same[j] = self.same[j].saturating_add(1);
                self.found |= self.same[j] >= STUCK_SAMPLES && (sent[j] - self.sent[j]).abs() > STUCK;
            }
        }
    }
}

impl Ros2 {
    /// Connects to the robot of `loaded`, and judges it. The threads of DDS get `cores`. The error has the sentences of all checks that failed.
    pub fn open(loaded: &Loaded, cores: Option<&[usize]>) -> Result<Self, String> {
        let (model, settings, interface) = (&loaded.model, &loaded.settings.ros2, loaded.settings.ros2.setpoints);
        if let Some(disagreement) = disagreement(&loaded.settings, model) {
            return Err(format!("{}: {disagreement}", loaded.config_name()));
        }
        let (commands, from_loop) = RingBuffer::new(RING);
        let (to_loop, updates) = RingBuffer::new(RING);
        let (first_update, opened) = std::sync::mpsc::channel();
        let (own, named, cores) = (model.clone(), settings.clone(), cores.map(<[usize]>::to_vec));
        let fifo = loaded.settings.realtime.policy == Policy::Fifo;
        let thread = std::thread::Builder::new()
            .name("ros2-link".into())
            .spawn(move || {
                // DDS starts its threads here, and they inherit core and priority. On the loops' core they would wait for the
                // loops. Without rights, or with one core, they share it.
                if let Some(cores) = cores {
                    let _ = rt::Realtime::keep_to(&cores);
                }
                if fifo {
                    let _ = rt::Realtime::fifo_with_children(PRIORITY);
                }
                let ready = ready(&own, &named, interface);
                let (connection, first) = match ready {
                    Ok((connection, first)) => (Some(connection), Ok(first)),
                    Err(cause) => (None, Err(cause)),
                };
                // `open` waits for this update.
                let _ = first_update.send(first);
                if let Some(connection) = connection {
                    serve(connection, from_loop, to_loop);
                }
            })
            .map_err(|error| format!("the thread of DDS cannot start: {error}"))?;
        let newest: RobotUpdate = opened.recv().map_err(|_| "the thread of DDS ended")??;
        let delay_s = loaded.settings.ros2_behind_ms() * 1e-3;
        let expected_s =
            f64::from(loaded.settings.servo_delay_ticks()) * TICK_S + loaded.settings.interface().delay_s();
        let q = newest.sample.q;
        let stuck = Stuck { q, sent: q, same: [0; JOINTS_MAX], found: false };
        Ok(Self {
            commands: Some(commands),
            grippers: None,
            thread: Some(thread),
            period_ticks: period_ticks(interface),
            updates,
            newest,
            sent: Sent::default(),
            last_k: 0,
            delay_ns: (delay_s * 1e9) as u64,
            expected_ns: (expected_s * 1e9) as u64,
            stuck,
            lag: Lag::default(),
            servo_lag_ms: settings.servo_lag_ms,
        })
    }
}

/// Connects to the robot and judges it. Returns the connection and the first update.
fn ready(model: &Model, settings: &Ros2Settings, interface: SetpointKind) -> Result<(Connection, RobotUpdate), String> {
    let mut connection = Connection::open(model, settings, interface, true)?;
    let failures = preflight::judge(&mut connection, model, settings);
    connection.forget_description();
    connection.describe_hands();
    if !failures.is_empty() {
        return Err(format!("the robot is not ready:\n  {}", failures.join("\n  ")));
    }
    connection.begin()?;
    let heard = connection.latest.clone().ok_or("no joint_states arrived")?;
    let gripped = connection.gripped(rt::now());
    let first = RobotUpdate {
        sample: heard.sample,
        reference: connection.held(),
        drives: Drives::SOUND,
        joined: true,
        gripped,
    };
    Ok((connection, first))
}

impl Driver for Ros2 {
    fn read(&mut self, now: Stamp) -> Measured {
        while let Ok(update) = self.updates.pop() {
            self.newest = update;
            let then = Stamp(update.sample.measured.0.saturating_sub(self.delay_ns));
            if let Some(sent) = self.sent.at(then).filter(|_| update.joined && update.drives.powered) {
                self.stuck.judge(&update.sample.q, &sent.q);
                self.lag.add(&sent, &update.sample.q);
            }
        }
        let RobotUpdate { sample, reference, drives, joined, .. } = self.newest;
        let Sample { measured, mut q, dq } = match drives.powered && joined {
            true => self.sent.estimate(&sample, now, self.delay_ns, self.expected_ns),
            false => sample,
        };
        // At the start the controllers already hold the robot. Their reference differs from the measurement by the
        // servos' steady-state error.
        let near = (0..JOINTS_MAX).all(|j| (reference[j] - sample.q[j]).abs() <= HELD);
        if drives.powered && near && !(joined && self.sent.has_any()) {
            q = reference;
        }
        let drives = Drives { fault: drives.fault || self.stuck.found, ..drives };
        Measured { stamp: measured, q, dq, drives, unanswered: false, refused: !joined }
    }

    fn write(&mut self, _now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        let &Setpoint { k, q, v, a } = setpoint;
        let motion = JointMotion { q, v, a, plan: *plan };
        // The position of a robot that does not follow is its measurement.
        let follows = self.newest.drives.powered && self.newest.joined;
        if !follows {
            self.sent.clear();
        }
        self.sent.push(&Executed::new(k, &motion));
        if k / self.period_ticks == self.last_k / self.period_ticks {
            return follows;
        }
        self.last_k = k;
        let order = (Command { k, motion }, self.grippers);
        self.commands.as_mut().is_some_and(|commands| commands.push(order).is_ok()) && follows
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.grippers = Some(*grippers);
    }

    fn gripped(&self) -> Option<GripperState> {
        self.newest.gripped
    }
}

impl Drop for Ros2 {
    fn drop(&mut self) {
        // The thread stops a robot that cannot stop by itself, and ends.
        self.commands = None;
        let give_up = Instant::now() + END_WITHIN;
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < give_up {
            std::thread::sleep(Duration::from_millis(1));
        }
        if let Some(advice) = self.lag.advice(self.servo_lag_ms) {
            tracing::warn!("{advice}");
        }
    }
}

/// Limits the log lines on the robot's state to one a second. A fault that ends before its line is due is logged as well.
#[derive(Debug, Default)]
struct StateLog {
    logged: Option<String>,
    logged_at: Option<Stamp>,
    newest: Option<String>,
    /// The first state since the last line that differs from it.
    missed: Option<String>,
    changes: u32,
}

impl StateLog {
    /// Takes the present state. `None` is a robot that follows. Returns the number of changes since the last line if a line is
    /// due.
    fn due(&mut self, sentence: &Option<String>, now: Stamp) -> Option<u32> {
        if *sentence != self.newest {
            self.newest.clone_from(sentence);
            self.changes += 1;
            if self.missed.is_none() && *sentence != self.logged {
                self.missed.clone_from(sentence);
            }
        }
        let waits = self.logged_at.is_some_and(|logged_at| now.since(logged_at) < LINE_NS);
        if waits || (self.newest == self.logged && self.missed.is_none()) {
            return None;
        }
        (self.logged, self.logged_at) = (self.missed.take().or_else(|| self.newest.clone()), Some(now));
        Some(std::mem::take(&mut self.changes))
    }

    /// Returns the logged state. `None` is a robot that follows.
    fn logged(&self) -> Option<&str> {
        self.logged.as_deref()
    }
}

/// The thread's loop: sends the newest command, and passes on the robot's state.
fn serve(mut connection: Connection, mut commands: Consumer<Order>, mut updates: Producer<RobotUpdate>) {
    let (mut state_log, mut hands, mut due) = (StateLog::default(), HandLogs::default(), Vec::with_capacity(RING));
    loop {
        let now = rt::now();
        let heard = connection.receive(now);
        due.clear();
        let mut grippers = None;
        while let Ok((command, motion)) = commands.pop() {
            due.push(command);
            grippers = motion;
        }
        connection.check_silence(now);
        let joined = connection.send(&due, rt::now());
        if let Some(command) = due.last() {
            connection.grip(command.k, grippers.as_ref(), joined, now);
            hands.log(&connection, now);
        }
        let fault = complaint(&connection, now);
        let sentence = fault.clone().or_else(|| connection.departed().map(str::to_owned));
        if let Some(changes) = state_log.due(&sentence, now) {
            let often = if changes > 1 { format!(" ({changes} changes in between)") } else { String::new() };
            match state_log.logged() {
                Some(sentence) => tracing::error!("{}: {sentence}{often}", connection.consequence()),
                None => tracing::warn!("the robot executes again what it is sent{often}"),
            }
        }
        if (heard || !joined)
            && let Some(heard) = &connection.latest
        {
            let emergency_stop = connection.pressed == Some(true);
            let drives = Drives { emergency_stop, fault: fault.is_some(), powered: !emergency_stop };
            // A full ring means that the loop hangs. It then reads an old sample, and reports its age.
            let gripped = connection.gripped(now);
            let _ = updates.push(RobotUpdate {
                sample: heard.sample,
                reference: connection.held(),
                drives,
                joined,
                gripped,
            });
        }
        if commands.is_abandoned() {
            return connection.end();
        }
        rt::sleep_until(now.plus_ns(LOOK_NS));
    }
}

/// Returns a sentence on a controller of the arms that can no longer be driven.
fn complaint(connection: &Connection, now: Stamp) -> Option<String> {
    connection.controllers(now).iter().find_map(|seen| seen.fault(!connection.has_states()))
}

impl ControllerStatus {
    /// Returns a sentence if the controller cannot be driven. With `needs_reader`, its command topic must have a reader.
    pub(crate) fn fault(&self, needs_reader: bool) -> Option<String> {
        let (name, topic) = (&self.name, &self.topic);
        if !self.active {
            Some(format!("controller `{name}` fell silent: it was switched off, or the network is cut"))
        } else if self.other_joints {
            Some(format!("controller `{name}` has other joints now"))
        } else if self.publishers > 0 {
            Some(format!("another program may send to {topic}"))
        } else if self.readers == 0 && needs_reader {
            Some(format!("nobody reads {topic} any more"))
        } else if self.readers > 1 {
            Some(format!("{} robots read {topic}", self.readers))
        } else {
            None
        }
    }
}

/// Logs when a hand gets no messages, and when it gets them again.
#[derive(Debug, Default)]
struct HandLogs([StateLog; 2]);

impl HandLogs {
    fn log(&mut self, connection: &Connection, now: Stamp) {
        for ((name, why), state_log) in connection.hands().zip(&mut self.0) {
            if state_log.due(&why.map(str::to_owned), now).is_some() {
                match state_log.logged() {
                    Some(why) => tracing::warn!("nothing is sent to `{name}`: {why}"),
                    None => tracing::info!("`{name}` executes what it is sent"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robot_that_falls_silent_every_20_ms_gets_one_line_a_second() {
        let mut state_log = StateLog::default();
        let silent = Some("the robot fell silent".to_owned());
        let lines: Vec<(u64, u32)> = (0..2_500)
            .filter_map(|ms| {
                let state = if (ms / 20) % 2 == 0 { None } else { silent.clone() };
                state_log.due(&state, Stamp(1 + ms * 1_000_000)).map(|changes| (ms, changes))
            })
            .collect();
        assert!(lines.len() == 3 && lines.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 1_000), "{lines:?}");
        assert_eq!(lines.iter().map(|(_, changes)| changes).sum::<u32>(), lines[2].0 as u32 / 20, "none is lost");
        // A state that lasts is always printed, however short it is after the line before.
        let log = |state_log: &mut StateLog, state: &Option<String>, s: u64| {
            state_log.due(state, Stamp(s * 1_000_000_000)).map(|_| state_log.logged().map(str::to_owned))
        };
        for s in 10..20 {
            log(&mut state_log, &None, s);
        }
        assert_eq!(state_log.logged(), None);
        assert_eq!(log(&mut state_log, &None, 30), None, "nothing is new");
    }

    #[test]
    fn fault_that_ends_before_its_line_is_due_is_told() {
        let mut state_log = StateLog::default();
        let mut log = |state: Option<&str>, ms: u64| {
            let state = state.map(str::to_owned);
            state_log.due(&state, Stamp(ms * 1_000_000)).map(|_| state_log.logged().map(str::to_owned))
        };
        assert_eq!(log(Some("first"), 1_000), Some(Some("first".into())));
        assert_eq!(log(None, 2_500), Some(None));
        assert_eq!((log(Some("second"), 2_600), log(None, 2_700)), (None, None));
        assert_eq!(log(None, 3_600), Some(Some("second".into())));
        assert_eq!(log(None, 4_700), Some(None), "and then that it is over");
        assert_eq!(log(None, 9_000), None);
    }
}
