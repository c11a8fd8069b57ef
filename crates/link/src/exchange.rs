//! One end of the exchange: numbers and times of the frames sent, the echo to send, the other clock, and the loss.

use crate::codec::{Echo, Head, Kind};
use crate::{Clock, Refusal, Sample};
use messages::{Stamp, comes_after};

/// Frames sent whose time is kept, to check an echo. At 100 frames a second they are 2.5 s.
const KEPT: usize = 256;

/// Frames that did not arrive, by the gaps between their numbers. A late one counts as lost until it arrives.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Loss {
    first: u64,
    newest: u64,
    pub(crate) received: u64,
}

impl Loss {
    fn count(&mut self, sequence: u64) {
        if self.received == 0 {
            self.first = sequence;
        }
        self.newest = self.newest.max(sequence);
        self.first = self.first.min(sequence);
        self.received = self.received.saturating_add(1);
    }

    /// Returns the number of frames that did not arrive.
    pub(crate) fn lost(&self) -> u64 {
        let span = if self.received == 0 { 0 } else { self.newest.saturating_sub(self.first).saturating_add(1) };
        span.saturating_sub(self.received)
    }
}

/// State of one end towards the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Exchange {
    pub(crate) clock: Clock,
    pub(crate) loss: Loss,
    sequence: u64,
    sent: [(u64, Stamp); KEPT],
    echo: Echo,
    /// The newest number of each kind.
    last: [u64; Kind::ALL.len()],
}

impl Default for Exchange {
    fn default() -> Self {
        Self {
            clock: Clock::default(),
            loss: Loss::default(),
            sequence: 0,
            sent: [(0, Stamp::NONE); KEPT],
            echo: Echo::default(),
            last: [0; Kind::ALL.len()],
        }
    }
}

impl Exchange {
    /// Returns the head of the next frame.
    pub(crate) fn head(&mut self, kind: Kind, session: u64, client: u64, now: Stamp) -> Head {
        self.sequence = self.sequence.wrapping_add(1).max(1);
        if let Some(place) = self.sent.get_mut((self.sequence % KEPT as u64) as usize) {
            *place = (self.sequence, now);
        }
        Head { kind, session, client, stops_heard: 0, sequence: self.sequence, sent: now, echo: self.echo }
    }

    /// Handles the other end's new count: its numbers begin again, and its loss with them.
    pub(crate) fn restart(&mut self) {
        (self.last, self.loss, self.echo) = ([0; Kind::ALL.len()], Loss::default(), Echo::default());
    }

    /// Returns the number of frames sent.
    pub(crate) fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Returns true if the echo names a frame that was sent, or none.
    pub(crate) fn sent(&self, echo: &Echo) -> bool {
        let kept = self.sent.get((echo.sequence % KEPT as u64) as usize);
        *echo == Echo::default() || kept == Some(&(echo.sequence, echo.sent))
    }

    /// Returns true if a frame of this kind that is not older was taken before.
    pub(crate) fn is_repeated(&self, head: &Head) -> bool {
        let last = self.last.get(head.kind as usize - 1);
        last.is_some_and(|last| *last != 0 && !comes_after(head.sequence, *last))
    }

    /// Takes the head of a frame that arrived in the present session.
    ///
    /// # Errors
    /// Returns the reason for refusing it.
    pub(crate) fn receive(&mut self, head: &Head, now: Stamp) -> Result<(), Refusal> {
        if self.is_repeated(head) {
            return Err(Refusal::Order);
        }
        let Some(last) = self.last.get_mut(head.kind as usize - 1) else { return Err(Refusal::Kind) };
        *last = head.sequence;
        self.loss.count(head.sequence);
        if self.echo.sequence == 0 || comes_after(head.sequence, self.echo.sequence) {
            self.echo = Echo { sequence: head.sequence, sent: head.sent, received: now };
        }
        if head.echo == Echo::default() {
            return Ok(());
        }
        if !self.sent(&head.echo) {
            return Err(Refusal::Echo);
        }
        let jumps = self.clock.jumps();
        if self.clock.earliest(head.sent, now).is_some_and(|earliest| earliest > now) {
            // Sent after it arrived.
            self.clock.forget();
            return Err(Refusal::Jump);
        }
        self.clock.add(Sample { t1: head.echo.sent, t2: head.echo.received, t3: head.sent, t4: now });
        if self.clock.jumps() == jumps { Ok(()) } else { Err(Refusal::Jump) }
    }
}
