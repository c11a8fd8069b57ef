//! Recordings of runs in virtual time: their content, and that the stages reproduce it.

use crate::support::{contents, loaded, recorded_offline};
use client::{PlayOptions, Player};
use messages::{Header, Layout, Mode, PayloadOrder, PolicyChunk, RobotId, Skeleton, Stamp, TICK_HZ, source_flag};
use motion::CalibrationMode;
use motion::mcap::Ending;
use record::{Compared, Content, Counts, Entry, OfflineRecording, Recording, Topic, bytes_of};
use safety::engage::OperatorView;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use world::{Links, Running, World, WorldConfig};

/// Rewrites the recording. `change` alters its messages and returns true if they stay. `lost` is the number of
/// samples that its writer lost.
fn rewritten(from: &Path, to: &Path, lost: u64, change: impl Fn(&mut Content) -> bool) {
    rearranged(from, to, lost, change, |_| ());
}

/// Does the same with its messages in another order.
fn rearranged(
    from: &Path,
    to: &Path,
    lost: u64,
    change: impl Fn(&mut Content) -> bool,
    order: impl Fn(&mut Vec<(u64, Content)>),
) {
    let (mut all, recorded) = contents(from);
    order(&mut all);
    let file = std::fs::File::create(to).unwrap();
    let mut copy = Recording::begin(file, recorded.about(), &[]).unwrap();
    for (log_time, mut content) in all {
        if !change(&mut content) {
            continue;
        }
        let (topic, data) = match content {
            Content::Skeleton(message) => (Topic::Skeleton, bytes_of(&*message)),
            Content::Target(message) => (Topic::Target, bytes_of(&*message)),
            Content::Policy(message) => (Topic::Policy, bytes_of(&*message)),
            Content::Command(message) => (Topic::Command, bytes_of(&*message)),
            Content::State(message) => (Topic::State, bytes_of(&*message)),
            Content::Status(message) => (Topic::StatusRaw, bytes_of(&*message)),
            Content::Inputs(inputs) => (Topic::Inputs, inputs.to_json().to_string().into_bytes()),
            Content::Other { .. } => continue,
        };
        copy.add(&Entry { topic, sequence: 0, log_time, data }).unwrap();
    }
    copy.finish(&BTreeMap::from([("samples_lost".to_owned(), lost.to_string())])).unwrap();
}

#[test]
fn recording_in_another_order_is_compared_and_summarised_alike() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    recorded_offline(&path, &loaded);
    let (names, same) = (robot::Names::from_model(&loaded.model), folder.path().join("same.mcap"));
    rewritten(&path, &same, 0, |_| true);
    let summary = |path: &Path| {
        let recorded = record::Recorded::open(path).expect("a recording");
        record::Summary::read(recorded, &names).expect("a summary").text()
    };
    let expected = summary(&same);
    let topic = |content: &Content| std::mem::discriminant(content);
    let by_topic = |all: &mut Vec<(u64, Content)>| {
        let mut topics: Vec<_> = Vec::new();
        all.iter().for_each(|(_, content)| {
            if !topics.contains(&topic(content)) {
                topics.push(topic(content))
            }
        });
        all.sort_by_key(|(_, content)| std::cmp::Reverse(topics.iter().position(|known| *known == topic(content))));
    };
    let later_first = |all: &mut Vec<(u64, Content)>| {
        let middle = all.len() / 2;
        all.rotate_left(middle);
    };
    for (name, order) in [("topics", &by_topic as &dyn Fn(&mut Vec<(u64, Content)>)), ("halves", &later_first)] {
        let other = folder.path().join(name);
        rearranged(&path, &other, 0, |_| true, order);
        let found = record::compare(&other, &loaded).expect("a comparison");
        assert!(found.equal(), "{name}: {found:?}");
        assert_eq!(summary(&other), expected, "{name}");
    }
}

