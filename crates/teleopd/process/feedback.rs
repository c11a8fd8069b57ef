//! The thread of `ingest` that tells clients about the robot: 20 times a second, on shared memory and through the socket.
//! The loop never waits for it.

use super::bus_failure;
use bus::{Domain, Reader, Writer};
use instance::Instance;
use messages::{Feedback, Header, JointTarget, Layout, RobotState, Service, Stamp, Status, feedback_flag};
use retarget::ArmModel;
use robot::{Model, Names};
use rt::{Exit, Failure};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Period, ns.
const EVERY_NS: u64 = 50_000_000;
/// Silence of `control` or of the driver after which nothing is known of it, ns. Status comes 50 times a second.
const SILENT_NS: u64 = 500_000_000;

/// Feedback that the socket has not sent yet. Only the newest one matters, so one waits at most.
pub struct FeedbackSource(Receiver<Feedback>);

impl FeedbackSource {
    /// Returns feedback that is new. Never waits.
    pub fn take(&self) -> Option<Feedback> {
        self.0.try_recv().ok()
    }
}

/// Starts the thread. It ends with the process.
pub fn start(instance: &Instance, model: Model, header: Header) -> Result<FeedbackSource, Failure> {
    let core = Domain::open(instance.core_domain(), "feedback").map_err(bus_failure)?;
    let input = Domain::open(instance.input_domain(), "feedback").map_err(bus_failure)?;
    let (to_socket, source) = sync_channel(1);
    let (tell, told) = sync_channel(1);
    let work = move || match Ports::open(&core, &input) {
        Ok(ports) => {
            let _ = tell.send(Ok(()));
            run(ports, &model, header, &to_socket);
        }
        Err(failure) => _ = tell.send(Err(failure)),
    };
    std::thread::Builder::new().name("feedback".into()).spawn(work).map_err(Failure::with(Exit::OsErr))?;
    told.recv().map_err(Failure::with(Exit::Software))??;
    Ok(FeedbackSource(source))
}

/// The thread's ends of the services. They must stay in the thread that opened them.
struct Ports {
    statuses: Reader<Status>,
    states: Reader<RobotState>,
    targets: Reader<JointTarget>,
    feedback: Writer<Feedback>,
}

impl Ports {
    fn open(core: &Domain, input: &Domain) -> Result<Self, Failure> {
        Ok(Self {
            statuses: core.reader(Service::Status).map_err(bus_failure)?,
            states: core.reader(Service::RobotState).map_err(bus_failure)?,
            targets: core.reader(Service::JointTarget).map_err(bus_failure)?,
            feedback: input.writer(Service::Feedback).map_err(bus_failure)?,
        })
    }
}

fn run(mut ports: Ports, model: &Model, mut header: Header, to_socket: &SyncSender<Feedback>) {
    let (arm, names) = (ArmModel::of(model), Names::of(model));
    let (mut status, mut state, mut target) = (None::<Status>, None::<RobotState>, None::<JointTarget>);
    let mut due = rt::now();
    loop {
        due = due.max(rt::now()).plus_ns(EVERY_NS);
        rt::sleep_until(due);
        status = ports.statuses.latest().or(status);
        state = ports.states.latest().or(state);
        target = ports.targets.latest().or(target);
        let now = rt::now();
        let fresh = |header: &Header| now.since(header.stamp) <= SILENT_NS;
        let (status, state, target) = (
            status.as_ref().filter(|status| fresh(&status.header)),
            state.as_ref().filter(|state| fresh(&state.header) && state.robot == model.id()),
            target.as_ref().filter(|target| fresh(&target.header) && target.robot == model.id()),
        );
        let mut feedback = state.map_or(Feedback::ZERO, |state| control::feedback(model, &arm, state, target));
        if let Some(status) = status {
            feedback.known |= feedback_flag::STATUS;
            (feedback.mode, feedback.faults) = (status.mode, status.faults);
            feedback.speed_scale = status.speed_scale as f32;
            feedback.set_sentence(&explain::why(status, &names));
        }
        (header.sequence, header.stamp) = (header.sequence + 1, now);
        header.origin = target.map_or(Stamp::NONE, |target| target.header.origin);
        feedback.header = header;
        // Nobody may listen, and the socket may be late. The next one comes in 50 ms.
        let _ = ports.feedback.publish(&feedback);
        let _ = to_socket.try_send(feedback);
    }
}
