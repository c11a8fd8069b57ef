//! The robot's end.

use super::keys::{Keys, Name};
use super::person::Person;
use super::report::{Report, operator_details, state_name};
use super::wire::{KINDS, Publisher, Slot, Wire, config, key, kind, send, status_key};
use crate::cli::LinkRobot;
use doors::draw_nonce;
use instance::Instance;
use link::{FRAME_BYTES_MAX, Kind, OPERATORS_MAX, Payload, RobotEnd, Sent};
use messages::{Layout, Message, OperatorRequest, Stamp, Status};
use operator::{Client, OperatorSession};
use rt::{Exit, Failure, Shutdown, out};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Longest wait for a datagram, ns. Silence and a new status are noticed after it.
const WAIT_NS: i64 = 5_000_000;
/// Time between two answers without a cause, ns: 10 a second, for the clocks.
const ANSWER_EVERY_NS: u64 = 100_000_000;
/// Longest wait for room in the operator socket, ms. `control` reads it 1500 times a second.
const SEND_MS: u64 = 20;
/// Longest wait for the answer of `control` to an emergency stop, ms. Only a hung one takes as long.
const STOP_MS: u64 = 100;
/// Time between two attempts to send an emergency stop, ns.
const STOP_RETRY_NS: u64 = 100_000_000;
/// Time between two attempts to reach `control` for its status, ns.
const RETRY_NS: u64 = 500_000_000;
/// Silence after which `control` releases what an operator holds, ns.
const RELEASED_AFTER_NS: u64 = operator::LEASE_NS;
/// Bytes before a status on its key: its version and its length, 32 bits each.
const STATUS_HEAD_BYTES: usize = 8;

struct Operator {
    name: Name,
    slots: [Arc<Slot>; 3],
    answers: Publisher,
    /// Answers on the connection that is for the emergency stop alone.
    stop_answers: Publisher,
    person: Person,
    control: Option<Client>,
    answered: Stamp,
    /// A request came on that connection. Each gets an answer.
    stop_asked: bool,
    /// Time of the last request, and whether it held something.
    asked: Stamp,
    holds: bool,
    report: Report,
}

struct Robot {
    end: RobotEnd,
    operators: Vec<Operator>,
    operator_socket: PathBuf,
    watch: Option<OperatorSession>,
    /// Time of the next attempt at an emergency stop that has not arrived at `control` yet.
    stop_due: Option<Stamp>,
    retry: Stamp,
    status: Publisher,
    sent_sequence: u64,
    sent_at: Stamp,
}

pub fn run(args: &LinkRobot) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let mut keys = Keys::read_robot(&args.keys)?;
    if keys.operators.len() > OPERATORS_MAX {
        let text = format!("{}: {} operators; at most {OPERATORS_MAX}", args.keys.display(), keys.operators.len());
        return Err(Failure::new(Exit::Config, text));
    }
    if keys.operators.is_empty() {
        let text = format!("{}: no operator. Run teleop-bridge link pair operator first", args.keys.display());
        return Err(Failure::new(Exit::Config, text));
    }
    if args.run_dir.exists() && !args.run_dir.is_dir() {
        return Err(Failure::new(Exit::Usage, format!("{}: not a folder", args.run_dir.display())));
    }
    let instance = Instance::unmade(&args.run_dir);
    let settings = config(&keys, &super::addresses(&args.listen)?, &super::addresses(&args.connect)?);
    let mut report = Report::default();
    let waits =
        || report.print(rt::now(), "no answer of the router. Does teleop-bridge link router run there?", String::new);
    let Some(wire) = Wire::open(&settings, &shutdown, waits)? else { return Ok(()) };
    let admitted: Vec<_> = keys.operators.iter().map(|(name, _)| name.as_str()).collect();
    out!("bridge: robot {} (code {}) admits {}", keys.robot, keys.code(), admitted.join(", "));
    if Client::connect(instance.operator_socket()).is_err() {
        out!("bridge: teleopd does not answer in {} yet", args.run_dir.display());
    }
    let names = std::mem::take(&mut keys.operators);
    let robot = Arc::new(Mutex::new(Robot {
        end: RobotEnd::default(),
        operators: Vec::new(),
        operator_socket: instance.operator_socket(),
        watch: None,
        stop_due: None,
        retry: Stamp::NONE,
        status: wire.publisher(status_key(&keys.robot))?,
        sent_sequence: 0,
        sent_at: Stamp::NONE,
    }));
    for (at, (name, _)) in names.into_iter().enumerate() {
        let operator = Operator::new(&wire, &keys.robot, name, &instance, at, &robot)?;
        locked(&robot).operators.push(operator);
    }
    while !shutdown.requested() {
        let mut event = [PollFd::from_borrowed_fd(wire.event(), PollFlags::IN)];
        let _ = poll(&mut event, Some(&Timespec { tv_sec: 0, tv_nsec: WAIT_NS }));
        wire.calm();
        locked(&robot).round();
    }
    Ok(())
}

