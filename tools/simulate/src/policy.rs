//! A policy that leads the robot, with all that can go wrong with its chunks, and the person who takes over from it. Without
//! faults both arms swing about home.

use crate::active::{Active, Faults};
use crate::kinds::{Fault, Policy as Of, ProcessId};
use crate::processes::Started;
use crate::subject::Subject;
use messages::{Header, JOINTS_MAX, Layout, PolicyChunk, Stamp, TICK_HZ};
use rand::{Rng, RngExt};
use robot::Model;
use std::array::from_fn;
use world::{Moment, World};

/// Ticks between two chunks: ten a second.
const EVERY: u64 = TICK_HZ / 10;
/// Rows of a chunk, and the time between them: 20 Hz, as many published policies.
const ROWS: usize = 16;
const PERIOD_NS: u64 = 50_000_000;
/// After this long (ticks) without an accepted chunk, the policy begins a new session: 1.5 s.
const PATIENCE: u64 = TICK_HZ * 3 / 2;
/// Ticks between two starts of a policy that ends again and again.
const RESTARTS: u64 = TICK_HZ / 2;
/// Session of the second policy.
const STRANGER: u64 = 0x5712_a26e;
/// Amplitude and angular frequency of the swing, rad and rad/s.
const SWING: [f64; 2] = [0.1, 2.0];

#[derive(Clone, Default)]
pub struct Policy {
    session: u64,
    sequence: u64,
    last: Option<Box<PolicyChunk>>,
    /// Tick of the last accepted chunk, and that of this session's beginning.
    heard: u64,
    since: u64,
    /// The posture to which a fault leads.
    goal: [f64; JOINTS_MAX],
    /// Time from which on no accepted chunk has a row.
    covered_until: Stamp,
    /// Arms that the person leads.
    pub takes_over: [bool; 2],
    /// Session of the policy whose targets control receives, or 0, and the tick of its last change.
    leads: u64,
    changed_k: u64,
}

/// The policy as the oracle sees it in one tick.
#[derive(Clone, Copy, Default)]
pub struct PolicySeen {
    /// Session whose targets control receives. 0 without a policy.
    pub leads: u64,
    /// True if an accepted chunk has a row for now.
    pub has_row: bool,
}

impl Policy {
    pub fn rebase(&mut self) {
        (self.heard, self.since, self.changed_k) = (0, 0, 0);
    }

    /// Publishes what is due in tick `k`. A chunk that comes while `ingest` does not run is lost.
    pub fn tick(&mut self, subject: &Subject, k: u64, world: &mut World, ingest_runs: bool, faults: &mut Faults) {
        self.takes_over = [false; 2];
        faults.each(as_policy, |active, of| of == Of::Takeover && self.take_over(active));
        if !k.is_multiple_of(EVERY) {
            return;
        }
        if k > self.heard.max(self.since) + PATIENCE || self.session == 0 {
            self.restart(k);
        }
        let (now, here) = (world.now(), *world.robot_mut().q());
        let mut chunk = self.swing(subject.model(), now);
        let mut is_silent = !ingest_runs;
        faults.each(as_policy, |active, of| match of {
            Of::Takeover => false,
            Of::Silent => {
                is_silent = true;
                true
            }
            Of::Ends if active.age >= active.note => {
                active.note = active.age + RESTARTS;
                self.restart(k);
                *chunk = *self.swing(subject.model(), now);
                true
            }
            Of::Stranger if ingest_runs => {
                let header = Header { sequence: k + 1, ..chunk.header };
                self.publish(subject, world, &PolicyChunk { session_nonce: STRANGER, header, ..*chunk });
                true
            }
            _ => self.alter(of, active, &mut chunk, (subject.model(), &here)),
        });
        if !is_silent && self.publish(subject, world, &chunk) {
            self.heard = k;
        }
        self.last = Some(chunk);
    }

    /// Reads what control received in tick `k`.
    pub fn read(&mut self, k: u64, moment: &Moment, started: Started, now: Stamp) -> PolicySeen {
        let before = self.leads;
        self.leads = if started[ProcessId::Control as usize] { 0 } else { self.leads };
        self.leads = moment.policy_seen.as_ref().map_or(self.leads, |target| target.session_nonce);
        self.changed_k = if self.leads == before { self.changed_k } else { k };
        PolicySeen { leads: self.leads, has_row: now <= self.covered_until }
    }

    /// True while no chunk is accepted, and until its coming or going has had its effect.
    pub fn is_away(&self, k: u64) -> bool {
        k > self.heard + TICK_HZ / 2 || k < self.changed_k + TICK_HZ / 2
    }

    fn restart(&mut self, k: u64) {
        self.session += 1;
        (self.sequence, self.since, self.last) = (0, k, None);
    }

