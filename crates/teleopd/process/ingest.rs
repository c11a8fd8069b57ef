//! Takes skeletons from clients and publishes those that pass validation. One client holds the lease. Clients of
//! the daemon's own user connect by shared memory, other users' clients by a socket.

use super::feedback::FeedbackThread;
use super::lease::Lease;
use super::{Process, bus_failure, door_group};
use crate::cli::InstanceArgs;
use bus::{Domain, Sample, WakingReader, Writer};
use config::{HandOff, Operators};
use doors::{DoorError, FrameSource, LeaseState, NoChunk, Reply, Server, SocketEvent};
use ingest::{ClientIdentity, PolicyState};
use messages::{
    ChunkDrop, InputStatus, Layout, PolicyChunk, RawSkeleton, RobotId, Service, Skeleton, Stamp, TICK_HZ, deadline,
    tick_at,
};
use rt::{Exit, Failure};
use serde_json::json;
use skeleton::DropReason;
use std::time::Duration;
use telemetry::{Counter, Event, Metric};

/// Longest wait for input before the loop continues: half the period of the joints.
const WAIT: Duration = Duration::from_millis(5);

/// Time between two `InputStatus`: ten a second.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// Half a period of the tick grid, ns.
const HALF_PERIOD_NS: u64 = 500_000_000 / TICK_HZ;

pub fn run(place: &InstanceArgs) -> Result<(), Failure> {
    let mut process = Process::start("ingest", place, |_| None)?;
    let group = door_group(place, "doors.skeleton_group", &process.loaded.settings.doors.skeleton_group)?;
    let input = Domain::open(process.instance.input_domain(), "ingest").map_err(bus_failure)?;
    let core = Domain::open(process.instance.core_domain(), "ingest").map_err(bus_failure)?;
    let mut clients = input.waking_reader::<RawSkeleton>(Service::RawSkeleton).map_err(bus_failure)?;
    let mut chunks = input.reader::<PolicyChunk>(Service::PolicyChunk).map_err(bus_failure)?;
    let skeletons = core.writer::<Skeleton>(Service::Skeleton).map_err(bus_failure)?;
    let statuses = core.writer::<InputStatus>(Service::InputStatus).map_err(bus_failure)?;
    // Opened last. The socket belongs to this process, because it is now the only writer of skeletons.
    let mut socket = Server::bind(&process.instance.skeleton_socket(), group).map_err(door_failure)?.with_policies();

    // Left behind by a killed end of a link. The sockets here are this instance's now.
    let _ = std::fs::remove_file(process.instance.run_dir().join(doors::LINK_FILE));

    let timeout_ms = process.loaded.settings.ingest.authority_timeout_ms;
    let mut ingest_loop = IngestLoop {
        lease: Lease::new(timeout_ms),
        config: world::input_config(
            &process.loaded.settings.ingest,
            process.loaded.layouts.clone(),
            &process.loaded.operators,
            process.loaded.lifter.clone(),
        ),
        state: ingest::State::default(),
        skeletons,
        sequence: 0,
        dropped: Dropped::since(rt::now()),
        statuses,
        status: InputStatus::ZERO,
        policy: PolicyDoor {
            lease: Lease::new(timeout_ms),
            state: PolicyState::default(),
            robot: process.loaded.model.id(),
            chunks: core.writer(Service::Policy).map_err(bus_failure)?,
            sequence: 0,
            feedback: super::feedback::start(&process),
        },
    };
    let polled = process.loaded.settings.realtime.hand_off == HandOff::Polled;
    process.ready()?;
    while !process.shutdown.requested() {
        if polled {
            // Sleeps until the middle between two deadlines of `retarget`. Half a period is the average cost of
            // an unsynchronised timer.
            let k = tick_at(rt::now().plus_ns(HALF_PERIOD_NS));
            process.shutdown.sleep_until(deadline(k).plus_ns(HALF_PERIOD_NS));
        } else {
            wait(&mut clients, &socket);
        }
        let now = rt::now();
        ingest_loop.lease.authority.look(now);
        ingest_loop.policy.lease.authority.look(now);
        let held = ingest_loop.lease.is_held(now);
        socket.poll(now, held, |from, frame| ingest_loop.receive_packet(&mut process, from, frame));
        rt::allocating_aside(|| {
            clients.drain(|sample| rt::allocating_ourselves(|| ingest_loop.receive_sample(&mut process, &sample)))
        });
        rt::allocating_aside(|| {
            chunks.drain(|sample| rt::allocating_ourselves(|| ingest_loop.policy.receive(&mut process, &sample)))
        });
        socket.poll_policies(now, |from, text| ingest_loop.policy.receive_text(&mut process, from, text));
        ingest_loop.report(&mut process, &mut socket);
        ingest_loop.publish_status(&mut process);
        process.alive();
    }
    process.leave(ingest_loop.figures(&socket))
}

