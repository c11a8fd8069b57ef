//! The optimum of `eval --following` for files that `replay --offline` wrote, against the limbs of their targets, so that it
//! can be compared with other implementations: `optimum ROBOT.toml SECONDS SPEED_SHARE ACCELERATION OUT.csv ...`. The speeds
//! are shares of the URDF's, accelerations in rad/s^2 of all arm joints.

use eval::following::{
    Bounds, Joints, State, bounds_of,
    optimum::{least_squares, optimum},
};
use retarget::{ArmModel, limb_error_deg};
use std::error::Error;
use std::path::Path;
use train::robot_file::read_model;

/// Rows of 1500 Hz from one node to the next.
const ROWS: usize = 30;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [robot, seconds, share, acceleration, files @ ..] = words.as_slice() else {
        return Err("give ROBOT.toml SECONDS SPEED_SHARE ACCELERATION OUT.csv ...".into());
    };
    let (seconds, share, acceleration): (f64, f64, f64) = (seconds.parse()?, share.parse()?, acceleration.parse()?);
    let model = read_model(Path::new(robot))?;
    let arm = ArmModel::of(&model);
    let name = std::fs::read_to_string(robot)?;
    let urdf = Path::new(robot).with_file_name(robot::urdf_file(robot, &name)?);
    let urdf = urdf_rs::read_file(&urdf)?;
    for file in files {
        let (nodes, columns) = read(Path::new(file), &model.joint_names, seconds)?;
        let mut sums = [0.0; 2];
        for (side, bounds) in bounds_of(&model).into_iter().enumerate() {
            let first = 3 + 7 * side;
            let speed = |j: usize| {
                let joint = urdf.joints.iter().find(|joint| joint.name == model.joint_names[first + j]);
                joint.map_or(0.0, |joint| joint.limit.velocity * share)
            };
            let bounds = Bounds { v_max: std::array::from_fn(speed), a_max: [acceleration; 5], ..bounds };
            let of = |row: &[f64], at: usize| -> [f64; 5] { std::array::from_fn(|j| row[columns + at + first + j]) };
            let goal: Vec<_> = nodes.iter().map(|row| arm.forward(&of(row, 17))).collect();
            let start = State { q: Joints::from(of(&nodes[0], 0)), v: Joints::zeros() };
            for (sum, find) in sums.iter_mut().zip([least_squares, optimum]) {
                let states = std::iter::once(start).chain(find(&arm, &bounds, &goal, start).states);
                let error =
                    |state: State, goal| limb_error_deg(&arm.forward(&state.q.into()), goal).iter().sum::<f64>();
                *sum += states.zip(&goal).map(|(state, goal)| error(state, goal)).sum::<f64>();
            }
        }
        let [squares, angles] = sums.map(|sum| sum / 4.0 / nodes.len() as f64);
        let seconds = nodes.len() as f64 * 0.02;
        println!("{file} {seconds:.1} s, by least squares {squares:.2} degrees, by angles {angles:.2}");
    }
    Ok(())
}

/// The rows of the nodes while Engaged at first, and the index of the first joint's column.
type Nodes = (Vec<Vec<f64>>, usize);

fn read(file: &Path, names: &[String; 17], seconds: f64) -> Result<Nodes, Box<dyn Error>> {
    let text = std::fs::read_to_string(file)?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let first = head.iter().position(|name| *name == names[0]).ok_or("no column of the first joint")?;
    let summary: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file.with_extension("json"))?)?;
    let modes = summary["modes"].as_array().ok_or("no modes")?;
    let row = |mode: &serde_json::Value| mode["k"].as_u64().unwrap_or(0) as usize;
    let engaged = modes.iter().position(|mode| mode["mode"] == "Engaged").ok_or("never Engaged")?;
    let begin = row(&modes[engaged]);
    let end = modes.get(engaged + 1).map_or(usize::MAX, row).min(begin + (seconds * 1500.0) as usize);
    let wanted = lines.take(end).skip(begin).step_by(ROWS);
    let numbers = |line: &str| line.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>();
    Ok((wanted.map(numbers).collect::<Result<_, _>>()?, first))
}