    fn take_over(&mut self, active: &mut Active) -> bool {
        let changes = active.age == 0 || active.rng.random_range(0..400) == 0;
        if changes {
            active.note = active.rng.random_range(0..4);
        }
        self.takes_over = [active.note & 1 != 0, active.note & 2 != 0];
        changes
    }

    /// Returns true if the chunk was accepted.
    fn publish(&mut self, subject: &Subject, world: &mut World, chunk: &PolicyChunk) -> bool {
        let accepted = world.publish_chunk(&subject.config, chunk).is_ok();
        if accepted {
            let end = chunk.start.plus_ns(chunk.period_ns * u64::from(chunk.rows));
            self.covered_until = if chunk.start <= world.now() { end } else { end.max(self.covered_until) };
        }
        accepted
    }

    fn swing(&mut self, model: &Model, now: Stamp) -> Box<PolicyChunk> {
        self.sequence += 1;
        let mut chunk = Box::new(PolicyChunk {
            header: Header { sequence: self.sequence, stamp: now, origin: now, ..Header::ZERO },
            session_nonce: self.session,
            robot: model.id(),
            start: now,
            period_ns: PERIOD_NS,
            rows: ROWS as u32,
            valid_mask: (1 << model.count) - 1,
            ..PolicyChunk::ZERO
        });
        lead(&mut chunk, |row| posture(model, now.plus_ns(row as u64 * PERIOD_NS)));
        chunk
    }

    fn alter(
        &mut self,
        of: Of,
        active: &mut Active,
        chunk: &mut PolicyChunk,
        (model, here): (&Model, &[f64; JOINTS_MAX]),
    ) -> bool {
        let leads = matches!(of, Of::Jump | Of::Walk | Of::Contradict | Of::Posture);
        if leads && (active.age < EVERY || of != Of::Walk && active.rng.random_range(0..8) == 0) {
            self.goal = from_fn(|j| match &model.limits[j] {
                limits if j < model.count && of != Of::Walk => active.rng.random_range(limits.q_min..=limits.q_max),
                _ => here[j],
            });
        }
        if !leads && !active.acts() {
            return false;
        }
        let (row, joint) = (active.rng.random_range(0..ROWS), active.rng.random_range(0..model.count));
        let by_ns = active.rng.random_range(-3_000_000_000..1_500_000_000_i64);
        let (is_first, goal) = (active.rng.random::<bool>(), self.goal);
        match of {
            Of::Nan if is_first => chunk.q[row][joint] = f32::NAN,
            Of::Nan if by_ns > 0 => chunk.v[row][joint] = f32::INFINITY,
            Of::Nan => chunk.closure[row][0] = f32::NAN,
            Of::Shape if is_first => chunk.rows = active.rng.random_range(0..300),
            Of::Shape if by_ns > 0 => chunk.period_ns = (by_ns * by_ns) as u64,
            Of::Shape => chunk.valid_mask = active.rng.next_u32(),
            Of::OtherRobot => chunk.robot.hash ^= 1,
            Of::Late if is_first => chunk.start.0 = chunk.start.0.saturating_add_signed(by_ns),
            Of::Late => chunk.header.origin.0 = chunk.header.origin.0.saturating_add_signed(4 * by_ns),
            Of::Frozen => *chunk = self.last.as_ref().map_or(*chunk, |last| **last),
            Of::Jump => lead(chunk, |_| goal),
            Of::Walk => {
                self.goal = goal.map(|q| q + active.rng.random_range(-0.1..0.1));
                let to = self.goal;
                lead(chunk, |row| from_fn(|j| goal[j] + (to[j] - goal[j]) * row as f64 / ROWS as f64));
            }
            Of::Contradict => lead(chunk, |_| if is_first { goal } else { *here }),
            // Slowly, also into its own body: it would be there in three seconds.
            Of::Posture => lead(chunk, |row| from_fn(|j| here[j] + (goal[j] - here[j]) * row as f64 / 60.0)),
            Of::Silent | Of::Ends | Of::Stranger | Of::Takeover => return false,
        }
        true
    }
}

fn as_policy(fault: Fault) -> Option<Of> {
    if let Fault::Policy(of) = fault { Some(of) } else { None }
}

fn lead(chunk: &mut PolicyChunk, at: impl Fn(usize) -> [f64; JOINTS_MAX]) {
    for row in 0..ROWS {
        chunk.q[row] = at(row).map(|q| q as f32);
    }
}

/// Every joint of both arms swings about home, inside its range.
fn posture(model: &Model, at: Stamp) -> [f64; JOINTS_MAX] {
    let mut q = model.home;
    for (i, j) in model.arms.iter().flat_map(|arm| arm.range()).enumerate() {
        let by = SWING[0] * (SWING[1] * at.0 as f64 * 1e-9 + i as f64).sin();
        q[j] = (q[j] + by).clamp(model.limits[j].q_min, model.limits[j].q_max);
    }
    q
}
