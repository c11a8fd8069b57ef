//! Stick figures of a motion as SVG: from the front, from the left and from above.

use messages::{SMPL_PARENT, Smpl};
use motion::{Frame, Motion};
use nalgebra::Vector3;
use poses::person::{HAND_M, hands, head};
use std::fmt::Write;

/// Size of one figure, pixels, and pixels per metre.
const CELL_PX: f64 = 220.0;
const PX_PER_M: f64 = 100.0;

/// Maps a point to right and down in the picture, m.
type View = fn(Vector3<f64>) -> [f64; 2];

/// Draws `count` instants, evenly spread from the first to the last frame, one per column. Front, left and top
/// view are one row each.
pub fn svg(motion: &Motion, count: usize) -> String {
    let last = motion.frames.len().saturating_sub(1);
    let indices: Vec<usize> = (0..count).map(|i| i * last / count.saturating_sub(1).max(1)).collect();
    let (width, height) = (CELL_PX * count as f64, CELL_PX * 3.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    // The viewer faces the person, so the person's left is on the right. In the view from the left, front is on
    // the left.
    let views: [(&str, View); 3] =
        [("front", |p| [p.y, 0.95 - p.z]), ("left", |p| [-p.x, 0.95 - p.z]), ("top", |p| [p.y, p.x])];
    for (column, &index) in indices.iter().enumerate() {
        let Some(frame) = motion.frames.get(index) else { continue };
        for (row, (name, view)) in views.iter().enumerate() {
            let (cx, cy) = (CELL_PX * (column as f64 + 0.5), CELL_PX * (row as f64 + 0.5));
            let at = |p: Vector3<f64>| view(p).map(|c| c * PX_PER_M);
            let _ = write!(out, "<g transform=\"translate({cx:.0} {cy:.0})\">");
            figure(&mut out, frame, at);
            let label = format!("{} {name} {:.2} s", motion.name, index as f64 / motion.frame_rate_hz);
            let _ = writeln!(out, "<text x=\"-105\" y=\"105\">{label}</text></g>");
        }
    }
    out.push_str("</svg>\n");
    out
}

fn figure(out: &mut String, frame: &Frame, at: impl Fn(Vector3<f64>) -> [f64; 2]) {
    let position = |joint: usize| Vector3::from(frame.positions[joint]).cast::<f64>();
    let mut line = |from: Vector3<f64>, to: Vector3<f64>, colour: &str, width: f64| {
        let ([x1, y1], [x2, y2]) = (at(from), at(to));
        let _ = write!(
            out,
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\"/>"
        );
    };
    let arm = |joint: usize| match joint {
        j if j == Smpl::LeftElbow as usize || j == Smpl::LeftWrist as usize => Some("crimson"),
        j if j == Smpl::RightElbow as usize || j == Smpl::RightWrist as usize => Some("royalblue"),
        _ => None,
    };
    for (joint, &parent) in SMPL_PARENT.iter().enumerate().skip(1) {
        line(
            position(parent),
            position(joint),
            arm(joint).unwrap_or("dimgray"),
            if arm(joint).is_some() { 4.0 } else { 2.0 },
        );
    }
    let wrists = [Smpl::LeftWrist, Smpl::RightWrist].map(|wrist| position(wrist as usize));
    for (wrist, hand) in wrists.into_iter().zip(hands(frame)) {
        line(wrist, hand + (hand - wrist) * (0.5 * HAND_M / HAND_M), "orange", 4.0);
    }
    let [x, y] = at(head(frame));
    let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"10.5\" fill=\"none\" stroke=\"dimgray\"/>");
}
