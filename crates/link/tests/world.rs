//! A world with both ends, the wire between them, and the daemon.

use link::{Down, FRAME_BYTES_MAX, OperatorEnd, Payload, Received, Refusal, RobotEnd, Sent, Verdict};
use messages::{HOLDS_ENABLE, Header, Layout, OPERATOR_VERSION, OperatorRequest, RawSkeleton, Stamp, Status};

pub const MS: u64 = 1_000_000;
/// Step of the time of this world: a heartbeat.
pub const STEP: u64 = 20 * MS;

/// A datagram on its way. The time is that of the world.
#[derive(Clone)]
pub struct Flying {
    pub arrives: u64,
    pub bytes: Vec<u8>,
    pub up: bool,
}

/// The daemon: everything that reached it, with the true ages.
#[derive(Default)]
pub struct Daemon {
    pub connections: usize,
    pub requests: Vec<OperatorRequest>,
    pub persons: Vec<u64>,
    pub stops: usize,
}

pub struct World {
    pub now: u64,
    /// The operator's clock minus that of the world, which is the robot's.
    pub ahead: i64,
    pub delays: [u64; 2],
    pub broken: [bool; 2],
    pub request: OperatorRequest,
    pub operator: OperatorEnd,
    pub robot: RobotEnd,
    pub flying: Vec<Flying>,
    pub daemon: Daemon,
    pub refusals: Vec<Refusal>,
    pub nonces: u64,
    pub captured: Vec<Vec<u8>>,
    /// Time of the world at which the person of this number was seen.
    pub seen: Vec<u64>,
}

impl World {
    pub fn new(delays: [u64; 2]) -> Self {
        Self {
            now: 1_000_000 * MS,
            ahead: -700_000 * MS as i64,
            delays,
            broken: [false; 2],
            request: OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO },
            operator: OperatorEnd::new(77),
            robot: RobotEnd::default(),
            flying: Vec::new(),
            daemon: Daemon::default(),
            refusals: Vec::new(),
            nonces: 0,
            captured: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// A world whose link has run for a second.
    pub fn linked(delay: u64) -> Self {
        let mut world = Self::new([delay; 2]);
        world.run(50);
        world
    }

    pub fn theirs(&self) -> Stamp {
        Stamp(self.now.saturating_add_signed(self.ahead))
    }

    pub fn fly(&mut self, bytes: &[u8], up: bool) {
        let way = usize::from(!up);
        if up {
            self.captured.push(bytes.to_vec());
        }
        if !self.broken[way] {
            self.flying.push(Flying { arrives: self.now + self.delays[way], bytes: bytes.to_vec(), up });
        }
    }

    pub fn step(&mut self) {
        let mut out = [0; FRAME_BYTES_MAX];
        self.request.sequence += 1;
        let length = self.operator.heartbeat(&self.request, self.theirs(), &mut out);
        self.fly(&out[..length], true);
        let header = Header { sequence: self.seen.len() as u64, origin: self.theirs(), ..Header::ZERO };
        self.seen.push(self.now);
        let person = RawSkeleton { header, joint_count: 2, ..RawSkeleton::ZERO };
        if let Ok(length) = self.operator.person(&person, self.theirs(), &mut out) {
            self.fly(&out[..length], true);
        }
        let ended = self.robot.tick(Stamp(self.now));
        self.daemon.connections -= usize::from(ended[0]);
        if let Some(length) = self.robot.answer(0, Stamp(self.now), &mut out) {
            self.fly(&out[..length], false);
        }
        if let Some(length) = self.robot.send(0, Payload::Status(Status::ZERO), Stamp(self.now), &mut out) {
            self.fly(&out[..length], false);
        }
        self.advance(self.now + STEP);
    }

    pub fn advance(&mut self, until: u64) {
        while let Some(next) = (0..self.flying.len()).min_by_key(|&n| self.flying[n].arrives) {
            if self.flying[next].arrives > until {
                break;
            }
            let Flying { arrives, bytes, up } = self.flying.remove(next);
            self.now = self.now.max(arrives);
            if up {
                self.arrive(&bytes);
            } else if let Ok(Down::Answer(_)) = self.operator.receive(&bytes, self.theirs()) {
            }
        }
        self.now = until;
    }

    pub fn arrive(&mut self, bytes: &[u8]) -> Received {
        self.nonces += 1;
        let nonce = self.nonces;
        let taken = self.robot.receive(0, bytes, Stamp(self.now), || nonce);
        let carried = matches!(taken.outcome, Ok(Sent::Request(_)));
        self.daemon.stops += usize::from(taken.stop && !carried);
        match taken.outcome {
            Err(refusal) => self.refusals.push(refusal),
            Ok(Sent::Began) => {
                self.daemon.connections = 1;
                self.daemon.requests.clear();
            }
            Ok(Sent::Request(request)) => self.daemon.requests.push(request),
            Ok(Sent::Person(person)) => {
                let truth = self.seen[person.header.sequence as usize];
                assert!(person.header.origin <= Stamp(truth), "the age is under-estimated");
                self.daemon.persons.push(self.now - truth);
            }
        }
        taken
    }

    pub fn run(&mut self, steps: usize) {
        (0..steps).for_each(|_| self.step());
    }

    pub fn press(&mut self) {
        self.request.enable_count += 1;
        self.request.enable_level = HOLDS_ENABLE;
    }

    pub fn let_go(&mut self) {
        self.request.release_count += 1;
        self.request.enable_level = 0;
    }

    /// Lets go, and presses again after a step.
    pub fn press_again(&mut self) {
        self.let_go();
        self.run(1);
        self.press();
        self.run(10);
    }

    /// Cuts both ways for this number of steps.
    pub fn cut(&mut self, steps: usize) {
        self.broken = [true; 2];
        self.run(steps);
        self.broken = [false; 2];
    }

    /// The last request that reached the daemon on the present connection: enable edges and level.
    pub fn holds(&self) -> (u32, u32) {
        let last = self.daemon.requests.last().expect("a request");
        (last.enable_count, last.enable_level)
    }

    pub fn verdict(&self) -> Verdict {
        self.robot.state(0, Stamp(self.now)).expect("an operator").verdict
    }
}
