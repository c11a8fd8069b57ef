//! The operator's end.

use super::heartbeat::Heartbeat;
use super::keys::{Keys, Name};
use super::report::{Report, robot_details, state_name};
use super::wire::{Publisher, Slot, Wire, config, key, send};
use crate::cli::LinkOperator;
use doors::{CONNECTIONS_MAX, FrameSource, LeaseState, draw_nonce};
use instance::Instance;
use link::{Down, FRAME_BYTES_MAX, OperatorEnd, Unsendable};
use messages::{Fault, Faults, Layout, Mode, RawSkeleton, Stamp, Status};
use rt::{Exit, Failure, Shutdown, out};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::path::PathBuf;
use std::sync::Arc;

/// Time between two heartbeats, ns: 50 Hz, as every client of the operator socket sends.
const BEAT_NS: u64 = 20_000_000;
/// Time between two requests on each connection that is for the emergency stop alone, ns, at rest and while a stop has no answer.
/// On a bad wire QUIC lets two full packets be under way, which are a dozen requests, and doubles its wait with each loss. So
/// few are sent that the next one need not wait.
const STOP_EVERY_NS: [u64; 2] = [500_000_000, 80_000_000];
/// Connections for the emergency stop. One that waits for QUIC seldom waits at the same time as the other.
const STOP_WIRES: usize = 2;
/// Longest wait, ns. Clients of the operator socket are served after it.
const WAIT_NS: i64 = 2_000_000;
/// Silence after which another client may take the person's place, ns. `ingest` keeps a silent client's lease as long.
const SILENT_NS: u64 = 1_000_000_000;

const NO_ANSWER: &str =
    "no answer. Is teleop-bridge link robot running, does UDP reach it, and does it admit this operator?";

struct Operator {
    end: OperatorEnd,
    heartbeat: Heartbeat,
    due: Stamp,
    up: [Publisher; 2],
    answers: Arc<Slot>,
    stop_wires: Vec<StopWire>,
    /// Time of the last request on these.
    stop_sent: Stamp,
    persons: doors::Server,
    operators: operator::Server,
    /// True while the robot answers. Otherwise a client would hold what the robot does not hear.
    is_open: bool,
    status: Option<(Status, Stamp)>,
    /// Session of the local client whose person goes up, and the time of its last frame.
    holder: (u64, Stamp),
    unsendable: Option<Unsendable>,
    robot: Name,
    report: Report,
    started: Stamp,
}

/// A connection that is for the emergency stop alone.
struct StopWire {
    requests: Publisher,
    answers: Arc<Slot>,
    _wire: Wire,
}

impl StopWire {
    fn new(wire: Wire, robot: &Name, operator: &Name) -> Result<Self, Failure> {
        let requests = wire.publisher(key(robot, "stop", operator))?;
        let answers = wire.receive(key(robot, "stopped", operator), |_| false)?;
        Ok(Self { requests, answers, _wire: wire })
    }
}

pub fn run(args: &LinkOperator) -> Result<(), Failure> {
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let keys = Keys::read_operator(&args.bundle)?;
    let unusable = |error| Failure::new(Exit::CantCreate, format!("{}: {error}", args.run_dir.display()));
    let instance = Instance::new(&args.run_dir).map_err(unusable)?;
    let persons = doors::Server::bind(&instance.skeleton_socket(), None).map_err(Failure::with(Exit::Unavailable))?;
    let addresses = super::addresses(&args.connect)?;
    let Some(name) = &keys.operator else { return Ok(()) };
    out!("bridge: operator {name} of robot {}, code {}", keys.robot, keys.code());
    out!("bridge: clients find the robot with --run-dir {}", instance.run_dir().display());
    super::print_unknown(&addresses);
    let marker = Marker(instance.run_dir().join(doors::LINK_FILE));
    instance::write_anew(&marker.0, keys.robot.as_str().as_bytes()).map_err(unusable)?;
    let mut report = Report::default();
    let waits = || report.print(rt::now(), &format!("{}: {NO_ANSWER}", keys.robot), String::new);
    let settings = config(&keys, &[], &addresses);
    let Some(wire) = Wire::open(&settings, &shutdown, waits)? else { return Ok(()) };
    let mut stop_wires = Vec::new();
    for _ in 0..STOP_WIRES {
        let Some(wire) = Wire::open(&settings, &shutdown, || ())? else { return Ok(()) };
        stop_wires.push(StopWire::new(wire, &keys.robot, name)?);
    }
    let publisher = |what: &str| wire.publisher(key(&keys.robot, what, name));
    let mut operator = Operator {
        end: OperatorEnd::new(draw_nonce()),
        heartbeat: Heartbeat::new(),
        due: Stamp::NONE,
        up: [publisher("operator")?, publisher("person")?],
        answers: wire.receive(key(&keys.robot, "answer", name), |_| false)?,
        stop_wires,
        stop_sent: Stamp::NONE,
        persons,
        operators: operator::Server::bind(instance.operator_socket())?,
        is_open: false,
        status: None,
        holder: (0, Stamp::NONE),
        unsendable: None,
        robot: keys.robot.clone(),
        report,
        started: rt::now(),
    };
    while !shutdown.requested() {
        operator.wait(&wire);
        wire.calm();
        operator.round(rt::now());
    }
    operator.leave(rt::now());
    Ok(())
}

/// The file that tells whose sockets these are. It goes with this program.
struct Marker(PathBuf);

