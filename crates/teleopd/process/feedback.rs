//! The thread of `ingest` that tells clients about the robot: 20 times a second, on shared memory and through the socket.
//! The loop never waits for it.

use super::bus_failure;
use bus::{Domain, Reader, Writer};
use instance::Instance;
use messages::{
    Feedback, Header, JointTarget, Layout, RobotState, Service, Stamp, Status, feedback_flag, state_flag, target_flag,
};
use retarget::ArmModel;
use robot::{Model, Names};
use rt::{Background, Failure};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Period, ns.
const EVERY_NS: u64 = 50_000_000;
/// Silence of `control` or of the driver after which nothing is known of it, ns. Status comes 50 times a second.
const SILENT_NS: u64 = 500_000_000;

/// The newest feedback that the socket has not sent yet.
type Slot = Mutex<Option<Feedback>>;

/// The running thread. It ends, and leaves nothing in shared memory, when this is dropped.
pub struct FeedbackThread {
    slot: Arc<Slot>,
    _thread: Option<Background>,
}

impl FeedbackThread {
    /// Returns feedback that is new. Never waits.
    pub fn take(&self) -> Option<Feedback> {
        self.slot.try_lock().ok()?.take()
    }
}

/// Starts the thread. Skeletons do not depend on it: if it cannot start, for example because a
/// client has taken the service's place, `ingest` says so and goes on without.
pub fn start(instance: &Instance, model: Model, header: Header) -> FeedbackThread {
    let slot = Arc::new(Slot::default());
    let (own, instance) = (slot.clone(), instance.clone());
    let work = move |ends: &AtomicBool| match Ports::open(&instance) {
        Ok(ports) => run(ports, &model, header, &own, ends),
        Err(failure) => tracing::warn!("clients get no feedback: {failure}"),
    };
    let thread = Background::start("feedback", work);
    let thread = thread.map_err(|error| tracing::warn!("clients get no feedback: {error}")).ok();
    FeedbackThread { slot, _thread: thread }
}

/// The thread's ends of the services. They must stay in the thread that opened them.
struct Ports {
    statuses: Reader<Status>,
    states: Reader<RobotState>,
    targets: Reader<JointTarget>,
    feedback: Writer<Feedback>,
    _domains: [Domain; 2],
}

impl Ports {
    fn open(instance: &Instance) -> Result<Self, Failure> {
        let core = Domain::open(instance.core_domain(), "feedback").map_err(bus_failure)?;
        let input = Domain::open(instance.input_domain(), "feedback").map_err(bus_failure)?;
        Ok(Self {
            statuses: core.reader(Service::Status).map_err(bus_failure)?,
            states: core.reader(Service::RobotState).map_err(bus_failure)?,
            targets: core.reader(Service::JointTarget).map_err(bus_failure)?,
            feedback: input.writer(Service::Feedback).map_err(bus_failure)?,
            _domains: [core, input],
        })
    }
}

fn run(mut ports: Ports, model: &Model, mut header: Header, slot: &Slot, ends: &AtomicBool) {
    let (arm, names) = (ArmModel::from_model(model), Names::from_model(model));
    let (mut status, mut state, mut target) = (None::<Status>, None::<RobotState>, None::<JointTarget>);
    let mut due = rt::now();
    while !ends.load(Ordering::Acquire) {
        due = due.max(rt::now()).plus_ns(EVERY_NS);
        rt::sleep_until(due);
        status = ports.statuses.latest().or(status);
        state = ports.states.latest().or(state);
        target = ports.targets.latest().or(target);
        let now = rt::now();
        let fresh = |header: &Header| now.since(header.stamp) <= SILENT_NS;
        let (status, state, target) = (
            status.as_ref().filter(|status| fresh(&status.header)),
            // A driver that latched may go on with an old measurement.
            state.as_ref().filter(|state| {
                let old = state.flags & (state_flag::DRIVER_FAULT | state_flag::UNSEEN) != 0;
                fresh(&state.header) && state.robot == model.id() && !old
            }),
            target.as_ref().filter(|target| {
                fresh(&target.header) && target.robot == model.id() && target.flags & target_flag::INPUT_FRESH != 0
            }),
        );
        let mut feedback = state.map_or(Feedback::ZERO, |state| control::feedback(model, &arm, state, target));
        if let Some(status) = status {
            feedback.known |= feedback_flag::STATUS;
            (feedback.mode, feedback.faults) = (status.mode, status.faults);
            feedback.speed_scale = status.speed_scale as f32;
            feedback.set_sentence(&explain::why(status, &names));
        }
        (header.sequence, header.stamp) = (header.sequence + 1, now);
        header.origin = state.map_or(Stamp::NONE, |state| state.header.origin);
        feedback.header = header;
        // Nobody may listen. The next one comes in 50 ms.
        let _ = ports.feedback.publish(&feedback);
        if let Ok(mut newest) = slot.lock() {
            *newest = Some(feedback);
        }
    }
}
