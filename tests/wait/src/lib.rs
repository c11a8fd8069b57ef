//! Waits of a test: for a condition, or while one must hold. No other code of a process test sleeps without a reason.

use std::time::{Duration, Instant};

/// Longest time for any expected event. Only a hang comes near it.
pub const SOON: Duration = Duration::from_secs(25);

/// Time between two looks at a condition.
const LOOK: Duration = Duration::from_millis(2);

/// Returns true as soon as the condition is true, and false if `limit` passes first.
pub fn within(limit: Duration, condition: impl FnMut() -> bool) -> bool {
    within_by(limit, LOOK, condition)
}

/// The same with another time between two looks.
pub fn within_by(limit: Duration, look: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let give_up = Instant::now() + limit;
    loop {
        if condition() {
            return true;
        }
        if Instant::now() > give_up {
            return false;
        }
        // The only wait of all tests that use this function.
        std::thread::sleep(look);
    }
}

/// Returns true as soon as the condition is true, and false if it is not soon.
pub fn soon(condition: impl FnMut() -> bool) -> bool {
    within(SOON, condition)
}

/// Waits until the condition is true. Panics with `what` if it is not soon.
pub fn wait_until(what: &str, condition: impl FnMut() -> bool) {
    assert!(soon(condition), "never {what}");
}

/// Returns true if the condition holds at every look for this time.
pub fn holds_for(length: Duration, mut condition: impl FnMut() -> bool) -> bool {
    !within(length, || !condition())
}

/// A fixed rate, at which a test sends.
pub struct Pace {
    period: Duration,
    next: Instant,
}

impl Pace {
    /// Creates a rate with this period. It begins now.
    pub fn new(period: Duration) -> Self {
        Self { period, next: Instant::now() }
    }

    /// Waits for the next period. A late one is made up for.
    pub fn wait(&mut self) {
        self.next += self.period;
        // The rate is the test's input, so it waits for a time and not for a condition.
        std::thread::sleep(self.next.saturating_duration_since(Instant::now()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn condition_that_breaks_does_not_hold() {
        let begun = Instant::now();
        let short = Duration::from_millis(20);
        assert!(holds_for(short, || true) && begun.elapsed() >= short);
        assert!(!holds_for(SOON, || begun.elapsed() < 2 * short));
        assert!(within(SOON, || begun.elapsed() > 2 * short) && !within(short, || false));
    }
}
