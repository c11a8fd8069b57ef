//! A policy's messages on the skeleton socket, as JSON: chunks of joint targets in, the joints out.

use messages::{
    CHUNK_ROWS_MAX, ChunkDrop, Joints, Layout, Mode, PolicyChunk, RobotId, Stamp, chunk_flag, joints_flag, source_flag,
};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::borrow::Cow;

/// First packet of a policy: this text, with the version of its messages.
pub const POLICY_HELLO: &[u8] = b"teleopd policy 1";
/// Longest message of a policy: 100 rows of positions and velocities of 24 joints, with 25 characters for a number.
pub const POLICY_BYTES_MAX: usize = 128 << 10;

/// Why a message is no chunk.
pub type NoChunk = (ChunkDrop, Cow<'static, str>);
/// Numbers, of which null is one that is not known.
type Row = Vec<Option<f64>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Message {
    joints: Vec<Value>,
    rate_hz: f64,
    positions: Vec<Row>,
    velocities: Option<Vec<Row>>,
    closure: Option<[Option<Row>; 2]>,
    start_ns: Option<u64>,
    observed_ns: u64,
}

fn shape<T>(text: String) -> Result<T, NoChunk> {
    Err((ChunkDrop::Shape, text.into()))
}

/// Returns the chunk of a message that arrived at `now`, for `robot` with joints of these names. Without `start_ns` it starts
/// now, and a single row a period from now. The caller gives it a session.
///
/// # Errors
/// Names the key, the value and what is allowed. Whether numbers and times are plausible is left to `ingest`.
pub fn chunk_from_json(bytes: &[u8], names: &[String], robot: RobotId, now: Stamp) -> Result<PolicyChunk, NoChunk> {
    if bytes.len() > POLICY_BYTES_MAX {
        return shape(format!("the message has more than {POLICY_BYTES_MAX} bytes; send fewer rows, or fewer digits"));
    }
    let message: Message = serde_json::from_slice(bytes).map_err(|error| {
        // Python writes numbers that JSON has not.
        let has = |word: &[u8]| bytes.windows(word.len()).any(|part| part == word);
        let reason = if has(b"NaN") || has(b"Infinity") { ChunkDrop::Value } else { ChunkDrop::Shape };
        (reason, format!("the message is no chunk in JSON: {error}").into())
    })?;
    let (rows, rate_hz) = (message.positions.len(), message.rate_hz);
    if !(1..=CHUNK_ROWS_MAX).contains(&rows) || !(1.0..=200.0).contains(&rate_hz) {
        return shape(format!("positions, rate_hz: {rows} rows at {rate_hz} Hz; 1 to 100 at 1 to 200 Hz are allowed"));
    }
    let mut chunk = PolicyChunk { robot, period_ns: (1e9 / rate_hz) as u64, rows: rows as u32, ..PolicyChunk::ZERO };
    chunk.start = message.start_ns.map_or(now.plus_ns(if rows == 1 { chunk.period_ns } else { 0 }), Stamp);
    (chunk.header.sequence, chunk.header.stamp, chunk.header.origin) = (now.0, now, Stamp(message.observed_ns));
    let mut joints = Vec::new();
    for (i, joint) in message.joints.iter().enumerate() {
        let name = joint.as_str().and_then(|name| names.iter().position(|known| known == name));
        match name.or_else(|| Some(joint.as_u64()? as usize).filter(|j| *j < names.len())) {
            Some(j) if chunk.valid_mask & 1 << j == 0 => joints.push(j),
            Some(_) => return shape(format!("joints[{i}]: {joint} is named twice")),
            None => return shape(format!("joints[{i}]: the robot has no {joint}; it has {}", names.join(", "))),
        }
        chunk.valid_mask |= 1 << joints[i];
    }
    fill("positions", &message.positions, (rows, &joints), &mut chunk.q)?;
    if let Some(velocities) = &message.velocities {
        chunk.flags |= chunk_flag::VELOCITIES;
        fill("velocities", velocities, (rows, &joints), &mut chunk.v)?;
    }
    for (hand, row) in message.closure.iter().flatten().enumerate() {
        let Some(row) = row else { continue };
        chunk.flags |= chunk_flag::CLOSURE[hand];
        let column: Vec<Row> = row.iter().map(|number| vec![number.filter(|x| (0.0..=1.0).contains(x))]).collect();
        fill("closure", &column, (rows, &[hand]), &mut chunk.closure)?;
    }
    Ok(chunk)
}

fn fill<const N: usize>(
    key: &str,
    given: &[Row],
    (rows, joints): (usize, &[usize]),
    into: &mut [[f32; N]],
) -> Result<(), NoChunk> {
    if given.len() != rows || given.iter().any(|row| row.len() != joints.len()) {
        let lengths: Vec<_> = given.iter().map(Vec::len).collect();
        return shape(format!("{key}: rows of {lengths:?} numbers; {rows} rows of {} are needed", joints.len()));
    }
    for (given, row) in given.iter().zip(into) {
        joints.iter().zip(given).for_each(|(&j, number)| row[j] = number.map_or(f32::NAN, |number| number as f32));
    }
    Ok(())
}

/// Returns the joints as policies read them: positions in rad or m, velocities per second. What is not known is null.
pub fn joints_as_json(joints: &Joints, names: &[String]) -> String {
    let known = |flags: u32| joints.known & flags == flags;
    let values = |flags, all: &[f64]| known(flags).then(|| all[..names.len()].to_vec());
    let (state, leader) = (joints_flag::STATE, |side| source_flag::leader(joints.sources, side));
    let dropped = ChunkDrop::ALL.iter().zip(joints.chunks_dropped).filter(|(_, count)| *count > 0);
    json!({
        "stamp_ns": joints.header.stamp.0,
        "origin_ns": joints.header.origin.0,
        "joints": names,
        "mode": Mode::from_u32(joints.mode).filter(|_| known(joints_flag::STATUS)).map(Mode::name),
        "led_by": known(joints_flag::STATUS).then(|| json!({ "left": leader(0), "right": leader(1) })),
        "commanded": values(state, &joints.commanded),
        "commanded_v": values(state, &joints.commanded_v),
        "measured": values(state, &joints.measured),
        "measured_v": values(state, &joints.measured_v),
        "short_of": values(state | joints_flag::POLICY, &joints.short_of),
        "chunks_dropped": dropped.map(|(why, count)| (why.name().to_owned(), json!(count))).collect::<Map<_, _>>(),
    })
    .to_string()
}

/// Returns the answer to a chunk that was dropped. With six bytes for each character it fits the buffer of its connection.
pub fn drop_as_json((reason, why): &NoChunk) -> String {
    let why: String = why.chars().take(2048).collect();
    json!({ "dropped": reason.name(), "why": why }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Stamp = Stamp(1_000_000_000);

    fn parsed(changed: &str) -> Result<PolicyChunk, NoChunk> {
        let text = format!(r#"{{"observed_ns":9,"rate_hz":20,{changed}}}"#);
        let robot = RobotId { hash: 7, joint_count: 3, reserved: 0 };
        chunk_from_json(text.as_bytes(), &["a", "b", "c"].map(str::to_owned), robot, NOW)
    }

    #[test]
    fn message_becomes_the_chunk_that_it_says() {
        let two =
            r#""joints":["c",0],"positions":[[1,2],[3,4.5]],"velocities":[[5,6],[7,null]],"closure":[null,[0,1]]"#;
        let chunk = parsed(two).unwrap();
        assert_eq!((chunk.start, chunk.period_ns, chunk.rows, chunk.header.origin), (NOW, 50_000_000, 2, Stamp(9)));
        assert_eq!((chunk.robot.hash, chunk.valid_mask, chunk.flags), (7, 0b101, 1 | 4));
        assert_eq!([0, 1].map(|i| [0, 1, 2].map(|j| chunk.q[i][j])), [[2.0, 0.0, 1.0], [4.5, 0.0, 3.0]]);
        assert!(chunk.v[0][2] == 5.0 && chunk.v[1][0].is_nan() && chunk.closure[1] == [0.0, 1.0]);
        assert_eq!(parsed(r#""joints":["b"],"positions":[[1]]"#).unwrap().start, NOW.plus_ns(50_000_000));
        assert_eq!(parsed(r#""joints":["b"],"positions":[[1]],"start_ns":4"#).unwrap().start, Stamp(4));
    }

    #[test]
    fn f137_message_that_is_no_chunk_is_refused_with_key_value_and_bound() {
        let long = format!(r#""joints":["a"],"positions":[{}[1]]"#, "[1],".repeat(40_000));
        for (changed, expected) in [
            (r#""joints":["a","elbow"],"positions":[[1,2]]"#, r#"joints[1]: the robot has no "elbow"; it has a, b, c"#),
            (r#""joints":[3],"positions":[[1]]"#, "joints[0]: the robot has no 3; it has a, b, c"),
            (r#""joints":["b",1],"positions":[[1,2]]"#, "joints[1]: 1 is named twice"),
            (r#""joints":["a"],"positions":[]"#, "positions, rate_hz: 0 rows at 20 Hz; 1 to 100 at 1 to 200 Hz"),
            (r#""joints":["a"],"positions":[[1],[1,2]]"#, "positions: rows of [1, 2] numbers; 2 rows of 1 are needed"),
            (r#""joints":["a"],"positions":[[1]],"closure":[[],null]"#, "closure: rows of [] numbers; 1 rows of 1"),
            (r#""joints":["a"],"positions":[[1]],"speed":1"#, "unknown field `speed`, expected one of `joints`"),
            (&long, "more than 131072 bytes"),
        ] {
            let (reason, text) = parsed(changed).unwrap_err();
            assert!(reason == ChunkDrop::Shape && text.contains(expected), "{reason:?} {text}");
        }
        assert_eq!(parsed(r#""joints":["a"],"positions":[[NaN]]"#).unwrap_err().0, ChunkDrop::Value);
        let name = parsed(&format!(r#""joints":["{}"],"positions":[[1]]"#, "\\u0001".repeat(20_000))).unwrap_err();
        assert!(drop_as_json(&name).len() < 16_384, "it fits the buffer of a connection");
    }
}