fn locked(robot: &Mutex<Robot>) -> MutexGuard<'_, Robot> {
    robot.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Operator {
    /// The operator at place `at` of `shared`. A person is taken in the thread of zenoh: that saves a change of threads, on
    /// which it would wait for the scheduler. While a round has the lock, it waits for the next round.
    fn new(
        wire: &Wire,
        robot: &Name,
        name: Name,
        instance: &Instance,
        at: usize,
        shared: &Arc<Mutex<Robot>>,
    ) -> Result<Self, Failure> {
        let shared = Arc::downgrade(shared);
        let receive_now = move |bytes: &[u8]| {
            let robot = shared.upgrade().filter(|_| kind(bytes) == Kind::Person as usize);
            let Some(mut robot) = robot.as_ref().and_then(|robot| robot.try_lock().ok()) else { return false };
            let known = at < robot.operators.len();
            if known {
                robot.receive(at, bytes);
            }
            known
        };
        Ok(Self {
            // The order of use: an emergency stop comes before a person.
            slots: [
                wire.receive(key(robot, "stop", &name), |_| false)?,
                wire.receive(key(robot, "operator", &name), |_| false)?,
                wire.receive(key(robot, "person", &name), receive_now)?,
            ],
            answers: wire.publisher(key(robot, "answer", &name))?,
            stop_answers: wire.publisher(key(robot, "stopped", &name))?,
            person: Person::new(&instance.skeleton_socket()),
            control: None,
            answered: Stamp::NONE,
            stop_asked: false,
            asked: Stamp::NONE,
            holds: false,
            report: Report::default(),
            name,
        })
    }

    /// Tells why the robot was released, if requests that held something came too late.
    fn print_silence(&mut self, now: Stamp) {
        let silent_ns = now.since(self.asked);
        if self.holds && silent_ns > RELEASED_AFTER_NS {
            let (silent_ms, most_ms) = (silent_ns / 1_000_000, RELEASED_AFTER_NS / 1_000_000);
            out!("bridge: nothing came from {} for {silent_ms} ms; {most_ms} ms release the robot", self.name);
            self.holds = false;
        }
    }
}

impl Robot {
    fn round(&mut self) {
        for at in 0..self.operators.len() {
            for slot in 0..self.operators[at].slots.len() {
                // No more than fit into the slot, so that no operator keeps the others waiting.
                for _ in 0..KINDS {
                    let Some(bytes) = self.operators[at].slots[slot].take() else { break };
                    self.operators[at].stop_asked |= slot == 0;
                    self.receive(at, &bytes);
                }
            }
        }
        let now = rt::now();
        let ended = self.end.tick(now);
        for (operator, _) in self.operators.iter_mut().zip(ended).filter(|(_, ended)| *ended) {
            operator.print_silence(now);
            // With the connection goes what it holds: a partition is a release.
            operator.control = None;
            operator.answered = Stamp::NONE;
        }
        if self.stop_due.is_some_and(|due| now >= due) {
            self.stop_due = (!self.stop()).then(|| now.plus_ns(STOP_RETRY_NS));
        }
        self.end.stop_waits = self.stop_due.is_some();
        self.send_status(now);
        for at in 0..self.operators.len() {
            self.operators[at].person.rest(now);
            self.answer(at, now);
        }
    }

