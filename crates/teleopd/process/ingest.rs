//! Takes skeletons from clients and publishes those that pass validation. One client holds the lease. Clients of
//! the daemon's own user connect by shared memory, other users' clients by a socket.

use super::feedback::FeedbackThread;
use super::{Process, bus_failure, door_group};
use crate::cli::InstanceArgs;
use bus::{Domain, PublisherId, Sample, WakingReader, Writer};
use config::{HandOff, Operators};
use doors::{Bucket, DoorError, FrameSource, LeaseState, Reply, Server, SocketEvent, draw_nonce};
use ingest::{Authority, ClientIdentity, PolicyState};
use messages::{
    InputStatus, Layout, PolicyChunk, RawSkeleton, RobotId, Service, Skeleton, Stamp, TICK_HZ, deadline, tick_at,
};
use rt::{Exit, Failure};
use serde_json::json;
use skeleton::DropReason;
use std::time::Duration;
use telemetry::{Counter, Event, Metric};

/// Longest wait for input before the loop continues: a tenth of the shortest lease timeout.
const WAIT: Duration = Duration::from_millis(10);

/// Logs the first frame of a client without the lease, then every 600th: once in ten seconds at 60 Hz.
const LOGGED_EVERY: u64 = 600;
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
    let mut socket = Server::bind(&process.instance.skeleton_socket(), group).map_err(door_failure)?;

    // Left behind by a killed end of a link. The sockets here are this instance's now.
    let _ = std::fs::remove_file(process.instance.run_dir().join(doors::LINK_FILE));

    let header = process.header(0, Stamp::NONE, Stamp::NONE);
    let feedback = super::feedback::start(&process.instance, process.loaded.model.clone(), header);

    let mut ingest_loop = IngestLoop {
        authority: Authority::default(),
        session_nonce: 0,
        quotas: Quotas::default(),
        uid: rustix::process::geteuid().as_raw(),
        timeout_ns: (process.loaded.settings.ingest.authority_timeout_ms * 1e6) as u64,
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
        policy: PolicyDoor::open(&core, process.loaded.model.id())?,
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
        ingest_loop.look(now);
        let held = ingest_loop.authority.is_held(now, ingest_loop.timeout_ns);
        socket.poll(now, held, |from, frame| ingest_loop.receive_packet(&mut process, from, frame));
        rt::allocating_aside(|| {
            clients.drain(|sample| rt::allocating_ourselves(|| ingest_loop.receive_sample(&mut process, &sample)))
        });
        rt::allocating_aside(|| {
            chunks.drain(|sample| {
                rt::allocating_ourselves(|| ingest_loop.receive_chunk(&mut process, &feedback, &sample))
            })
        });
        if let Some(feedback) = feedback.take() {
            socket.feed_back(&feedback);
        }
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

/// Token buckets of the publishers on shared memory. There are as many as possible writers.
#[derive(Default)]
struct Quotas {
    publishers: [(Option<PublisherId>, Bucket, Stamp); Service::RawSkeleton.row().writers_max],
    over: u64,
}

impl Quotas {
    /// Returns true if `publisher` has a token left. A new publisher replaces the one that was silent longest.
    fn admits(&mut self, now: Stamp, publisher: PublisherId) -> bool {
        let known = self.publishers.iter().position(|(id, ..)| *id == Some(publisher));
        let oldest = (0..self.publishers.len()).min_by_key(|&i| self.publishers[i].2).unwrap_or_default();
        let place = &mut self.publishers[known.unwrap_or(oldest)];
        if known.is_none() {
            *place = (Some(publisher), Bucket::default(), now);
        }
        place.2 = now;
        let admitted = place.1.admit(now);
        self.over += u64::from(!admitted);
        admitted
    }
}

/// Processing of a frame after its arrival: lease, validation, the core domain.
struct IngestLoop {
    authority: Authority,
    /// Session of the lease, drawn at random here. The core knows the lease by it, so no client can continue
    /// another's session.
    session_nonce: u64,
    quotas: Quotas,
    uid: u32,
    timeout_ns: u64,
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
    authority: Authority,
    /// Session of the lease, drawn at random here, as that of the skeletons.
    session_nonce: u64,
    quotas: Quotas,
    state: PolicyState,
    robot: RobotId,
    chunks: Writer<PolicyChunk>,
    sequence: u64,
}

impl PolicyDoor {
    fn open(core: &Domain, robot: RobotId) -> Result<Self, Failure> {
        Ok(Self {
            authority: Authority::default(),
            session_nonce: 0,
            quotas: Quotas::default(),
            state: PolicyState::default(),
            robot,
            chunks: core.writer(Service::Policy).map_err(bus_failure)?,
            sequence: 0,
        })
    }
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
    /// Tells both leases that `ingest` runs at `now`.
    fn look(&mut self, now: Stamp) {
        self.authority.look(now);
        self.policy.authority.look(now);
    }

    fn receive_sample(&mut self, process: &mut Process, sample: &Sample<RawSkeleton>) {
        let now = rt::now();
        if self.quotas.admits(now, sample.publisher) {
            let claim = ClientIdentity {
                door: ingest::Door::SharedMemory,
                uid: self.uid,
                pid: sample.process,
                port: sample.publisher.0,
                session_nonce: sample.message.session_nonce,
            };
            self.process_frame(process, now, claim, &sample.message);
        }
    }

    fn receive_packet(&mut self, process: &mut Process, from: FrameSource, frame: &RawSkeleton) -> LeaseState {
        let claim = ClientIdentity {
            door: ingest::Door::Socket,
            uid: from.peer.uid,
            pid: from.peer.pid,
            port: u128::from(from.connection),
            session_nonce: from.session_nonce,
        };
        if self.process_frame(process, rt::now(), claim, frame) { LeaseState::Holder } else { LeaseState::NotHolder }
    }

    /// Returns true if the frame's session holds the lease.
    fn process_frame(&mut self, process: &mut Process, now: Stamp, claim: ClientIdentity, raw: &RawSkeleton) -> bool {
        process.probe.record(Metric::PublishedToIngest, raw.header.stamp, now);
        let grants = self.authority.grants();
        if !self.authority.admits_claim(now, claim, self.timeout_ns) {
            let frames = self.authority.frames_refused();
            if frames % LOGGED_EVERY == 1 {
                process.probe.event(Event::WithoutAuthority { frames });
            }
            return false;
        }
        if self.authority.grants() != grants {
            self.session_nonce = draw_nonce();
            process.probe.event(Event::Lease { door: claim.door.name(), uid: claim.uid, pid: claim.pid });
            self.reread_operators(process);
        }
        let raw = RawSkeleton { session_nonce: self.session_nonce, ..*raw };
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

    /// Passes on a chunk of the policy that holds the lease.
    fn receive_chunk(&mut self, process: &mut Process, feedback: &FeedbackThread, sample: &Sample<PolicyChunk>) {
        let (now, door, raw) = (rt::now(), &mut self.policy, &sample.message);
        let (pid, port) = (sample.process, sample.publisher.0);
        let door_name = ingest::Door::SharedMemory;
        let claim = ClientIdentity { door: door_name, uid: self.uid, pid, port, session_nonce: raw.session_nonce };
        let grants = door.authority.grants();
        if !door.quotas.admits(now, sample.publisher) || !door.authority.admits_claim(now, claim, self.timeout_ns) {
            return;
        }
        if door.authority.grants() != grants {
            door.session_nonce = draw_nonce();
            process.probe.event(Event::Lease { door: "policies", uid: claim.uid, pid });
        }
        match door.state.judge(door.robot, now, raw) {
            Ok(chunk) => {
                door.sequence += 1;
                let header = process.header(door.sequence, rt::now(), chunk.header.origin);
                let chunk = PolicyChunk { header, session_nonce: door.session_nonce, ..chunk };
                process.publish(&mut door.chunks, &chunk);
            }
            Err(reason) => {
                if !feedback.dropped_lately(now) {
                    let (name, meaning) = (reason.name(), reason.meaning());
                    process.probe.event(Event::Dropped { frames: 1, reason: name, meaning });
                }
                feedback.drop_chunk(now, reason, door.state.counts()[1]);
            }
        }
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

    fn report(&mut self, process: &mut Process, socket: &mut Server) {
        let counters = process.probe.counters();
        counters.set(Counter::WithoutAuthority, self.authority.frames_refused());
        counters.set(Counter::OverQuota, self.quotas.over + socket.over_quota());
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
        let words = Reply::ALL.into_iter().map(|word| (word.name(), socket.reply_count(word)));
        let holder = self.authority.holder().map(|claim| {
            let ClientIdentity { door, uid, pid, .. } = claim;
            json!({ "door": door.name(), "uid": uid, "pid": pid })
        });
        json!({
            "accepted": self.state.skeleton.accepted(),
            "dropped": counted(reasons),
            "outliers": self.state.outliers(),
            "without_authority": self.authority.frames_refused(),
            "over_quota": { "shared memory": self.quotas.over, "socket": socket.over_quota() },
            "leases": self.authority.grants(),
            "holder": holder,
            "connections": counted(words),
            "chunks": { "accepted": self.policy.state.counts()[0], "dropped": self.policy.state.counts()[1] },
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
