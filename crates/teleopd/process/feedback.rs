//! The thread of `ingest` that tells clients about the robot, on shared memory and through the socket: the joints 100 times a
//! second, and what a person can feel 20 times a second. The loop never waits for it.

use super::{Process, bus_failure};
use bus::{Domain, Reader, Writer};
use instance::Instance;
use messages::{
    ChunkDrop, Feedback, Header, JointTarget, Joints, Layout, RobotState, Service, Stamp, Status, feedback_flag,
    joints_flag, state_flag, target_flag,
};
use retarget::ArmModel;
use robot::{Model, Names};
use rt::{Background, Failure};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Period of the joints, ns.
const EVERY_NS: u64 = 10_000_000;
/// Messages of the joints for each feedback.
const FEEDBACK_EVERY: u64 = 5;
/// A chunk that was dropped within this time counts as dropped now, ns.
const DROPPED_NOW_NS: u64 = 1_000_000_000;
/// Silence of `control` or of the driver after which nothing is known of it, ns. Status comes 50 times a second.
const SILENT_NS: u64 = 500_000_000;

/// The newest messages that the socket has not sent yet.
type Slots = (Mutex<Option<Feedback>>, Mutex<Option<Joints>>);

/// Chunks of policies that were dropped: the time of the newest, its reason plus one, and how many there were of each reason.
#[derive(Default)]
pub struct Dropped([AtomicU64; 2], [AtomicU64; ChunkDrop::ALL.len()]);

impl Dropped {
    /// Adds a chunk. Returns true if none was dropped within the second before.
    pub fn add(&self, now: Stamp, reason: ChunkDrop) -> bool {
        self.1[reason as usize].fetch_add(1, Ordering::Relaxed);
        self.0[1].store(reason as u64 + 1, Ordering::Relaxed);
        now.since(Stamp(self.0[0].swap(now.0, Ordering::Relaxed))) > DROPPED_NOW_NS
    }

    /// Number of chunks for each `ChunkDrop`.
    pub fn counts(&self) -> [u64; ChunkDrop::ALL.len()] {
        self.1.each_ref().map(|count| count.load(Ordering::Relaxed))
    }
}

/// The running thread. It ends, and leaves nothing in shared memory, when this is dropped.
pub struct FeedbackThread {
    slots: Arc<Slots>,
    pub dropped: Arc<Dropped>,
    _thread: Option<Background>,
}

impl FeedbackThread {
    /// Returns feedback that is new. Never waits.
    pub fn take(&self) -> Option<Feedback> {
        self.slots.0.try_lock().ok()?.take()
    }

    /// Returns joints that are new. Never waits.
    pub fn take_joints(&self) -> Option<Joints> {
        self.slots.1.try_lock().ok()?.take()
    }
}

/// Starts the thread. Skeletons do not depend on it: if it cannot start, for example because a
/// client has taken the service's place, `ingest` says so and goes on without.
pub fn start(process: &Process) -> FeedbackThread {
    let (slots, dropped) = (Arc::<Slots>::default(), Arc::new(Dropped::default()));
    let (own, drops, instance) = (slots.clone(), dropped.clone(), process.instance.clone());
    let (model, header) = (process.loaded.model.clone(), process.header(0, Stamp::NONE, Stamp::NONE));
    let work = move |ends: &AtomicBool| match Ports::open(&instance) {
        Ok(ports) => run(ports, &model, header, (&own, &drops), ends),
        Err(failure) => tracing::warn!("clients get no feedback: {failure}"),
    };
    let thread = Background::start("feedback", work);
    let thread = thread.map_err(|error| tracing::warn!("clients get no feedback: {error}")).ok();
    FeedbackThread { slots, dropped, _thread: thread }
}

/// The thread's ends of the services. They must stay in the thread that opened them.
struct Ports {
    statuses: Reader<Status>,
    states: Reader<RobotState>,
    targets: Reader<JointTarget>,
    policies: Reader<JointTarget>,
    joints: Writer<Joints>,
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
            policies: core.reader(Service::PolicyTarget).map_err(bus_failure)?,
            joints: input.writer(Service::Joints).map_err(bus_failure)?,
            feedback: input.writer(Service::Feedback).map_err(bus_failure)?,
            _domains: [core, input],
        })
    }
}

fn run(mut ports: Ports, model: &Model, mut header: Header, (slots, drops): (&Slots, &Dropped), ends: &AtomicBool) {
    let (arms, names) = (ArmModel::both(model), Names::from_model(model));
    let (mut status, mut state, mut target) = (None::<Status>, None::<RobotState>, None::<JointTarget>);
    let mut policy = None::<JointTarget>;
    let (mut due, mut round) = (rt::now(), 0);
    while !ends.load(Ordering::Acquire) {
        (due, round) = (due.max(rt::now()).plus_ns(EVERY_NS), round + 1);
        rt::sleep_until(due);
        status = ports.statuses.latest().or(status);
        state = ports.states.latest().or(state);
        target = ports.targets.latest().or(target);
        policy = ports.policies.latest().or(policy);
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
        (header.sequence, header.stamp) = (header.sequence + 1, now);
        header.origin = state.map_or(Stamp::NONE, |state| state.header.origin);
        let policy = policy.as_ref().filter(|policy| fresh(&policy.header) && policy.session_nonce != 0);
        let mut joints = joints(model, status, state, policy);
        joints.header = header;
        if now.since(Stamp(drops.0[0].load(Ordering::Relaxed))) <= DROPPED_NOW_NS {
            joints.chunk_dropped_why = drops.0[1].load(Ordering::Relaxed) as u32;
        }
        joints.chunks_dropped = drops.counts();
        // Nobody may listen. The next one comes in 10 ms.
        let _ = ports.joints.publish(&joints);
        if let Ok(mut newest) = slots.1.lock() {
            *newest = Some(joints);
        }
        if round % FEEDBACK_EVERY != 0 {
            continue;
        }
        let mut feedback = state.map_or(Feedback::ZERO, |state| control::feedback(model, &arms, state, target));
        if let Some(status) = status {
            feedback.known |= feedback_flag::STATUS;
            (feedback.mode, feedback.faults) = (status.mode, status.faults);
            feedback.speed_scale = status.speed_scale as f32;
            feedback.set_sentence(&explain::why(status, &names));
        }
        feedback.header = header;
        let _ = ports.feedback.publish(&feedback);
        if let Ok(mut newest) = slots.0.lock() {
            *newest = Some(feedback);
        }
    }
}

/// The joints of a robot as clients get them, without the header.
fn joints(model: &Model, status: Option<&Status>, state: Option<&RobotState>, policy: Option<&JointTarget>) -> Joints {
    let mut joints = Joints { robot: model.id(), ..Joints::ZERO };
    if let Some(status) = status {
        (joints.mode, joints.sources) = (status.mode, status.sources);
        joints.known |= joints_flag::STATUS;
    }
    let Some(state) = state else { return joints };
    joints.known |= joints_flag::STATE;
    joints.k = state.executed_k.saturating_add(state.plan_ticks_played);
    (joints.commanded, joints.commanded_v) = (state.q, state.v);
    (joints.measured, joints.measured_v) = (state.q_measured, state.dq_measured);
    if let Some(policy) = policy {
        joints.known |= joints_flag::POLICY;
        for j in (0..model.count).filter(|j| policy.valid_mask & 1 << j != 0) {
            joints.short_of[j] = policy.q[j] - state.q[j];
        }
    }
    joints
}
