//! Lines for people: how the link does. A line that says the same is not repeated.

use link::{Answer, LinkState, Refusal, Refused};
use messages::Stamp;
use rt::out;

/// Time between two lines, ns, and the shortest one if the state changes.
const EVERY_NS: u64 = 60_000_000_000;
const CHANGE_EVERY_NS: u64 = 1_000_000_000;

/// The last line of one subject.
#[derive(Default)]
pub(super) struct Report {
    at: Stamp,
    text: String,
}

impl Report {
    /// Prints the line if it differs from the last one, at most every minute, or every second if `state` changes.
    pub(super) fn print(&mut self, now: Stamp, state: &str, details: impl FnOnce() -> String) {
        let changed = !self.text.starts_with(state);
        let every_ns = if changed { CHANGE_EVERY_NS } else { EVERY_NS };
        if self.at == Stamp::NONE || now.since(self.at) >= every_ns {
            let text = format!("{state}{}", details());
            if text != self.text {
                out!("bridge: {text}");
            }
            (self.at, self.text) = (now, text);
        }
    }
}

pub(super) fn state_name(answer: &Answer) -> String {
    let led = if answer.led_by_other { ", but another client's person leads the robot" } else { "" };
    format!("{}{led}", answer.verdict.name())
}

pub(super) fn operator_details(answer: &Answer, round_trip_ns: Option<u64>, refused: &Refused) -> String {
    let certain = (answer.uncertainty_ns < u64::MAX).then_some(answer.uncertainty_ns);
    let lost = lost(answer.received, answer.lost);
    format!("{}{}; up {lost}{}", time("round trip", round_trip_ns), time("uncertainty", certain), reasons(refused))
}

pub(super) fn robot_details(link: &LinkState) -> String {
    let answer = link.answer.as_ref();
    let certain = answer.map(|answer| answer.uncertainty_ns).filter(|ns| *ns < u64::MAX);
    let up = answer.map_or(String::new(), |answer| format!("; up {}", lost(answer.received, answer.lost)));
    let down = lost(link.received, link.lost);
    let (trip, sure) = (time("round trip", link.round_trip_ns), time("uncertainty", certain));
    format!("{trip}{sure}{up}; down {down}{}", reasons(&link.refused))
}

/// A time to a tenth of a millisecond, as a part of a line.
fn time(what: &str, ns: Option<u64>) -> String {
    ns.map_or(String::new(), |ns| format!("; {what} {:.1} ms", ns as f64 * 1e-6))
}

fn lost(received: u64, lost: u64) -> String {
    if received + lost == 0 {
        return "nothing yet".into();
    }
    let share = 100.0 * lost as f64 / (received + lost).max(1) as f64;
    format!("{share:.1} % lost")
}

fn reasons(refused: &Refused) -> String {
    let counted = Refusal::ALL.into_iter().filter(|refusal| refused.count_of(*refusal) > 0);
    counted.map(|refusal| format!("; refused {} {}", refused.count_of(refusal), refusal.name())).collect()
}
