//! A policy's chunks as joint targets on the tick grid. With rows q_i at times t_i = start + i * period, the target between
//! two rows is the cubic Hermite curve through them. Its velocities at the rows are the chunk's own, or else those of a
//! Catmull-Rom spline, (q_{i+1} - q_{i-1}) / (2 * period) (Catmull and Rom, 1974). After the last row it stays there at rest.
//! A chunk replaces the one before it from its own start on. If the one before has ended by then, a straight line bridges
//! the gap. So a stream of single rows is a polyline. Steps between chunks are left to the limits of `control`.
//! A gripper has the closure of the newest row that is due.

use messages::{
    CHUNK_ROWS_MAX, Header, JOINTS_MAX, JointTarget, Layout, PolicyChunk, RobotId, Stamp, chunk_flag, target_flag,
};
use robot::Model;

/// Longest gap between two chunks that is bridged, in periods of the later one. Beyond it the target rests.
const BRIDGED_PERIODS: f64 = 2.0;

/// Configuration of the stage.
#[derive(Clone, Debug)]
pub struct Config {
    robot: RobotId,
    home: [f64; JOINTS_MAX],
    velocity_max: [f64; JOINTS_MAX],
    silent_ns: u64,
}

impl Config {
    /// Creates the configuration for a robot. A policy without a chunk for `silent_ns`, and without a row left, is gone.
    pub fn new(model: &Model, silent_ns: u64) -> Self {
        let velocity_max = std::array::from_fn(|j| if j < model.count { model.limits[j].v_max } else { 0.0 });
        Self { robot: model.id(), home: model.home, velocity_max, silent_ns }
    }
}

/// Chunks that wait for their start. A policy that plans a second ahead, four times a second, needs as many (assumption).
const WAITING_MAX: usize = 4;

/// State of the stage. Fixed size, no heap.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// The chunk that plays. Its session is zero before the first.
    playing: PolicyChunk,
    /// Chunks that replace it, each at its start, in this order. Those beyond `count` mean nothing.
    waiting: [PolicyChunk; WAITING_MAX],
    count: usize,
}

impl State {
    /// Adds a chunk. It takes the place of those that would begin after it. If all places are taken, the last one goes.
    fn receive(&mut self, chunk: &PolicyChunk) {
        let known = if self.count > 0 { self.waiting[0].session_nonce } else { self.playing.session_nonce };
        if known != 0 && known != chunk.session_nonce {
            (self.playing, self.count) = (PolicyChunk::ZERO, 0);
        }
        while self.count > 0 && self.waiting[self.count - 1].start >= chunk.start {
            self.count -= 1;
        }
        self.count = (self.count + 1).min(WAITING_MAX);
        self.waiting[self.count - 1] = *chunk;
    }

    /// Lets every chunk play whose start has come.
    fn promote(&mut self, now: Stamp) {
        while self.count > 0 && self.waiting[0].start <= now {
            self.playing = self.waiting[0];
            self.waiting.copy_within(1.., 0);
            self.count -= 1;
        }
    }
}

