//! A recording for pages: all page messages, made once in advance, and a position that the pages move.

use crate::frame::LatestMessages;
use crate::hub::{Hub, StatusWriter};
use robot::Model;
use std::sync::{Mutex, PoisonError};

/// Most frames kept, 150 MB: 20 minutes at 60 a second. If there are more, every second frame is dropped.
const FRAMES_MAX: usize = 72_000;
/// Initial time between two frames, s.
const PERIOD_S: f64 = 1.0 / 60.0;

struct TimedFrame {
    at_s: f64,
    frame: Vec<u8>,
    /// Index of the status that applies.
    status: Option<usize>,
}

/// A recording as pages see it.
pub struct RecordingView {
    frames: Vec<TimedFrame>,
    statuses: Vec<String>,
    events: Vec<String>,
    period_s: f64,
}

/// Makes a view from messages in the order of their times.
pub struct RecordingViewBuilder<'a> {
    writer: StatusWriter<'a>,
    view: RecordingView,
    next_s: f64,
}

impl<'a> RecordingViewBuilder<'a> {
    /// Creates an empty view.
    pub fn new(model: &'a Model) -> Self {
        let view = RecordingView { frames: Vec::new(), statuses: Vec::new(), events: Vec::new(), period_s: PERIOD_S };
        Self { writer: StatusWriter::new(model), view, next_s: 0.0 }
    }

    /// Adds the newest messages at `at_s`, s from the beginning.
    pub fn add(&mut self, heard: &LatestMessages, at_s: f64) {
        if at_s < self.next_s {
            return;
        }
        let view = &mut self.view;
        self.next_s = at_s + view.period_s;
        let news = self.writer.update(heard, at_s);
        view.statuses.extend(news.status);
        view.events.extend(news.events);
        let status = view.statuses.len().checked_sub(1);
        view.frames.push(TimedFrame { at_s, frame: news.frame, status });
        if view.frames.len() > FRAMES_MAX {
            let mut n = 0;
            view.frames.retain(|_| {
                n += 1;
                n % 2 == 1
            });
            view.period_s *= 2.0;
        }
    }

    /// Returns the complete view.
    pub fn build(self) -> RecordingView {
        self.view
    }
}

impl RecordingView {
    /// Time from the first frame to the last, s.
    pub fn duration_s(&self) -> f64 {
        self.frames.last().map_or(0.0, |shown| shown.at_s)
    }

    /// Returns every event sentence, as sent to pages.
    pub fn events(&self) -> &[String] {
        &self.events
    }

    /// Shows the state at `at_s`.
    pub fn show(&self, hub: &Hub, at_s: f64) {
        let after = self.frames.partition_point(|shown| shown.at_s <= at_s);
        let Some(shown) = self.frames.get(after.saturating_sub(1)) else { return };
        let status = shown.status.and_then(|status| self.statuses.get(status));
        hub.show(&shown.frame, status.map(String::as_str));
    }
}

/// Position in a recording. All pages share it.
#[derive(Debug)]
pub struct Position {
    at: Mutex<(f64, bool)>,
    duration_s: f64,
}

impl Position {
    pub fn new(duration_s: f64) -> Self {
        Self { at: Mutex::new((0.0, true)), duration_s }
    }

    /// Moves to `at_s`, clamped to the recording. Ignores NaN and infinite times.
    pub fn seek(&self, at_s: f64) {
        if at_s.is_finite() {
            self.change(|at| at.0 = at_s.clamp(0.0, self.duration_s));
        }
    }

    /// Plays or pauses. Playing at the end starts from the beginning.
    pub fn play(&self, plays: bool) {
        self.change(|at| {
            let over = at.0 >= self.duration_s;
            *at = (if plays && over { 0.0 } else { at.0 }, plays);
        });
    }

    /// Advances by `by_s` if it plays. Returns the position.
    pub fn advance(&self, by_s: f64) -> f64 {
        self.change(|at| {
            if at.1 {
                at.0 = (at.0 + by_s).min(self.duration_s);
                at.1 = at.0 < self.duration_s;
            }
            at.0
        })
    }

    pub fn is_playing(&self) -> bool {
        self.change(|at| at.1)
    }

    fn change<R>(&self, by: impl FnOnce(&mut (f64, bool)) -> R) -> R {
        by(&mut self.at.lock().unwrap_or_else(PoisonError::into_inner))
    }
}
