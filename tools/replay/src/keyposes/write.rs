//! Small files: BVH without the constant values, and joint trajectories as CSV.

use motion::Motion;
use poses::trajectory::Trajectory;
use std::fmt::Write;

/// Returns the motion as BVH text like `motion::write_bvh`, with two differences. Only the root has positions,
/// because bones are rigid in our motions. Numbers have three decimals: 0.001 degrees, 0.01 mm.
pub fn compact_bvh(motion: &Motion) -> String {
    let (mut out, mut joints, mut in_frames) = (String::new(), 0, false);
    for line in motion::write_bvh(motion).lines() {
        let head = line.trim_start();
        let text = if in_frames {
            // Each joint has six numbers: position and rotation.
            rounded(head.split_whitespace().enumerate().filter(|(i, _)| *i < 6 || i % 6 >= 3).map(|(_, word)| word))
        } else if head.starts_with("CHANNELS") && joints > 0 {
            "CHANNELS 3 Zrotation Yrotation Xrotation".to_owned()
        } else if let Some(offset) = head.strip_prefix("OFFSET ") {
            format!("OFFSET {}", rounded(offset.split_whitespace()))
        } else {
            head.to_owned()
        };
        out += &line[..line.len() - head.len()];
        out += &text;
        out.push('\n');
        joints += usize::from(head.starts_with("CHANNELS"));
        in_frames |= head.starts_with("Frame Time");
    }
    out
}

fn rounded<'a>(words: impl Iterator<Item = &'a str>) -> String {
    let numbers = words.filter_map(|word| word.parse().ok()).map(|x| decimals(x, 3));
    numbers.collect::<Vec<_>>().join(" ")
}

/// Returns `time_s` and one column per joint, rad, with four decimals: 0.006 degrees.
pub fn trajectory_csv(trajectory: &Trajectory) -> String {
    let mut out = String::from("time_s");
    let is_joint = |name: &&String| !name.is_empty();
    for name in trajectory.joint_names.iter().flatten().filter(is_joint) {
        // Writing to a string cannot fail.
        let _ = write!(out, ",{name}");
    }
    out.push('\n');
    for (i, arms) in trajectory.q.iter().enumerate() {
        out.push_str(&decimals(i as f64 / trajectory.rate_hz, 5));
        let names = trajectory.joint_names.iter().flatten();
        for (q, _) in arms.iter().flatten().zip(names).filter(|(_, name)| is_joint(name)) {
            let _ = write!(out, ",{}", decimals(*q, 4));
        }
        out.push('\n');
    }
    out
}

/// Formats a number with at most `count` decimals, without trailing zeros, and without negative zero.
fn decimals(x: f64, count: usize) -> String {
    let text = format!("{x:.count$}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