#[test]
fn replay_of_a_recording_is_equal_and_one_changed_bit_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    let commands = recorded_offline(&path, &loaded);
    let found = record::compare(&path, &loaded).expect("a comparison");
    assert!(found.equal(), "{found:?}");
    assert_eq!(found.commands, Counts { compared: commands.len() as u64, missing: 0, different: 0 });
    assert!(found.targets.compared > found.commands.compared && found.statuses.compared > 50, "{found:?}");

    let k = commands[commands.len() / 2].k;
    let changed = folder.path().join("changed.mcap");
    rewritten(&path, &changed, 0, |content| {
        if let Content::Command(command) = content
            && command.k == k
        {
            command.q[5] = f64::from_bits(command.q[5].to_bits() ^ 1);
        }
        true
    });
    let found = record::compare(&changed, &loaded).expect("a comparison");
    assert_eq!((found.commands.different, found.targets.different), (1, 0), "{found:?}");
    assert!(found.first.as_ref().is_some_and(|first| first.starts_with(&format!("command {k}: joint 5"))), "{found:?}");

    let mut other = loaded.clone();
    other.hash ^= 1;
    let refused = record::compare(&path, &other).unwrap_err().to_string();
    assert!(refused.contains("recorded with the settings"), "{refused}");
}

/// Chunks that lerobot's ACT sent to a simulated robot, with its lateness: `crates/python/tests/act_policy.py` writes them.
fn act_chunks(robot: RobotId, begun: Stamp) -> Vec<PolicyChunk> {
    let sent: Value = serde_json::from_str(include_str!("act_chunks.json")).unwrap();
    let joints: Vec<usize> = serde_json::from_value(sent["joints"].clone()).unwrap();
    let period_ns = 1_000_000_000 / sent["rate_hz"].as_u64().unwrap();
    let at = |ms: &Value| begun.plus_ns((ms.as_f64().unwrap() * 1e6) as u64);
    let chunk = |(i, sent): (usize, &Value)| {
        let (start, stamp) = (at(&sent["start_ms"]), at(&sent["sent_ms"]));
        let rows: Vec<Vec<f32>> = serde_json::from_value(sent["positions"].clone()).unwrap();
        let mut chunk = PolicyChunk { session_nonce: 9, robot, start, period_ns, ..PolicyChunk::ZERO };
        chunk.header = Header { sequence: i as u64 + 1, stamp, origin: start, ..Header::ZERO };
        (chunk.rows, chunk.valid_mask) = (rows.len() as u32, joints.iter().map(|j| 1 << j).sum());
        for (to, row) in chunk.q.iter_mut().zip(&rows) {
            joints.iter().zip(row).for_each(|(&j, q)| to[j] = *q);
        }
        chunk
    };
    sent["chunks"].as_array().unwrap().iter().enumerate().map(chunk).collect()
}

/// Replay makes the same commands with a payload that is set at run time and a real policy that leads the right arm.
#[test]
fn recording_with_a_payload_and_a_policy_is_replayed_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    let config = WorldConfig::new(&loaded).unwrap();
    let mut world = World::new(&config, 1, Links::default());
    let mut recording = OfflineRecording::create(&path, &loaded).unwrap();
    let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
    let mut player = Player::new(&motion::builtin(), play, 5, 1);
    let mut chunks = act_chunks(loaded.model.id(), world.now()).into_iter().peekable();
    let (mut mode, mut engaged, mut led) = (0, 0, 0);
    for k in 0..6 * TICK_HZ {
        let now = world.now();
        if let Some((_, raw)) = player.due(now, mode == Mode::Engaged as u32) {
            world.publish(&raw);
        }
        while let Some(chunk) = chunks.next_if(|chunk| now >= chunk.header.stamp) {
            world.publish_chunk(&config, &chunk).expect("a valid chunk");
        }
        let order = PayloadOrder { mass_kg: 0.1 + 0.2, centre_m: Some([0.0, 1.0 / 30.0, -0.2]) };
        let operator = OperatorView {
            connected: true,
            enable_level: k > TICK_HZ,
            enable_edge: k == TICK_HZ + 1,
            heartbeat_received: now,
            takes_over: [true, false],
            payload: [Some(order).filter(|_| k == TICK_HZ), None],
            ..OperatorView::default()
        };
        let moment = world.step(&config, &operator, Running::ALL);
        recording.moment(&moment, &operator);
        let status = moment.control.expect("control runs").status;
        assert_eq!(status.payload_kg[0] > 0.0, k >= TICK_HZ, "{:?}", status.payload_refused_why);
        mode = status.mode;
        engaged += u64::from(mode == Mode::Engaged as u32);
        led |= status.sources;
    }
    recording.finish().unwrap();
    assert!(engaged > TICK_HZ && chunks.next().is_none(), "it follows with the payload, and every chunk came");
    assert_eq!(led, source_flag::PERSON[0] | source_flag::POLICY[1]);
    let found = record::compare(&path, &loaded).expect("a comparison");
    assert!(found.equal() && found.commands.compared > 5 * TICK_HZ, "{found:?}");
    // If the mass differs in one bit, the statuses differ.
    let changed = folder.path().join("changed.mcap");
    rewritten(&path, &changed, 0, |content| {
        if let Content::Inputs(inputs) = content
            && let Some(order) = &mut inputs.operator.payload[0]
        {
            order.mass_kg = f64::from_bits(order.mass_kg.to_bits() ^ 1);
        }
        true
    });
    let found = record::compare(&changed, &loaded).expect("a comparison");
    assert!(!found.equal() && found.statuses.different > 0, "{found:?}");
    // If the policy wanted another place, the commands differ.
    rewritten(&path, &changed, 0, |content| {
        if let Content::Policy(target) = content {
            target.q.iter_mut().for_each(|q| *q += 1e-9);
        }
        true
    });
    let found = record::compare(&changed, &loaded).expect("a comparison");
    assert!(found.commands.different > TICK_HZ, "{found:?}");
}