fn door_failure(error: DoorError) -> Failure {
    let exit = if matches!(error, DoorError::InUse { .. }) { Exit::TempFail } else { Exit::Unavailable };
    Failure::new(exit, error)
}

/// Waits for input from shared memory or the socket. Ends early when a rate-limited connection may be read again.
fn wait(clients: &mut WakingReader<RawSkeleton>, socket: &Server) {
    let now = rt::now();
    let (descriptors, count) = socket.descriptors(now);
    let wait = socket.next_due(now).map_or(WAIT, |due| Duration::from_nanos(due.since(now)).min(WAIT));
    rt::allocating_aside(|| clients.wait_also(wait, &descriptors[..count]));
}

/// Processing of a frame after its arrival: lease, validation, the core domain.
struct IngestLoop {
    lease: Lease,
    config: ingest::Config,
    state: ingest::State,
    skeletons: Writer<Skeleton>,
    sequence: u64,
    dropped: Dropped,
    statuses: Writer<InputStatus>,
    status: InputStatus,
    policy: PolicyDoor,
}

/// The door of policies, with a lease of its own.
struct PolicyDoor {
    lease: Lease,
    state: PolicyState,
    robot: RobotId,
    chunks: Writer<PolicyChunk>,
    sequence: u64,
    feedback: FeedbackThread,
}

impl PolicyDoor {
    /// Passes on a chunk of the policy that holds the lease. Any other is counted, and reported to policies and to the log.
    fn receive(&mut self, process: &mut Process, sample: &Sample<PolicyChunk>) {
        let (now, raw) = (rt::now(), sample.message);
        let claim = self.lease.claim(now, sample, raw.session_nonce);
        let _ = self.pass_on(process, now, claim, |_| Ok(raw));
    }

    /// Does the same with a message of the socket, which keeps their order. Returns the answer to one that is dropped.
    fn receive_text(&mut self, process: &mut Process, from: FrameSource, text: Option<&[u8]>) -> Option<String> {
        let (now, robot) = (rt::now(), self.robot);
        let chunk = |names: &[String]| doors::chunk_from_json(text.unwrap_or_default(), names, robot, now);
        self.lease.over_quota += u64::from(text.is_none());
        let dropped = self.pass_on(process, now, text.map(|_| identity(from)), chunk).err()?;
        Some(rt::allocating_aside(|| doors::drop_as_json(&dropped)))
    }

    /// Passes on a chunk of `claim`. `None` is one that sent more than its quota. Only the holder's is made, from the joints' names.
    fn pass_on(
        &mut self,
        process: &mut Process,
        now: Stamp,
        claim: Option<ClientIdentity>,
        chunk: impl FnOnce(&[String]) -> Result<PolicyChunk, NoChunk>,
    ) -> Result<(), NoChunk> {
        let known = |reason: ChunkDrop| (reason, reason.meaning().into());
        let judged = match claim {
            None => Err(known(ChunkDrop::Quota)),
            Some(claim) if !self.lease.admits(process, now, claim, "policies") => Err(known(ChunkDrop::Lease)),
            Some(ClientIdentity { session_nonce, .. }) => {
                let raw = rt::allocating_aside(|| chunk(&process.loaded.model.joint_names));
                let raw = raw.map(|raw| PolicyChunk { session_nonce, ..raw });
                raw.and_then(|raw| self.state.judge(self.robot, now, &raw).map_err(known))
            }
        };
        match &judged {
            Ok(chunk) => {
                self.sequence += 1;
                let header = process.header(self.sequence, rt::now(), chunk.header.origin);
                let chunk = PolicyChunk { header, session_nonce: self.lease.session_nonce, ..*chunk };
                process.publish(&mut self.chunks, &chunk);
            }
            Err((reason, _)) if self.feedback.dropped.add(now, *reason) => {
                let (reason, meaning) = (reason.name(), reason.meaning());
                process.probe.event(Event::Dropped { frames: 1, reason, meaning });
            }
            Err(_) => {}
        }
        judged.map(drop)
    }
}

