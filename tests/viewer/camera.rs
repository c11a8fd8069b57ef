//! A camera of a page, as a program.

use super::{Page, Received, Viewer};
use serde_json::json;
use std::time::{Duration, Instant};
use tungstenite::Message;
use view::{LANDMARKS, SIGHT_BYTES};

/// Time between two images.
pub const PERIOD: Duration = Duration::from_millis(33);

/// A message about an image that shows a person whose left arm is raised by `angle`, rad. Real landmarks tremble.
pub fn image(sent_ms: f64, age_ms: f64, angle: f32) -> Vec<u8> {
    let mut marks = [[0.0_f32; 3]; LANDMARKS];
    (marks[0], marks[7], marks[8]) = ([0.0, -0.65, -0.1], [0.08, -0.65, 0.0], [-0.08, -0.65, 0.0]);
    for (side, first, reach) in [(1.0, 0, [angle.cos(), -angle.sin()]), (-1.0, 1, [-1.0, 0.0])] {
        let along = |length: f32| [0.18 * side + length * reach[0], -0.45 + length * reach[1], 0.0];
        for (n, length) in [(11, 0.0), (13, 0.28), (15, 0.53), (17, 0.6), (19, 0.6), (21, 0.6)] {
            marks[n + first] = along(length);
        }
        for (n, y) in [(23, 0.0), (25, 0.42), (27, 0.85), (29, 0.9), (31, 0.92)] {
            marks[n + first] = [0.1 * side, y, if n == 31 { -0.12 } else { 0.0 }];
        }
    }
    let mut bytes = [sent_ms, age_ms].map(f64::to_le_bytes).concat();
    bytes.extend(0_f32.to_le_bytes());
    for (n, mark) in marks.iter().enumerate() {
        let tremble = 2e-4 * (0.7 * sent_ms as f32 + n as f32).sin();
        bytes.extend(mark.map(|x| (x + tremble).to_le_bytes()).concat());
        // The camera is far: it sees 0.35 heights of the image for a metre.
        bytes.extend([0.9, 0.35 * (mark[0] + tremble), 0.35 * (mark[1] + tremble)].map(f32::to_le_bytes).concat());
    }
    assert_eq!(bytes.len(), SIGHT_BYTES);
    bytes
}

/// A page that sends images by its own clock.
pub struct Camera {
    pub page: Page,
    pub begun: Instant,
    pub keeps: bool,
    pub angle: f32,
}

impl Camera {
    pub fn open(viewer: &Viewer) -> Self {
        let mut page = viewer.page();
        assert_eq!(page.message("scene")["about"]["camera"], true);
        Self { page, begun: Instant::now(), keeps: false, angle: 0.0 }
    }

    pub fn send(&mut self, bytes: Vec<u8>) {
        self.page.socket.send(Message::binary(bytes)).expect("the server listens");
    }

    pub fn image(&self) -> Vec<u8> {
        image(self.begun.elapsed().as_secs_f64() * 1e3, 20.0, self.angle)
    }

    /// Sends images at their rate, and keeps a pressed enable, until `done`.
    pub fn until(&mut self, what: &str, done: impl FnMut(&Received) -> bool) {
        let (begun, keeps, angle) = (self.begun, self.keeps, self.angle);
        let send = |page: &mut Page| {
            let bytes = image(begun.elapsed().as_secs_f64() * 1e3, 20.0, angle);
            page.socket.send(Message::binary(bytes)).expect("the server listens");
            if keeps {
                page.request("keep");
            }
        };
        self.page.drive(what, PERIOD, send, done);
    }

    pub fn start(&mut self) {
        self.page.send(&json!({ "do": "camera", "on": true }));
    }
}