#[test]
fn incomplete_recording_compares_as_not_equal() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    let commands = recorded_offline(&path, &loaded);
    let all = commands.len() as u64;
    let part = folder.path().join("part.mcap");
    let compared = |lost: u64, stays: &dyn Fn(u64) -> bool| -> Compared {
        rewritten(&path, &part, lost, |content| !matches!(content, Content::Command(command) if !stays(command.k)));
        record::compare(&part, &loaded).expect("a comparison")
    };
    assert!(compared(0, &|_| true).equal(), "rewritten as it was");
    let (middle, last) = (commands[commands.len() / 2].k, commands[commands.len() - 1].k);
    for (stays, missing) in
        [(&(|k| k != middle) as &dyn Fn(u64) -> bool, 1), (&|k| k != last, 1), (&|k| k % 2 == 0, all / 2)]
    {
        let found = compared(0, stays);
        let Counts { compared, missing: lacks, different } = found.commands;
        assert!(!found.equal() && different == 0 && lacks.abs_diff(missing) <= 1, "{found:?}");
        assert_eq!(compared + lacks, all);
        assert!(found.first.is_some_and(|first| first.ends_with("which is missing")));
    }
    let none = compared(0, &|_| false);
    assert!(!none.equal() && none.commands.missing == all, "{none:?}");
    assert_eq!(none.flaws, ["it holds no command to compare"]);
    let lost = compared(3, &|_| true);
    assert!(!lost.equal() && lost.first.is_none(), "{lost:?}");
    assert_eq!(lost.flaws, ["its writer lost 3 messages"]);

    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&part, &whole[..whole.len() / 2]).unwrap();
    let cut = record::compare(&part, &loaded).expect("a comparison");
    assert!(!cut.equal() && cut.commands.compared > all / 4, "{cut:?}");
    assert!(cut.flaws.iter().any(|flaw| flaw.starts_with("the file is damaged or truncated")), "{cut:?}");
    // A second file follows the first in the same file. The messages are equal, but the recording does not end there.
    let long = folder.path().join("long.mcap");
    std::fs::write(&long, [&whole[..], &whole[..]].concat()).unwrap();
    let long = record::compare(&long, &loaded).expect("a comparison");
    assert!(!long.equal() && long.commands.different == 0 && long.commands.compared == all, "{long:?}");
}

#[test]
fn recorded_values_equal_published_ones_and_times_increase() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    let commands = recorded_offline(&path, &loaded);
    let (all, recorded) = contents(&path);
    assert_eq!(*recorded.ending(), Ending::Complete);
    assert_eq!(recorded.about()["config_hash"], format!("{:016x}", loaded.hash));
    let read: Vec<_> = all
        .iter()
        .filter_map(|(at, content)| match content {
            Content::Command(command) => Some((*at, **command)),
            _ => None,
        })
        .collect();
    assert!(read.windows(2).all(|pair| pair[0].0 < pair[1].0), "times rise");
    assert!(read.iter().all(|(at, command)| *at == command.header.stamp.0));
    assert_eq!(read.iter().map(|(_, command)| *command).collect::<Vec<_>>(), commands);

    // Any other reader of MCAP finds an index, the counts, and the files of the run.
    let file = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().expect("a summary");
    let stats = summary.stats.as_ref().expect("statistics");
    assert_eq!(stats.channel_count as usize, Topic::ALL.len());
    assert_eq!(stats.message_count as usize, all.len());
    assert!(summary.attachment_indexes.iter().any(|file| file.name.ends_with(".urdf")));
    for topic in Topic::ALL {
        let name = topic.name();
        let channel = summary.channels.values().find(|channel| channel.topic == name).expect("every topic");
        let schema = channel.schema.as_ref().expect("a schema");
        assert!(!schema.data.is_empty(), "{topic:?}");
        let viewed = name.starts_with("/teleop");
        assert_eq!(schema.name.starts_with("foxglove."), !viewed, "{}", schema.name);
    }
}