/// Returns the client that the kernel saw at the socket.
fn identity(from: FrameSource) -> ClientIdentity {
    let FrameSource { connection, peer, session_nonce } = from;
    let (door, port) = (ingest::Door::Socket, u128::from(connection));
    ClientIdentity { door, uid: peer.uid, pid: peer.pid, port, session_nonce }
}

/// Nanoseconds in a second.
const SECOND_NS: u64 = 1_000_000_000;

const _: () = assert!(skeleton::DROP_REASONS <= messages::DROPS_MAX, "every reason has its place");

/// Drop counts before the current second. A client whose frames are all bad must see why. A second gives at most
/// one log line per reason.
struct Dropped {
    since: Stamp,
    before: [u64; skeleton::DROP_REASONS],
}

impl Dropped {
    fn since(now: Stamp) -> Self {
        Self { since: now, before: [0; skeleton::DROP_REASONS] }
    }

    /// Once a second has passed, reports each reason with the number of frames it cost.
    fn turn(&mut self, now: Stamp, state: &skeleton::State, mut report: impl FnMut(DropReason, u64)) {
        if now.since(self.since) < SECOND_NS {
            return;
        }
        self.since = now;
        for (before, &reason) in self.before.iter_mut().zip(&DropReason::ALL) {
            let frames = state.dropped(reason) - *before;
            *before += frames;
            // The first frame of a session, or of another person, is never used. That is not an error.
            let expected = matches!(reason, DropReason::SessionChanged | DropReason::OperatorChanged);
            if frames > u64::from(expected) {
                report(reason, frames);
            }
        }
    }
}

impl IngestLoop {
    fn receive_sample(&mut self, process: &mut Process, sample: &Sample<RawSkeleton>) {
        let now = rt::now();
        if let Some(claim) = self.lease.claim(now, sample, sample.message.session_nonce) {
            self.process_frame(process, now, claim, &sample.message);
        }
    }

    fn receive_packet(&mut self, process: &mut Process, from: FrameSource, frame: &RawSkeleton) -> LeaseState {
        let holds = self.process_frame(process, rt::now(), identity(from), frame);
        if holds { LeaseState::Holder } else { LeaseState::NotHolder }
    }

    /// Returns true if the frame's session holds the lease.
    fn process_frame(&mut self, process: &mut Process, now: Stamp, claim: ClientIdentity, raw: &RawSkeleton) -> bool {
        process.probe.record(Metric::PublishedToIngest, raw.header.stamp, now);
        let session = self.lease.session_nonce;
        if !self.lease.admits(process, now, claim, claim.door.name()) {
            return false;
        }
        if self.lease.session_nonce != session {
            self.reread_operators(process);
        }
        let raw = RawSkeleton { session_nonce: self.lease.session_nonce, ..*raw };
        let out = ingest::tick(&self.config, &mut self.state, now, &raw);
        (self.status.layout, self.status.operator_id, self.status.flags) = (raw.layout, raw.operator_id, raw.flags);
        let Some(person) = out.skeleton else {
            self.status.dropped_at = now;
            self.status.dropped_why = out.drop.map_or(0, |reason| reason as u32 + 1);
            return true;
        };
        self.sequence += 1;
        let stamp = rt::now();
        let header = process.header(self.sequence, stamp, person.header.origin);
        process.publish(&mut self.skeletons, &Skeleton { header, ..person });
        process.probe.record(Metric::IngestWork, now, stamp);
        true
    }

    /// Reads the operators' files again. This happens when a lease begins, while no robot moves. New measurements
    /// of operators take effect now. If the folder cannot be read, nothing changes.
    fn reread_operators(&mut self, process: &mut Process) {
        let read = || Operators::read(&process.loaded.operators_dir).map(|operators| operators.calibrations());
        match rt::allocating_aside(read) {
            Ok(calibrations) => self.config.calibrations = calibrations,
            Err(error) => tracing::warn!("ingest: {error}; the previous operators stay in use"),
        }
    }

