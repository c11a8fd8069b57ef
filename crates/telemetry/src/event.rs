//! Events for the log, and the limit on lines per second.

use messages::{Mode, Transition};
use std::time::{Duration, Instant};

/// An event in a loop. The collector's thread turns it into text.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the variants and the log lines describe the fields")]
pub enum Event {
    /// The mode changed.
    Transition(Transition),
    /// The process was stopped for longer than a command stays valid. The process was suspended, or its machine was.
    Gap {
        /// Index of the tick that was dropped.
        k: u64,
        ns: u64,
    },
    /// The bus did not take a message.
    PublishFailed,
    /// A client without the lease publishes.
    WithoutAuthority {
        /// Frames of such clients so far.
        frames: u64,
    },
    /// The lease passed to a client.
    Lease { door: &'static str, uid: u32, pid: u32 },
    /// A client connected to a socket, was refused, or sends too much.
    Visitor {
        /// The reply to the client.
        what: &'static str,
        /// True if it needs a warning.
        refused: bool,
        uid: u32,
        pid: u32,
    },
    /// Frames of the client that holds the lease were dropped.
    Dropped {
        /// Number within a second.
        frames: u64,
        reason: &'static str,
        meaning: &'static str,
    },
    /// A client acted at the operator's socket.
    Audit { what: &'static str, uid: u32, pid: u32 },
    /// An operator reported the payload of a hand.
    Payload {
        /// Payload of the left and the right hand now, kg.
        kg: [f64; 2],
        /// The reason of a refusal. `None` if the report was accepted.
        refused: Option<&'static str>,
    },
    /// The driver latched its fault for the first time.
    Latched { cause: &'static str },
}

/// Names of the kinds of event, for the line about suppressed lines.
pub(crate) const KIND_NAMES: [&str; 10] = [
    "mode changes",
    "gaps",
    "failures to publish",
    "clients without the lease",
    "leases",
    "connections",
    "operator requests",
    "dropped frames",
    "payloads",
    "latches",
];

impl Event {
    /// Number of kinds of event.
    pub const KINDS: usize = KIND_NAMES.len();

    /// Returns the number of its kind. Lines of one kind share one limit.
    pub fn kind(&self) -> usize {
        match self {
            Self::Transition(_) => 0,
            Self::Gap { .. } => 1,
            Self::PublishFailed => 2,
            Self::WithoutAuthority { .. } => 3,
            Self::Lease { .. } => 4,
            Self::Visitor { .. } => 5,
            Self::Audit { .. } => 6,
            Self::Dropped { .. } => 7,
            Self::Payload { .. } => 8,
            Self::Latched { .. } => 9,
        }
    }

    pub(crate) fn log(&self, process: &str) {
        match *self {
            Self::Transition(transition) => {
                let name = |mode: u32| Mode::from_u32(mode).map_or("?", Mode::name);
                let (from, to, why) = (name(transition.from), name(transition.to), transition.why_name());
                tracing::info!(k = transition.k, "{process}: {from} -> {to} ({why})");
            }
            Self::Gap { k, ns } => {
                let ms = ns as f64 * 1e-6;
                tracing::warn!(k, "{process}: did not run for {ms:.1} ms in tick {k}, which was dropped");
            }
            Self::PublishFailed => tracing::error!("{process}: the bus did not accept a message"),
            Self::WithoutAuthority { frames } => tracing::warn!(
                frames,
                "{process}: ignoring frames: another client holds the lease. Restart this one at least 1 s after the \
                 other disconnects"
            ),
            Self::Lease { door, uid, pid } => {
                tracing::info!(uid, pid, "{process}: the lease is held by process {pid} of user {uid}, by {door}");
            }
            Self::Visitor { what, refused: false, uid, pid } => {
                tracing::info!(uid, pid, "{process}: process {pid} of user {uid}: {what}");
            }
            Self::Visitor { what, refused: true, uid, pid } => {
                tracing::warn!(uid, pid, "{process}: process {pid} of user {uid}: {what}");
            }
            Self::Dropped { frames, reason, meaning } => {
                let s = if frames == 1 { "" } else { "s" };
                tracing::warn!("{process}: {frames} frame{s} dropped within a second: {reason} ({meaning})");
            }
            Self::Payload { kg: [left, right], refused: None } => {
                tracing::info!("{process}: the hands carry {left:.3} kg left, {right:.3} kg right");
            }
            Self::Payload { kg: [left, right], refused: Some(why) } => tracing::warn!(
                "{process}: payload refused: {why}; the payload is {left:.3} kg left, {right:.3} kg right"
            ),
            Self::Latched { cause } => tracing::warn!("{process}: the driver latched its fault: {cause}"),
            Self::Audit { what, uid, pid } => {
                tracing::info!(uid, pid, "{process}: operator, process {pid} of user {uid}: {what}");
            }
        }
    }
}

/// Deadlines that were missed since the last log line about them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Missed {
    /// Time of the first of them.
    since: Instant,
    count: u64,
    longest: u64,
}

impl Missed {
    /// Interval between two lines.
    const LINE_EVERY: Duration = Duration::from_secs(10);
    /// A run of this many ticks is logged at once. Five more, and the driver latches the silence.
    const LONG_RUN: u64 = 10;

    /// Adds a run of `count` to the missed deadlines so far.
    pub(crate) fn add(gathered: &mut Option<Self>, now: Instant, count: u64) {
        let all = gathered.get_or_insert(Self { since: now, count: 0, longest: 0 });
        all.count += count;
        all.longest = all.longest.max(count);
    }

    /// Returns true if it is time for a line at `now`.
    pub(crate) fn is_due(&self, now: Instant) -> bool {
        self.longest >= Self::LONG_RUN || now.duration_since(self.since) >= Self::LINE_EVERY
    }

    /// Returns the line at `now`.
    pub(crate) fn words(&self, now: Instant) -> String {
        let many = |n: u64| if n == 1 { "" } else { "s" };
        let Self { since, count, longest } = *self;
        let within_s = now.duration_since(since).as_secs_f64().ceil().max(1.0);
        let (deadlines, ticks) = (many(count), many(longest));
        format!("{count} deadline{deadlines} missed within {within_s} s, the longest run {longest} tick{ticks}")
    }
}

/// A rate limit: a number of lines per kind and second. Further lines are counted.
#[derive(Clone, Debug)]
pub struct RateLimit {
    lines_per_s: u32,
    since: Instant,
    written: [u32; Event::KINDS],
    held_back: [u64; Event::KINDS],
}

/// Lines of one kind per second: enough to read, few enough for a disk (10 lines of 200 bytes are 2 KB/s).
const LINES_PER_S: u32 = 10;

impl RateLimit {
    /// Begins to count at `now`.
    pub fn starting_at(now: Instant) -> Self {
        Self { lines_per_s: LINES_PER_S, since: now, written: [0; Event::KINDS], held_back: [0; Event::KINDS] }
    }

    /// Returns true if a line of `kind` may be written.
    pub fn admits(&mut self, kind: usize) -> bool {
        let admitted = self.written[kind] < self.lines_per_s;
        if admitted {
            self.written[kind] += 1;
        } else {
            self.held_back[kind] += 1;
        }
        admitted
    }

    /// Begins the next second if one is over. Then returns how many lines of each kind were suppressed in it, and
    /// otherwise `None`.
    pub fn turn(&mut self, now: Instant) -> Option<[u64; Event::KINDS]> {
        if now.duration_since(self.since) < Duration::from_secs(1) {
            return None;
        }
        self.since = now;
        self.written = [0; Event::KINDS];
        Some(std::mem::take(&mut self.held_back))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missed_deadlines_are_logged_every_10_s_and_long_runs_at_once() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut missed = None;
        for second in 0..10 {
            Missed::add(&mut missed, at(second * 1000), 1 + 2 * (second % 2));
            assert!(!missed.expect("some").is_due(at(second * 1000 + 999)), "second {second}");
        }
        let all = missed.take().expect("some");
        assert!(all.is_due(at(10_000)));
        assert_eq!(all.words(at(10_000)), "20 deadlines missed within 10 s, the longest run 3 ticks");
        Missed::add(&mut missed, at(20_000), 1);
        assert_eq!(missed.expect("one").words(at(20_020)), "1 deadline missed within 1 s, the longest run 1 tick");
        Missed::add(&mut missed, at(20_500), 41);
        assert!(missed.expect("two").is_due(at(20_500)));
    }

    #[test]
    fn f105_log_rate_limit_per_kind_drops_and_counts_a_flood() {
        let start = Instant::now();
        let mut limit = RateLimit::starting_at(start);
        let written = (0..1_000_000).filter(|_| limit.admits(2)).count();
        assert_eq!(written, LINES_PER_S as usize);
        assert!(limit.admits(0));
        assert_eq!(limit.turn(start + Duration::from_millis(999)), None);
        let held_back = limit.turn(start + Duration::from_secs(1)).expect("a second is over");
        assert_eq!(held_back, [0, 0, 1_000_000 - u64::from(LINES_PER_S), 0, 0, 0, 0, 0, 0, 0]);
        assert!(limit.admits(2), "a new second");
        assert_eq!(limit.turn(start + Duration::from_secs(2)), Some([0; Event::KINDS]));
    }
}
