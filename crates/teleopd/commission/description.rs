//! Says in words what a person should have seen. Does no IO and reads no clock.

use messages::JOINTS_MAX;
use robot::{Frames, Model};

/// A hand that moves less than this did not visibly move, m. Assumption.
const VISIBLE_M: f64 = 5e-4;

/// Returns the link that a joint moves: the first link of the URDF on its body.
pub fn link(model: &Model, joint: usize) -> &str {
    let name = model.links().find(|(_, body, _)| *body == joint + 1).map(|(name, ..)| name);
    name.unwrap_or(&model.joint_names[joint])
}

/// Says how the link of `joint` moves from `q` when the joint moves by `by`, rad or m, and how the hands move.
/// Directions are the robot's own: x forward, y to its left, z up.
pub fn visible_motion(model: &Model, q: &[f64; JOINTS_MAX], joint: usize, by: f64) -> String {
    let (mut before, mut after) = (Frames::default(), Frames::default());
    let mut to = *q;
    to[joint] += by;
    model.forward(q, &mut before);
    model.forward(&to, &mut after);
    let own = if model.prismatic[joint] { String::new() } else { format!(" {}", turn(model, &before, joint, by)) };
    let mut all = vec![format!("the link {}{own}", link(model, joint))];
    let points = model.speed_points();
    for (side, point, arm) in [("left", points[1], 0), ("right", points[3], 1)] {
        let [a, b] = [&before, &after].map(|frames| frames.base_from_body[point.body].transform_point(&point.at));
        let moved = b - a;
        let way = direction([moved.x, moved.y, moved.z]);
        let own = model.arms[arm].range().contains(&joint);
        match way {
            Some(way) => all.push(format!("the fingertips of the {side} hand went {way}")),
            None if own => all.push(format!("the {side} hand stayed where it is")),
            None => {}
        }
    }
    all.join("; ")
}

fn turn(model: &Model, frames: &Frames, joint: usize, by: f64) -> String {
    let body = joint + 1;
    let somewhere = frames.base_from_body[body].t;
    let [.., x, y, z] = model.jacobian(frames, body, &somewhere)[joint];
    let words = [
        (x, ["leant to the robot's right", "leant to the robot's left"]),
        (y, ["tipped forward", "tipped backward"]),
        (z, ["turned to the robot's left", "turned to the robot's right"]),
    ];
    let (axis, [along, against]) = words.into_iter().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap_or(words[0]);
    let how = if axis * by > 0.0 { along } else { against };
    format!("{how} by {:.1} degrees", by.abs().to_degrees())
}

/// Names the parts of a motion in m, the largest first. `None` if nobody could see it.
fn direction(moved: [f64; 3]) -> Option<String> {
    let words = [["forward", "backward"], ["to its left", "to its right"], ["up", "down"]];
    let mut parts: Vec<_> = moved.into_iter().zip(words).filter(|(part, _)| part.abs() >= VISIBLE_M).collect();
    parts.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let text = |(part, [plus, minus]): &(f64, [&str; 2])| {
        format!("{:.0} mm {}", (part.abs() * 1e3).max(1.0), if *part > 0.0 { plus } else { minus })
    };
    (!parts.is_empty()).then(|| parts.iter().map(text).collect::<Vec<_>>().join(", "))
}