    fn receive(&mut self, at: usize, bytes: &[u8]) {
        let now = rt::now();
        let taken = self.end.receive(at, bytes, now, draw_nonce);
        if taken.stop {
            out!("bridge: {} pressed the emergency stop", self.operators[at].name);
            self.stop_due = Some(now);
        }
        let operator = &mut self.operators[at];
        match taken.outcome {
            Ok(Sent::Person(person)) => operator.person.publish(&person, now),
            Ok(Sent::Request(request)) => {
                operator.print_silence(now);
                (operator.asked, operator.holds) = (now, request.enable_level != 0);
                self.relay(at, &request);
            }
            Ok(Sent::Began) => {
                operator.control = None;
                operator.answered = Stamp::NONE;
                operator.holds = false;
            }
            Err(_) => {}
        }
    }

    /// Sends a request to `control`, which may not read it. Each session has a connection of its own.
    fn relay(&mut self, at: usize, request: &OperatorRequest) {
        let operator = &mut self.operators[at];
        if operator.control.is_none() && request.sequence == 1 {
            operator.control = Client::connect_within(&self.operator_socket, SEND_MS).ok();
        }
        let sent = operator.control.as_mut().is_some_and(|control| control.send(request).is_ok());
        if !sent {
            operator.control = None;
            self.end.end(at);
        }
    }

    /// Presses the emergency stop on a connection of its own. Returns false if it did not arrive, and is to be repeated.
    fn stop(&mut self) -> bool {
        let pressed =
            Client::connect_within(&self.operator_socket, STOP_MS).and_then(|mut client| client.estop().heartbeat());
        if let Err(error) = &pressed {
            out!("bridge: the emergency stop did not arrive, and is sent again: {error}");
        }
        pressed.is_ok()
    }

    fn send_status(&mut self, now: Stamp) {
        let is_cut_off = self.watch.as_ref().is_none_or(OperatorSession::is_cut_off);
        self.end.daemon_gone = is_cut_off || now.since(self.sent_at) > super::STATUS_GONE_NS;
        if is_cut_off {
            if now >= self.retry {
                self.watch = OperatorSession::connect(&self.operator_socket).ok();
                self.retry = now.plus_ns(RETRY_NS);
            }
            return;
        }
        let Some(status) = self.watch.as_ref().and_then(OperatorSession::status) else { return };
        if status.header.sequence == self.sent_sequence {
            return;
        }
        (self.sent_sequence, self.sent_at) = (status.header.sequence, now);
        let mut out = [0; FRAME_BYTES_MAX];
        for (at, operator) in self.operators.iter().enumerate() {
            if let Some(length) = self.end.send(at, Payload::Status(status), now, &mut out) {
                send(&operator.answers, &out[..length]);
            }
        }
        let mut plain = [0; STATUS_HEAD_BYTES + size_of::<Status>()];
        [Status::VERSION, size_of::<Status>() as u32].write_to(&mut plain);
        status.write_to(&mut plain[STATUS_HEAD_BYTES..]);
        send(&self.status, &plain);
    }

    fn answer(&mut self, at: usize, now: Stamp) {
        let operator = &mut self.operators[at];
        let mut out = [0; FRAME_BYTES_MAX];
        if let Some(length) = self.end.answer_rival(at, now, &mut out) {
            send(&operator.answers, &out[..length]);
        }
        if let Some(led) = self.end.led_by_other.get_mut(at) {
            *led = operator.person.is_led_by_other();
        }
        if std::mem::take(&mut operator.stop_asked)
            && let Some(length) = self.end.answer(at, now, &mut out)
        {
            send(&operator.stop_answers, &out[..length]);
        }
        if now.since(operator.answered) >= ANSWER_EVERY_NS
            && let Some(length) = self.end.answer(at, now, &mut out)
        {
            operator.answered = now;
            send(&operator.answers, &out[..length]);
        }
        if let Some(feedback) = operator.person.feedback()
            && let Some(length) = self.end.send(at, Payload::Feedback(feedback), now, &mut out)
        {
            send(&operator.answers, &out[..length]);
        }
        if let Some(state) = self.end.state(at, now) {
            let (trip, refused) = (self.end.round_trip_ns(at), self.end.refused(at));
            let why = operator.person.why.as_ref().map_or(String::new(), |why| format!("; {why}"));
            let state_text = format!("{}: {}", operator.name, state_name(&state));
            operator.report.print(now, &state_text, || operator_details(&state, trip, &refused) + &why);
        }
    }
}
