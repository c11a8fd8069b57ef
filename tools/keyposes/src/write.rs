//! Small files: BVH without the constant values, and joint trajectories as CSV.

use motion::Motion;
use poses::trajectory::Trajectory;
use std::fmt::Write;

/// Returns the motion as BVH text like `motion::write_bvh`, with two differences. Only the root has positions,
/// because bones are rigid in our motions. Numbers have three decimals: 0.001 degrees, 0.01 mm.
pub fn compact_bvh(motion: &Motion) -> String {
    let full = motion::write_bvh(motion);
    let mut out = String::with_capacity(full.len() / 4);
    let mut joints = 0;
    let mut in_frames = false;
    for line in full.lines() {
        let head = line.trim_start();
        if in_frames {
            let numbers = line.split_whitespace().filter_map(|word| word.parse::<f64>().ok());
            // Each joint has six numbers: position and rotation.
            let kept = numbers.enumerate().filter(|(i, _)| *i < 6 || i % 6 >= 3).map(|(_, x)| decimals(x, 3));
            push_line(&mut out, &kept.collect::<Vec<_>>().join(" "));
        } else if head.starts_with("CHANNELS") && joints > 0 {
            let pad = &line[..line.len() - head.len()];
            push_line(&mut out, &format!("{pad}CHANNELS 3 Zrotation Yrotation Xrotation"));
        } else if let Some(offset) = head.strip_prefix("OFFSET ") {
            let pad = &line[..line.len() - head.len()];
            let numbers = offset.split_whitespace().filter_map(|word| word.parse::<f64>().ok());
            let numbers = numbers.map(|x| decimals(x, 3)).collect::<Vec<_>>().join(" ");
            push_line(&mut out, &format!("{pad}OFFSET {numbers}"));
        } else {
            push_line(&mut out, line);
        }
        joints += usize::from(head.starts_with("CHANNELS"));
        in_frames |= head.starts_with("Frame Time");
    }
    out
}

/// Returns `time_s` and one column per joint, rad, with four decimals: 0.006 degrees.
pub fn trajectory_csv(trajectory: &Trajectory) -> String {
    let mut out = String::from("time_s");
    for name in trajectory.joint_names.iter().flatten() {
        // Writing to a string cannot fail.
        let _ = write!(out, ",{name}");
    }
    out.push('\n');
    for (i, arms) in trajectory.q.iter().enumerate() {
        out.push_str(&decimals(i as f64 / trajectory.rate_hz, 5));
        for q in arms.iter().flatten() {
            let _ = write!(out, ",{}", decimals(*q, 4));
        }
        out.push('\n');
    }
    out
}

fn push_line(out: &mut String, line: &str) {
    out.push_str(line.trim_end());
    out.push('\n');
}

/// Formats a number with at most `count` decimals, without trailing zeros, and without negative zero.
fn decimals(x: f64, count: usize) -> String {
    let text = format!("{x:.count$}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}