#[test]
fn recording_loads_as_a_motion_with_the_recorded_limbs() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    recorded_offline(&path, &loaded);
    let motion = motion::load(&path).expect("a motion");
    let skeletons: Vec<Skeleton> = contents(&path)
        .0
        .into_iter()
        .filter_map(|(_, content)| match content {
            Content::Skeleton(skeleton) => Some(*skeleton),
            _ => None,
        })
        .collect();
    // The client held the first frame until the robot was engaged. Only a tenth of a second of it is left.
    let held =
        |skeleton: &&Skeleton| skeleton.positions == skeletons[0].positions && skeleton.limbs == skeletons[0].limbs;
    let held = skeletons.iter().take_while(held).count();
    let (whole, cut) = (skeletons.len(), skeletons.len() - motion.frames.len());
    assert!(held > 200 && cut < held && held - cut <= 8, "{cut} of {whole} cut, {held} held");
    assert!((motion.frame_rate_hz - 60.0).abs() < 0.1, "{} Hz", motion.frame_rate_hz);
    let limbs = motion::limbs(&motion, &motion::calibrate(&motion, motion::CalibrationMode::Rig));
    // A frame may be one tick away from its skeleton: 0.7 ms of a motion below 10 rad/s.
    for (limbs, skeleton) in limbs.iter().zip(&skeletons[cut..]) {
        for (limb, seen) in limbs.iter().zip(&skeleton.limbs) {
            let dot: f64 = limb.iter().zip(seen).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
            assert!(2.0 * dot.abs().min(1.0).acos() < 0.02, "{limb:?} is not {seen:?}");
        }
    }
    // With a second person in between, and a message that was cut.
    let file = std::fs::File::create(&path).unwrap();
    let mut both = Recording::begin(file, &BTreeMap::new(), &[]).unwrap();
    for skeleton in &skeletons {
        let mut other = *skeleton;
        (other.session_nonce, other.limbs) = (skeleton.session_nonce + 1, [[0.0, 0.0, 0.0, 1.0]; 4]);
        for (skeleton, bytes) in [(skeleton, 0..448), (&other, 0..448), (&other, 0..40)] {
            let data = bytes_of(skeleton)[bytes].to_vec();
            let log_time = skeleton.header.stamp.0;
            both.add(&Entry { topic: Topic::Skeleton, sequence: 0, log_time, data }).unwrap();
        }
    }
    both.finish(&BTreeMap::new()).unwrap();
    let one = motion::load(&path).expect("a motion");
    assert_eq!(one.frames, motion.frames);
    let left_out = |of: &str| one.guesses.warnings.contains(&format!("{whole} skeletons {of} are left out"));
    let warnings = ["without both arms, or of a wrong length,", "of a second person (another topic or session)"];
    assert!(warnings.into_iter().all(left_out), "{:?}", one.guesses.warnings);
}

#[test]
fn invalid_recording_is_refused_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("text.mcap");
    std::fs::write(&path, "not a recording").unwrap();
    let error = motion::load(&path).unwrap_err().to_string();
    assert!(error.contains("text.mcap: is not an MCAP file"), "{error}");
    let file = std::fs::File::create(&path).unwrap();
    Recording::begin(file, &BTreeMap::new(), &[]).unwrap().finish(&BTreeMap::new()).unwrap();
    let error = motion::load(&path).unwrap_err().to_string();
    assert!(error.contains("holds 0 skeletons of the schema teleop.Skeleton.v3"), "{error}");
    let error = record::compare(&path, &loaded()).unwrap_err().to_string();
    assert!(error.contains("recorded with the settings none"), "{error}");
}