/// Advances the stage by one period. Without a policy the session of the target is zero. Never allocates, blocks, reads a
/// clock or panics. The header contains only `origin`: the process fills in the rest.
pub fn tick(config: &Config, state: &mut State, now: Stamp, k: u64, chunk: Option<&PolicyChunk>) -> JointTarget {
    state.promote(now);
    if let Some(chunk) = chunk.filter(|chunk| (1..=CHUNK_ROWS_MAX as u32).contains(&chunk.rows) && chunk.period_ns > 0)
    {
        state.receive(chunk);
        state.promote(now);
    }
    let State { playing, waiting, count } = state;
    let next = waiting[..*count].first();
    let newest = waiting[..*count].last().unwrap_or(playing);
    let gone = now.since(newest.received) > config.silent_ns && now > end(newest);
    let mut target = JointTarget { k, q: config.home, robot: config.robot, ..JointTarget::ZERO };
    if newest.session_nonce == 0 || gone {
        (playing.session_nonce, *count) = (0, 0);
        return target;
    }
    target.session_nonce = newest.session_nonce;
    target.input_sequence = newest.header.sequence;
    target.header.origin = newest.header.origin;
    if playing.session_nonce == 0 {
        return target; // The first row is not due yet.
    }
    target.header = Header { origin: playing.header.origin, ..target.header };
    target.flags = target_flag::INPUT_FRESH;
    target.valid_mask = playing.valid_mask;
    let bridged = next.and_then(|next| Some((next, gap_s(playing, next)?)));
    // The age of the input counts from the last time for which the policy has a row.
    target.input_received = if bridged.is_some() { now } else { now.min(end(playing)) };
    for j in (0..config.robot.joint_count as usize).filter(|j| playing.valid_mask & 1 << j != 0) {
        let bridged = bridged.filter(|(next, _)| next.valid_mask & 1 << j != 0 && last_row(playing) <= now);
        let (q, v) = match bridged {
            Some((next, gap_s)) => line(playing, next, (now, gap_s), j),
            None => curve(playing, now, j),
        };
        target.q[j] = q;
        target.dq[j] = v.max(-config.velocity_max[j]).min(config.velocity_max[j]);
    }
    let row = (now.since(playing.start) / playing.period_ns).min(u64::from(playing.rows) - 1) as usize;
    target.closure = playing.closure[row];
    for hand in [0, 1].into_iter().filter(|&hand| playing.flags & chunk_flag::CLOSURE[hand] != 0) {
        target.flags |= target_flag::CLOSURE[hand];
    }
    target
}

/// Time of the last row.
fn last_row(chunk: &PolicyChunk) -> Stamp {
    chunk.start.plus_ns(chunk.period_ns.saturating_mul(u64::from(chunk.rows.saturating_sub(1))))
}

/// Time from which a chunk has nothing more to say: a period after its last row.
fn end(chunk: &PolicyChunk) -> Stamp {
    last_row(chunk).plus_ns(chunk.period_ns)
}

/// Time from the last row of a chunk to the first row of the next, s. `None` if they overlap or are too far apart.
fn gap_s(playing: &PolicyChunk, next: &PolicyChunk) -> Option<f64> {
    let gap_s = seconds(next.start.since(last_row(playing)));
    (gap_s > 0.0 && gap_s <= BRIDGED_PERIODS * seconds(next.period_ns)).then_some(gap_s)
}

/// Position and velocity of joint `j` on the line from the last row of a chunk to the first row of the next.
fn line(playing: &PolicyChunk, next: &PolicyChunk, (now, gap_s): (Stamp, f64), j: usize) -> (f64, f64) {
    let first = f64::from(playing.q[playing.rows as usize - 1][j]);
    let slope = (f64::from(next.q[0][j]) - first) / gap_s;
    (first + slope * seconds(now.since(last_row(playing))), slope)
}

/// Position and velocity of joint `j` on the curve of a chunk.
fn curve(chunk: &PolicyChunk, now: Stamp, j: usize) -> (f64, f64) {
    let (last, h) = (chunk.rows as usize - 1, seconds(chunk.period_ns));
    let x = seconds(now.since(chunk.start)) / h;
    let i = (x as usize).min(last);
    if i == last {
        return (f64::from(chunk.q[last][j]), 0.0);
    }
    let q = |i: usize| f64::from(chunk.q[i.min(last)][j]);
    let velocity = |i: usize| match chunk.flags & chunk_flag::VELOCITIES {
        0 => (q(i + 1) - q(i.saturating_sub(1))) / (((i + 1).min(last) - i.saturating_sub(1)) as f64 * h),
        _ => f64::from(chunk.v[i][j]),
    };
    let (a, b, va, vb, t) = (q(i), q(i + 1), velocity(i) * h, velocity(i + 1) * h, x - i as f64);
    let (c2, c3) = (3.0 * (b - a) - 2.0 * va - vb, 2.0 * (a - b) + va + vb);
    (a + t * (va + t * (c2 + t * c3)), (va + t * (2.0 * c2 + t * 3.0 * c3)) / h)
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}
