//! Judges the chunks of a policy, before any stage uses them.

use messages::{CHUNK_ROWS_MAX, ChunkDrop, PolicyChunk, RobotId, Stamp, comes_after};

/// Periods of rows, ns: 1 to 200 rows a second. Published policies act 5 to 60 times a second.
const PERIOD_NS: core::ops::RangeInclusive<u64> = 5_000_000..=1_000_000_000;
/// Time from the observation to the last row, ns. 100 rows at 10 Hz are as long. Nobody foresees more (assumption).
const REACH_MAX_NS: u64 = 10_000_000_000;
/// Time by which a chunk may come before its start, ns. Assumption: no policy waits longer for its own time.
const AHEAD_MAX_NS: u64 = 1_000_000_000;
/// Clocks of two processes on one machine agree to this, ns. `safety` tolerates as much.
const FUTURE_NS: u64 = 2_000_000;
/// Positions and velocities beyond ten turns are no joint's. `control` refuses as much.
const VALUE_MAX: f32 = 20.0 * core::f32::consts::PI;

/// State of the session that holds the policy's lease.
#[derive(Clone, Copy, Debug, Default)]
pub struct PolicyState {
    session_nonce: u64,
    sequence: u64,
    stamp: Stamp,
}

impl PolicyState {
    /// Judges a chunk for `robot` that arrived at `now`. Returns it with its time of arrival, or the reason for which it is
    /// dropped. Never allocates, blocks or panics, whatever the bits.
    ///
    /// # Errors
    /// Returns the first reason that holds, in the order of `ChunkDrop`. Lease and quota are judged before.
    pub fn judge(&mut self, robot: RobotId, now: Stamp, chunk: &PolicyChunk) -> Result<PolicyChunk, ChunkDrop> {
        self.refusal(robot, now, chunk).map_or(Ok(()), Err)?;
        (self.session_nonce, self.sequence, self.stamp) =
            (chunk.session_nonce, chunk.header.sequence, chunk.header.stamp);
        Ok(PolicyChunk { received: now, ..*chunk })
    }

    fn refusal(&self, robot: RobotId, now: Stamp, chunk: &PolicyChunk) -> Option<ChunkDrop> {
        let header = &chunk.header;
        let rows = chunk.rows as usize;
        let joints = (1_u32 << robot.joint_count.min(31)) - 1;
        let masked = chunk.valid_mask & joints;
        let shape = (1..=CHUNK_ROWS_MAX).contains(&rows)
            && PERIOD_NS.contains(&chunk.period_ns)
            && masked != 0
            && masked == chunk.valid_mask;
        let valid = |row: &[f32]| {
            row.iter().enumerate().all(|(j, x)| masked & 1_u32.wrapping_shl(j as u32) == 0 || x.abs() <= VALUE_MAX)
        };
        let known = chunk.session_nonce == self.session_nonce;
        let grows = comes_after(header.sequence, self.sequence) && header.stamp > self.stamp;
        if chunk.robot != robot {
            return Some(ChunkDrop::Robot);
        }
        if !shape {
            return Some(ChunkDrop::Shape);
        }
        // NaN is not below the bound.
        let closures = chunk.closure[..rows].as_flattened().iter().all(|x| x.is_finite());
        if !closures || !chunk.q[..rows].iter().chain(&chunk.v[..rows]).all(|row| valid(row)) {
            return Some(ChunkDrop::Value);
        }
        if known && !grows {
            return Some(ChunkDrop::Order);
        }
        let last = chunk.start.plus_ns(chunk.period_ns * (rows as u64 - 1));
        if last.plus_ns(chunk.period_ns) < now || last.since(header.origin) > REACH_MAX_NS {
            return Some(ChunkDrop::Old);
        }
        let future = chunk.start.since(now) > AHEAD_MAX_NS || header.origin.since(now) > FUTURE_NS;
        future.then_some(ChunkDrop::Future)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    const ROBOT: RobotId = RobotId { hash: 7, joint_count: 17, reserved: 0 };
    const NOW: Stamp = Stamp(100_000_000_000);

    fn chunk() -> PolicyChunk {
        let mut chunk = PolicyChunk {
            session_nonce: 3,
            robot: ROBOT,
            start: NOW,
            period_ns: 50_000_000,
            rows: 8,
            valid_mask: 0b11,
            ..PolicyChunk::ZERO
        };
        (chunk.header.sequence, chunk.header.stamp, chunk.header.origin) = (5, NOW, NOW);
        chunk
    }

    #[test]
    fn f137_f139_f140_bad_chunk_is_dropped_with_its_reason_and_the_next_one_is_used() {
        type Change = fn(&mut PolicyChunk);
        let cases: [(ChunkDrop, Change); 18] = [
            (ChunkDrop::Robot, |c| c.robot.hash += 1),
            (ChunkDrop::Shape, |c| c.rows = 0),
            (ChunkDrop::Shape, |c| c.rows = 101),
            (ChunkDrop::Shape, |c| c.period_ns = 0),
            (ChunkDrop::Shape, |c| c.period_ns = 1_000_000_001),
            (ChunkDrop::Shape, |c| c.valid_mask = 0),
            (ChunkDrop::Shape, |c| c.valid_mask |= 1 << 17),
            (ChunkDrop::Value, |c| c.q[7][1] = f32::NAN),
            (ChunkDrop::Value, |c| c.q[0][0] = f32::INFINITY),
            (ChunkDrop::Value, |c| c.v[2][1] = -63.0),
            (ChunkDrop::Value, |c| c.closure[4][0] = f32::NAN),
            (ChunkDrop::Order, |c| c.header.sequence = 4),
            (ChunkDrop::Order, |c| c.header.stamp = Stamp(NOW.0 - 1)),
            (ChunkDrop::Old, |c| c.start = Stamp(NOW.0 - 8 * 50_000_000 - 1)),
            (ChunkDrop::Old, |c| c.header.origin = Stamp(NOW.0 - 9_651_000_000)),
            (ChunkDrop::Future, |c| c.start = Stamp(NOW.0 + 1_000_000_001)),
            (ChunkDrop::Future, |c| c.header.origin = Stamp(NOW.0 + 2_000_001)),
            (ChunkDrop::Old, |c| c.header.origin = Stamp::NONE),
        ];
        let mut state = PolicyState::default();
        let mut first = chunk();
        (first.header.sequence, first.header.stamp) = (4, Stamp(NOW.0 - 1));
        assert_eq!(state.judge(ROBOT, NOW, &first).map(|chunk| chunk.received), Ok(NOW));
        for (index, (reason, change)) in cases.into_iter().enumerate() {
            let mut bad = chunk();
            change(&mut bad);
            assert_eq!(state.judge(ROBOT, NOW, &bad), Err(reason), "case {index}");
        }
        assert!(state.judge(ROBOT, NOW, &chunk()).is_ok());
        // What no bit of the mask names may be anything.
        let mut other = PolicyChunk { session_nonce: 4, ..chunk() };
        (other.q[0][5], other.q[9][0], other.header.sequence) = (f32::NAN, f32::NAN, 1);
        assert!(state.judge(ROBOT, NOW, &other).is_ok(), "a new session counts from its own first chunk");
    }
}