    /// Publishes ten times a second who holds the lease and how many frames were used or dropped.
    fn publish_status(&mut self, process: &mut Process) {
        let now = rt::now();
        if now.since(self.status.header.stamp) < STATUS_EVERY_NS {
            return;
        }
        let skeleton = &self.state.skeleton;
        self.status.header = process.header(self.status.header.sequence + 1, now, Stamp::NONE);
        self.status.accepted = skeleton.accepted();
        for reason in DropReason::ALL {
            self.status.dropped[reason as usize] = skeleton.dropped(reason);
        }
        self.status.calibration = skeleton.calibration() as u32;
        self.status.lost_permille = skeleton.lost_permille();
        self.status.online = skeleton.online();
        process.publish(&mut self.statuses, &self.status);
    }

    /// Reports to the clients of the socket, to the metrics and to the log.
    fn report(&mut self, process: &mut Process, socket: &mut Server) {
        if let Some(joints) = self.policy.feedback.take_joints() {
            rt::allocating_aside(|| socket.send_joints(&joints, &process.loaded.model.joint_names));
        }
        if let Some(feedback) = self.policy.feedback.take() {
            socket.feed_back(&feedback);
        }
        let counters = process.probe.counters();
        let leases = [&self.lease, &self.policy.lease];
        counters.set(Counter::WithoutAuthority, leases.map(|lease| lease.authority.frames_refused()).iter().sum());
        let over_quota: u64 = leases.map(|lease| lease.over_quota).iter().sum();
        counters.set(Counter::OverQuota, over_quota + socket.over_quota());
        let refused = Reply::ALL.into_iter().filter(|word| word.is_refusal());
        counters.set(Counter::Refused, refused.map(|word| socket.reply_count(word)).sum());
        counters.set(Counter::Outliers, self.state.outliers());
        socket.drain_events(|SocketEvent { word, peer }| {
            let refused = word.is_refusal() || word == Reply::OverQuota;
            process.probe.event(Event::Visitor { what: word.meaning(), refused, uid: peer.uid, pid: peer.pid });
        });
        self.dropped.turn(rt::now(), &self.state.skeleton, |reason, frames| {
            let (reason, meaning) = (reason.name(), reason.meaning());
            process.probe.event(Event::Dropped { frames, reason, meaning });
        });
    }

    fn figures(&self, socket: &Server) -> serde_json::Value {
        let reasons = DropReason::ALL.iter().map(|&reason| (reason.name(), self.state.skeleton.dropped(reason)));
        let dropped = self.policy.feedback.dropped.counts();
        let drops = ChunkDrop::ALL.iter().map(|&reason| (reason.name(), dropped[reason as usize]));
        let words = Reply::ALL.into_iter().map(|word| (word.name(), socket.reply_count(word)));
        let holder = self.lease.authority.holder().map(|claim| {
            let ClientIdentity { door, uid, pid, .. } = claim;
            json!({ "door": door.name(), "uid": uid, "pid": pid })
        });
        json!({
            "accepted": self.state.skeleton.accepted(),
            "dropped": counted(reasons),
            "outliers": self.state.outliers(),
            "without_authority": self.lease.authority.frames_refused(),
            "over_quota": { "shared memory": self.lease.over_quota, "socket": socket.over_quota() },
            "leases": self.lease.authority.grants(),
            "holder": holder,
            "connections": counted(words),
            "chunks": { "accepted": self.policy.sequence, "dropped": counted(drops) },
        })
    }
}

fn counted(all: impl Iterator<Item = (&'static str, u64)>) -> serde_json::Map<String, serde_json::Value> {
    all.filter(|(_, count)| *count > 0).map(|(name, count)| (name.to_owned(), json!(count))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_are_reported_once_a_second_by_reason() {
        let mut state = skeleton::State::default();
        let mut dropped = Dropped::since(Stamp(0));
        let reports = |dropped: &mut Dropped, state: &skeleton::State, ms: u64| {
            let mut all = Vec::new();
            dropped.turn(Stamp(ms * 1_000_000), state, |reason, frames| all.push((reason, frames)));
            all
        };
        state.refuse(DropReason::SessionChanged);
        (0..150).for_each(|_| _ = state.refuse(DropReason::Size));
        state.refuse(DropReason::Old);
        assert_eq!(reports(&mut dropped, &state, 999), []);
        assert_eq!(reports(&mut dropped, &state, 1000), [(DropReason::Old, 1), (DropReason::Size, 150)]);
        assert_eq!(reports(&mut dropped, &state, 2000), [], "nothing more");
        state.refuse(DropReason::Size);
        assert_eq!(reports(&mut dropped, &state, 2999), []);
        assert_eq!(reports(&mut dropped, &state, 3000), [(DropReason::Size, 1)]);
    }
}
