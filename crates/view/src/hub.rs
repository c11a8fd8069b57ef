//! Shared output for all pages: one thread reads the messages, and the pages copy the result.

use crate::frame::{self, LatestMessages};
use crate::robot_view::RobotView;
use crate::scene::scene;
use explain::{sentences, status_json};
use messages::Status;
use robot::{Frames, Model, Names};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::atomic::AtomicUsize;
use std::sync::{Mutex, PoisonError};

/// Number of event sentences kept for pages that open later.
const EVENTS_KEPT: usize = 1000;

/// Newest output of each kind.
#[derive(Default)]
struct Shown {
    frame: Vec<u8>,
    frames: u64,
    status: Option<String>,
    statuses: u64,
    events: VecDeque<(u64, String)>,
    event_count: u64,
}

/// Counters of the output that a page has already received.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    frames: u64,
    statuses: u64,
    events: u64,
}

/// Newest output of each kind, for every page.
pub struct Hub {
    scene: String,
    shown: Mutex<Shown>,
    /// Number of open pages.
    pages: AtomicUsize,
}

impl Hub {
    /// Creates a hub without output. `about` is added to the scene.
    pub fn new(view: &RobotView, about: &Value) -> Self {
        let mut message = scene(view);
        message["about"] = about.clone();
        Self { scene: message.to_string(), shown: Mutex::default(), pages: AtomicUsize::new(0) }
    }

    pub fn pages(&self) -> &AtomicUsize {
        &self.pages
    }

    pub fn scene(&self) -> &str {
        &self.scene
    }

    pub fn show(&self, frame: &[u8], status: Option<&str>) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        shown.frame.clear();
        shown.frame.extend_from_slice(frame);
        shown.frames += 1;
        if status.is_some_and(|status| shown.status.as_deref() != Some(status)) {
            shown.status = status.map(str::to_owned);
            shown.statuses += 1;
        }
    }

    /// Publishes events to open pages and to those that open later.
    pub fn happened(&self, events: Vec<String>) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        for event in events {
            shown.event_count += 1;
            let n = shown.event_count;
            shown.events.push_back((n, event));
            if shown.events.len() > EVENTS_KEPT {
                shown.events.pop_front();
            }
        }
    }

    /// Returns the new texts for a page that has seen `seen`. The flag is true if `frame` now holds a new frame.
    pub fn news(&self, seen: &mut Seen, frame: &mut Vec<u8>) -> (Vec<String>, bool) {
        let shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        let mut texts: Vec<_> =
            shown.events.iter().filter(|(n, _)| *n > seen.events).map(|(_, text)| text.clone()).collect();
        if shown.statuses != seen.statuses {
            texts.extend(shown.status.clone());
        }
        let new = shown.frames != seen.frames;
        if new {
            frame.clone_from(&shown.frame);
        }
        *seen = Seen { frames: shown.frames, statuses: shown.statuses, events: shown.event_count };
        (texts, new)
    }
}

pub struct StatusUpdate {
    pub frame: Vec<u8>,
    /// A status, if one is due.
    pub status: Option<String>,
    pub events: Vec<String>,
}

pub struct StatusWriter<'a> {
    model: &'a Model,
    frames: Frames,
    names: Names,
    before: Option<Status>,
    written_at_s: f64,
}

/// Time between two statuses, and between two reports of frequent events, s: nobody reads faster. A change of
/// mode is reported at once.
const STATUS_PERIOD_S: f64 = 0.2;

impl<'a> StatusWriter<'a> {
    pub fn new(model: &'a Model) -> Self {
        let (names, frames) = (Names::from_model(model), Frames::default());
        Self { model, frames, names, before: None, written_at_s: f64::NEG_INFINITY }
    }

    pub fn update(&mut self, heard: &LatestMessages, at_s: f64) -> StatusUpdate {
        let mut frame = Vec::new();
        frame::encode(self.model, &mut self.frames, heard, at_s, &mut frame);
        let made = |status: &Option<Status>| status.map(|status| (status.header.incarnation, status.transition_count));
        if made(&heard.status) == made(&self.before) && at_s - self.written_at_s < STATUS_PERIOD_S {
            return StatusUpdate { frame, status: None, events: Vec::new() };
        }
        self.written_at_s = at_s;
        let events = self.events(heard, at_s);
        self.before = heard.status;
        let status = heard.status.as_ref().map_or(Value::Null, |status| {
            let mut message = status_json(status, &self.names);
            message["cause"] = json!(explain::cause(status, &self.names));
            message
        });
        let status = json!({ "tell": "status", "at_s": at_s, "status": status }).to_string();
        StatusUpdate { frame, status: Some(status), events }
    }

    fn events(&self, heard: &LatestMessages, at_s: f64) -> Vec<String> {
        let event = |gravity: &str, text: &str| {
            json!({ "tell": "event", "at_s": at_s, "gravity": gravity, "text": text }).to_string()
        };
        match (&self.before, &heard.status) {
            (Some(_), None) => vec![event("error", "control sends no status.")],
            (_, None) => vec![],
            (before, Some(now)) => {
                let sentences = sentences(before.as_ref(), now, &self.names);
                sentences.iter().map(|sentence| event(sentence.gravity.name(), &sentence.text)).collect()
            }
        }
    }
}
