//! Summarises a recording: length, topics, modes, and problems.

use crate::error::RecordError;
use crate::pauses::Pause;
use crate::read::{Content, Recorded};
use crate::topic::Topic;
use crate::trace::Trace;
use explain::{mode_name, sentences};
use messages::Status;
use robot::Names;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Number of log sentences in the summary. The file has all of them under `/log`.
const SENTENCES_MAX: usize = 200;

#[derive(Debug, Default)]
pub struct Summary {
    pub trace: Trace,
    pub counts: BTreeMap<String, u64>,
    pub span_ns: Option<(u64, u64)>,
    pub modes_s: BTreeMap<u32, f64>,
    pub sentences: Vec<(f64, String)>,
    unsaid: usize,
    /// Number, sum and longest one of the pauses of each subject, with its begin, s.
    pauses: BTreeMap<&'static str, (u64, u64, f64, Pause)>,
    about: BTreeMap<String, String>,
    outcome: BTreeMap<String, String>,
    broken_off: Option<String>,
}

impl Summary {
    pub fn read(mut recorded: Recorded, names: &Names) -> Result<Self, RecordError> {
        let mut summary = Self::default();
        let mut before: Option<(u64, Status)> = None;
        while let Some((at_ns, content)) = recorded.next_message()? {
            let (begin, end) = *summary.span_ns.get_or_insert((at_ns, at_ns));
            summary.span_ns = Some((begin.min(at_ns), end.max(at_ns)));
            let topic = match &content {
                Content::Skeleton(_) => Topic::Skeleton.name(),
                Content::Target(_) => Topic::Target.name(),
                Content::Policy(_) => Topic::Policy.name(),
                Content::Command(_) => Topic::Command.name(),
                Content::State(_) => Topic::State.name(),
                Content::Status(_) => Topic::StatusRaw.name(),
                Content::Inputs(_) => Topic::Inputs.name(),
                Content::Other { topic, .. } => topic,
            };
            match summary.counts.get_mut(topic) {
                Some(count) => *count += 1,
                None => drop(summary.counts.insert(topic.to_owned(), 1)),
            }
            let at_s = at_ns.saturating_sub(begin) as f64 * 1e-9;
            let pause = match &content {
                Content::Target(target) => summary.trace.target(target),
                Content::State(state) => summary.trace.state(state),
                Content::Status(status) => summary.trace.status(status),
                _ => None,
            };
            if let Some(pause) = pause {
                summary.pause(at_s, pause);
            }
            match &content {
                Content::Command(command) => summary.trace.command(command),
                Content::Status(status) => {
                    for sentence in sentences(before.as_ref().map(|(_, before)| before), status, names) {
                        summary.sentence(at_s, sentence.text, SENTENCES_MAX);
                    }
                    if let Some((before_ns, before)) = &before {
                        let lasted_s = at_ns.saturating_sub(*before_ns) as f64 * 1e-9;
                        *summary.modes_s.entry(before.mode).or_default() += lasted_s;
                    }
                    before = Some((at_ns, **status));
                }
                _ => {}
            }
        }
        if let Some(pause) = summary.trace.finish() {
            summary.pause(summary.duration_s(), pause);
        }
        summary.sum_pauses();
        summary.about = recorded.about().clone();
        summary.outcome = recorded.outcome().clone();
        summary.broken_off = recorded.broken_off();
        Ok(summary)
    }

    /// Adds a pause that ended at `end_s`. A busy machine pauses hundreds of times, so each subject has one sentence.
    fn pause(&mut self, end_s: f64, pause: Pause) {
        let begin_s = end_s - pause.length_s();
        let (count, sum_ns, at_s, longest) = self.pauses.entry(pause.subject).or_insert((0, 0, begin_s, pause));
        (*count, *sum_ns) = (*count + 1, *sum_ns + pause.length_ns);
        if pause.length_ns > longest.length_ns {
            (*at_s, *longest) = (begin_s, pause);
        }
    }

    fn sum_pauses(&mut self) {
        for (count, sum_ns, at_s, longest) in std::mem::take(&mut self.pauses).into_values() {
            let sum = format!(", the longest of {count} pauses, {:.0} ms in all", sum_ns as f64 * 1e-6);
            self.sentence(at_s, longest.text() + if count > 1 { &sum } else { "" }, usize::MAX);
        }
    }

    /// Adds a sentence after those of earlier times, unless there are `most`.
    fn sentence(&mut self, at_s: f64, text: String, most: usize) {
        if self.sentences.len() < most {
            let place = self.sentences.partition_point(|(earlier_s, _)| *earlier_s <= at_s);
            self.sentences.insert(place, (at_s, text));
        } else {
            self.unsaid += 1;
        }
    }

    /// Returns the reason if the file is damaged or truncated.
    pub fn broken_off(&self) -> Option<&str> {
        self.broken_off.as_deref()
    }

    pub fn duration_s(&self) -> f64 {
        self.span_ns.map_or(0.0, |(begin, end)| (end - begin) as f64 * 1e-9)
    }

    pub fn text(&self) -> String {
        let mut out = String::new();
        let about = |key: &str| self.about.get(key).map_or("unknown", String::as_str);
        let _ = writeln!(out, "duration  {:.3} s, recorded {}", self.duration_s(), about("origin"));
        let _ =
            writeln!(out, "robot     {} ({}), settings {}", about("robot"), about("robot_hash"), about("config_hash"));
        let ended = match (&self.broken_off, self.outcome.is_empty()) {
            (Some(why), _) => format!("is damaged or truncated ({why}): what is whole was read"),
            (None, true) => "complete".to_owned(),
            (None, false) => {
                let outcome: Vec<_> = self.outcome.iter().map(|(key, value)| format!("{key} {value}")).collect();
                format!("complete; {}", outcome.join(", "))
            }
        };
        let _ = writeln!(out, "file      {ended}");
        let _ = writeln!(out, "topics");
        for (topic, count) in &self.counts {
            let rate_hz = *count as f64 / self.duration_s().max(1e-9);
            let _ = writeln!(out, "  {topic:<24} {count:>9}  {rate_hz:8.1} Hz");
        }
        let _ = writeln!(out, "modes");
        for (number, seconds) in &self.modes_s {
            let _ = writeln!(out, "  {:<14} {seconds:9.3} s", mode_name(*number));
        }
        let _ = writeln!(out, "what happened");
        for (at_s, text) in &self.sentences {
            let _ = writeln!(out, "  {at_s:9.3} s  {text}");
        }
        if self.unsaid > 0 {
            let _ = writeln!(out, "  and {} more sentences, in the file under {}", self.unsaid, Topic::Log.name());
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hundreds_of_pauses_have_one_sentence_for_each_subject() {
        let mut summary = Summary::default();
        for (n, subject) in ["control", "driver"].into_iter().cycle().take(190).enumerate() {
            summary.pause(n as f64, Pause { subject, length_ns: 10_000_000 + n as u64 % 100 * 1_000_000 });
        }
        summary.sum_pauses();
        let found: Vec<_> = summary.sentences.iter().map(|(at_s, text)| format!("{at_s:.3} s {text}")).collect();
        assert_eq!(found[0], "97.892 s control for 108 ms, the longest of 95 pauses, 5380 ms in all");
        assert!(found.len() == 2 && found[1].contains(" s driver for 109 ms, the longest of 95"), "{found:?}");
    }
}
