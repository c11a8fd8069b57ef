//! The press that holds the enable: the squeeze of the left controller, or the pinch of the bare left hand.

use messages::Stamp;

/// Time for which the grasp must be closed before it counts, ns. A passing pinch lasts less. Assumption.
const BEGIN_AFTER_NS: u64 = 500_000_000;
/// Distance of the tips below which a pinch is closed, and above which it is open, m. Assumption: trackers err by 5 mm.
const PINCH_M: [f32; 2] = [0.02, 0.035];
/// Share of the squeeze above which it is closed, and below which it is open. Assumption.
const SQUEEZE: [f32; 2] = [0.7, 0.4];

/// State of a hand that may hold the enable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grasp {
    Closed,
    /// It is between both, so the state before goes on.
    Between,
    Open,
}

impl Grasp {
    /// Judges a pinch by the distance of the tips, m.
    pub fn of_pinch(m: f32) -> Self {
        Self::from_share(-m, PINCH_M.map(|m| -m))
    }

    pub fn of_squeeze(share: f32) -> Self {
        Self::from_share(share, SQUEEZE)
    }

    fn from_share(share: f32, [closed, open]: [f32; 2]) -> Self {
        if share >= closed {
            Self::Closed
        } else if share >= open {
            Self::Between
        } else {
            Self::Open
        }
    }
}

/// A press that begins late and ends at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldPress {
    state: State,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// The hand must be seen open before it can press.
    #[default]
    Unseen,
    Open,
    /// Closed since this time.
    Closing(Stamp),
    Held,
}

impl HeldPress {
    pub fn is_held(&self) -> bool {
        self.state == State::Held
    }

    /// Ends the press. The hand must be seen open before it can press again. Returns true if it was held.
    pub fn lose(&mut self) -> bool {
        std::mem::take(&mut self.state) == State::Held
    }

    /// Takes the hand's state at `now`. `None` stands for a hand that is not tracked, and ends the press at once.
    pub fn step(&mut self, now: Stamp, grasp: Option<Grasp>) -> bool {
        self.state = match (self.state, grasp) {
            (_, None) => State::Unseen,
            (_, Some(Grasp::Open)) => State::Open,
            (State::Open, Some(Grasp::Closed)) => State::Closing(now),
            (State::Closing(since), Some(_)) if now.since(since) >= BEGIN_AFTER_NS => State::Held,
            (state, Some(Grasp::Closed | Grasp::Between)) => state,
        };
        self.is_held()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Grasp::{Between, Closed, Open};

    /// Steps through grasps 100 ms apart. Returns whether each one was held.
    fn steps(grasps: &[Option<Grasp>]) -> Vec<bool> {
        let mut press = HeldPress::default();
        let at = |n: usize| Stamp(1_000_000_000 + 100_000_000 * n as u64);
        grasps.iter().enumerate().map(|(n, &grasp)| press.step(at(n), grasp)).collect()
    }

    #[test]
    fn f131_passing_or_early_press_holds_nothing() {
        let mut passing = vec![Some(Open)];
        passing.extend([Some(Closed); 5]);
        passing.push(Some(Open));
        passing.extend([Some(Closed); 5]);
        assert!(!steps(&passing).contains(&true), "0.4 s twice is not 0.5 s");
        assert!(!steps(&[Some(Closed); 20]).contains(&true), "it was never seen open");
        assert!(!steps(&[Some(Between); 20]).contains(&true));
    }

    #[test]
    fn press_begins_after_half_a_second_and_ends_at_once() {
        let mut grasps = vec![Some(Open), Some(Closed), Some(Closed), Some(Between)];
        grasps.extend([Some(Closed); 3]);
        grasps.extend([Some(Between), Some(Open), Some(Between)]);
        let held = steps(&grasps);
        assert_eq!(held, [false, false, false, false, false, false, true, true, false, false]);
    }

    #[test]
    fn f132_lost_hand_ends_the_press_until_it_was_open() {
        let mut grasps = vec![Some(Open)];
        grasps.extend([Some(Closed); 7]);
        grasps.push(None);
        grasps.extend([Some(Closed); 10]);
        let held = steps(&grasps);
        assert!(held[7] && !held[8..].contains(&true), "{held:?}");
        let mut press = HeldPress { state: State::Held };
        assert!(press.lose() && !press.is_held());
        assert!(!press.step(Stamp(1), Some(Closed)) && !press.step(Stamp(2_000_000_000), Some(Closed)));
    }

    #[test]
    fn press_has_hysteresis_for_pinch_and_squeeze() {
        assert_eq!([0.01, 0.03, 0.05].map(Grasp::of_pinch), [Closed, Between, Open]);
        assert_eq!([0.9, 0.5, 0.1].map(Grasp::of_squeeze), [Closed, Between, Open]);
    }
}