impl Drop for Marker {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

impl Operator {
    /// Waits until a person or a datagram arrives, at most [`WAIT_NS`].
    fn wait(&self, wire: &Wire) {
        let (sockets, count) = self.persons.descriptors(rt::now());
        let mut all = [const { None }; CONNECTIONS_MAX + 2];
        for (place, socket) in all.iter_mut().zip(sockets.iter().take(count).copied().chain([wire.event()])) {
            *place = Some(PollFd::from_borrowed_fd(socket, PollFlags::IN));
        }
        let mut all: Vec<_> = all.into_iter().flatten().collect();
        let _ = poll(&mut all, Some(&Timespec { tv_sec: 0, tv_nsec: WAIT_NS }));
    }

    fn round(&mut self, now: Stamp) {
        self.send_persons(now);
        let newest = |operator: &Self| {
            let stopped = operator.stop_wires.iter().find_map(|wire| wire.answers.take());
            stopped.or_else(|| operator.answers.take())
        };
        while let Some(bytes) = newest(self) {
            // An answer may arrive after this round began. A time before its arrival would look like a jump of the clock.
            let now = rt::now();
            match self.end.receive(&bytes, now) {
                Ok(Down::Status(status)) => self.status = Some((status, now)),
                Ok(Down::Feedback(feedback)) => self.persons.feed_back(&feedback),
                Ok(Down::Answer(_)) | Err(_) => {}
            }
        }
        // The next frame echoes these answers. Its time may not be before theirs.
        let now = rt::now();
        let pressed = self.serve(now);
        if pressed || now >= self.due {
            self.beat(now);
        }
        self.print_state(now);
    }

    /// Sends the persons that have arrived, of one client at a time.
    fn send_persons(&mut self, now: Stamp) {
        let (mut newest, mut holder) = (None, self.holder);
        let led_by_other = self.end.link(now).answer.is_some_and(|answer| answer.led_by_other);
        let held = led_by_other || now.since(holder.1) < SILENT_NS;
        self.persons.poll(now, held, |source: FrameSource, frame: &RawSkeleton| {
            if source.session_nonce != holder.0 && now.since(holder.1) < SILENT_NS {
                return LeaseState::NotHolder;
            }
            holder = (source.session_nonce, now);
            newest = Some(*frame);
            // It is sent all the same: the robot takes it once the other is silent.
            if led_by_other { LeaseState::NotHolder } else { LeaseState::Holder }
        });
        self.holder = holder;
        let Some(person) = newest else { return };
        let mut bytes = [0; FRAME_BYTES_MAX];
        // The person may be younger than this round, and is refused if it seems younger than the datagram.
        match self.end.person(&person, rt::now(), &mut bytes) {
            Ok(length) => send(&self.up[1], &bytes[..length]),
            Err(Unsendable::NoSession) => {}
            Err(error) => {
                if self.unsendable != Some(error) {
                    out!("bridge: a person cannot be sent: {error}");
                }
                self.unsendable = Some(error);
            }
        }
    }

    /// Serves the clients of the operator socket. Returns true if something must go up at once.
    fn serve(&mut self, now: Stamp) -> bool {
        let status = self.status.filter(|(_, at)| now.since(*at) <= super::STATUS_GONE_NS && self.end.is_linked(now));
        let Some((status, _)) = status else { return self.close(now) };
        self.is_open = true;
        let counts = self.operators.poll(now, &status);
        self.heartbeat.update(&counts)
    }

    /// Ends all connections of the operator socket: clients have to press again. Emergency stops still count, and go up
    /// until the robot has heard them. Returns true if something must go up at once.
    fn close(&mut self, now: Stamp) -> bool {
        // All that is known is that `control` has the stop.
        let latched = Faults::NONE.with(Fault::EmergencyStop).0;
        let stopped = Status { mode: Mode::Faulted as u32, latched, ..Status::ZERO };
        let stops = self.end.stops_heard();
        let has_stopped = stops != 0 && stops == self.heartbeat.request.estop_count;
        let was_open = std::mem::take(&mut self.is_open);
        let counts = self.operators.poll_stops(now, has_stopped.then_some(&stopped), was_open);
        let pressed = self.heartbeat.update_stops(&counts);
        if was_open {
            self.heartbeat.withdraw();
        }
        pressed || was_open
    }

    /// Releases, and tells it once.
    fn leave(&mut self, now: Stamp) {
        self.close(now);
        self.heartbeat.withdraw();
        self.beat(now);
    }

    fn beat(&mut self, now: Stamp) {
        self.heartbeat.beat();
        self.due = now.plus_ns(BEAT_NS);
        let mut bytes = [0; FRAME_BYTES_MAX];
        let stop_waits = self.end.stops_heard() != self.heartbeat.request.estop_count;
        if now.since(self.stop_sent) >= STOP_EVERY_NS[usize::from(stop_waits)] {
            self.stop_sent = now;
            let length = self.end.heartbeat(&self.heartbeat.request, now, &mut bytes);
            self.stop_wires.iter().for_each(|wire| send(&wire.requests, &bytes[..length]));
        }
        let length = self.end.heartbeat(&self.heartbeat.request, now, &mut bytes);
        send(&self.up[0], &bytes[..length]);
    }

    fn print_state(&mut self, now: Stamp) {
        let link = self.end.link(now);
        let state = match link.answer {
            // A connection takes a moment.
            None if now.since(self.started) < SILENT_NS => return,
            None => NO_ANSWER.into(),
            Some(answer) => state_name(&answer),
        };
        self.report.print(now, &format!("{}: {state}", self.robot), || robot_details(&link));
    }
}
