//! Writes a robot file of format 1 again, in format 2. Format 1 knew one robot: a lift, two head joints, two arms of seven.

use crate::error::RobotError;
use crate::file::RobotFile;
use toml::{Table, Value};

/// The body joints' keys of format 1, and the groups of limits with the keys of their joints.
const BODY: [&str; 3] = ["torso_lift", "head_1", "head_2"];
const GROUPS: [(&str, &[&str]); 4] = [
    ("torso", &["torso_lift"]),
    ("head", &["head_1", "head_2"]),
    ("arm_1_to_4", &["left_1", "left_2", "left_3", "left_4", "right_1", "right_2", "right_3", "right_4"]),
    ("arm_5_to_7", &["left_5", "left_6", "left_7", "right_5", "right_6", "right_7"]),
];

/// Returns the text of a robot file of format 1 in format 2. Values stay, comments are lost.
pub fn convert(file: &str, text: &str) -> Result<String, RobotError> {
    let syntax = |cause: String| RobotError::Syntax { file: file.into(), cause };
    let mut table: Table = toml::from_str(text).map_err(|error| syntax(error.to_string()))?;
    let format = table.get("format").and_then(Value::as_integer);
    if format != Some(1) {
        let found = format.map_or_else(|| "missing".to_owned(), |format| format.to_string());
        return Err(RobotError::value(file, "format", found, "only format 1 is converted"));
    }
    let taken = |table: &mut Table, key: &str| {
        table.remove(key).ok_or_else(|| RobotError::value(file, key, "missing", "format 1 has it"))
    };
    let joints = taken(&mut table, "joints")?;
    let name = |key: &str| {
        let found = joints.get(key).cloned();
        found.ok_or_else(|| RobotError::value(file, format!("joints.{key}"), "missing", "format 1 has it"))
    };
    let names = |keys: &[&str]| keys.iter().map(|key| name(key)).collect::<Result<Vec<Value>, _>>();
    let (limbs, mut limits) = (taken(&mut table, "limbs")?, taken(&mut table, "limits")?);
    let reference = taken(&mut table, "reference_rad")?;
    let mut arms = Table::new();
    for side in ["left", "right"] {
        let keys: Vec<String> = (1..=7).map(|i| format!("{side}_{i}")).collect();
        let arm_points = names(&keys.iter().map(String::as_str).collect::<Vec<_>>())?;
        let t_pose = |joint: &Value| joint.as_str().and_then(|joint| reference.get(joint)).cloned();
        let mut arm = limbs.get(side).and_then(Value::as_table).cloned().unwrap_or_default();
        arm.insert("reference_rad".into(), Value::Array(arm_points.iter().take(5).filter_map(t_pose).collect()));
        arm.insert("joints".into(), Value::Array(arm_points));
        arms.insert(side.into(), Value::Table(arm));
    }
    let mut groups = Table::new();
    for (group, keys) in GROUPS {
        let found = limits.as_table_mut().and_then(|limits| limits.remove(group));
        let Some(Value::Table(mut found)) = found else {
            return Err(RobotError::value(file, format!("limits.{group}"), "missing", "format 1 has it"));
        };
        found.insert("joints".into(), Value::Array(names(keys)?));
        groups.insert(group.into(), Value::Table(found));
    }
    if let Some(limits) = limits.as_table_mut() {
        limits.insert("groups".into(), Value::Table(groups));
    }
    // All were modelled at zero. The URDF tells which of them slide, so a person moves those to [held_m].
    let held = taken(&mut table, "held_joints")?;
    let held = held.as_array().into_iter().flatten().filter_map(Value::as_str);
    let held: Table = held.map(|name| (name.to_owned(), Value::Float(0.0))).collect();
    if !held.is_empty() {
        table.insert("held_rad".into(), Value::Table(held));
    }
    table.insert("format".into(), Value::Integer(2));
    table.insert("body_joints".into(), Value::Array(names(&BODY)?));
    table.insert("arms".into(), Value::Table(arms));
    table.insert("limits".into(), limits);
    let text = toml::to_string(&table).map_err(|error| syntax(error.to_string()))?;
    RobotFile::parse(file, &text)?;
    Ok(text)
}
