//! Clips of made-up people on the rigs of many exporters, in every dialect of BVH that we know of. The product's angles are
//! compared with those of a second reader (`reader.rs`), to 0.000 degrees.

use crate::reader::{self, Matrix, apart, apply, between, times};

use messages::Smpl::{self, *};
use motion::{Frame, Motion, builtin, load, upsample};
use std::fmt::Write;
use std::sync::LazyLock;

/// Largest angle that counts as 0.000, degrees. A float has 7 digits: a bone of 0.1 m at 1 m is exact to 1e-4 degrees.
const ZERO_DEG: f64 = 5e-4;
/// Joints whose places and rotations are compared, and the lines between them.
const JOINTS: [Smpl; 14] = [
    Pelvis,
    Head,
    LeftHip,
    RightHip,
    LeftKnee,
    RightKnee,
    LeftAnkle,
    RightAnkle,
    LeftShoulder,
    RightShoulder,
    LeftElbow,
    RightElbow,
    LeftWrist,
    RightWrist,
];
const LINES: [[usize; 2]; 11] =
    [[0, 1], [2, 3], [8, 9], [2, 4], [3, 5], [4, 6], [5, 7], [8, 10], [9, 11], [10, 12], [11, 13]];

/// Names of a rig's joints. A name may contain spaces.
struct Rig {
    name: &'static str,
    trunk: &'static str,
    leg: &'static str,
    arm: &'static str,
    sides: [&'static str; 2],
}

/// Reads `data/rigs.txt`, which describes the columns.
fn rigs() -> Vec<Rig> {
    let lines = include_str!("data/rigs.txt").lines().filter(|line| !line.starts_with('#'));
    let rig = |line: &'static str| {
        let [name, sides, trunk, leg, arm] = line.split("; ").collect::<Vec<_>>().try_into().expect("five columns");
        let (left, right) = sides.split_once(' ').expect("two sides");
        Rig { name, trunk, leg, arm, sides: [left, right] }
    };
    lines.map(rig).collect()
}

/// A joint of a file, and its place in the T-pose, m, x left, y up, z forward.
struct Joint {
    name: String,
    parent: Option<usize>,
    at: [f64; 3],
    smpl: Option<Smpl>,
}

fn place(smpl: Smpl) -> [f64; 3] {
    static REST: LazyLock<Frame> = LazyLock::new(|| builtin().frames[0]);
    let [x, y, z] = REST.positions[smpl as usize].map(f64::from);
    [y, z, x]
}

/// Appends a chain. `smpl` are the joints with length. What comes beyond them follows at intervals of 5 cm.
fn chain(joints: &mut Vec<Joint>, mut parent: Option<usize>, names: &str, smpl: &[Smpl]) {
    let (mut next, mut beyond) = (smpl.iter().copied(), 0.0);
    for name in names.split(',') {
        let inline = name.starts_with('~');
        let joint = if inline { None } else { next.next() };
        let at = match (joint, parent) {
            (Some(joint), _) => place(joint),
            (None, Some(parent)) if inline => joints[parent].at,
            (None, _) => {
                beyond += 0.05;
                let [x, y, z] = place(smpl[smpl.len() - 1]);
                [x, y, z + beyond]
            }
        };
        joints.push(Joint { name: name.trim_start_matches('~').to_owned(), parent, at, smpl: joint });
        parent = Some(joints.len() - 1);
    }
}

fn joints(rig: &Rig) -> Vec<Joint> {
    let mut joints = Vec::new();
    let (spine, neck) = rig.trunk.split_once('|').expect("a neck");
    chain(&mut joints, None, spine, &[Pelvis, Spine1, Spine2, Spine3]);
    let chest = joints.len() - 1;
    let neck_joints: &[Smpl] = if neck.contains(',') { &[Neck, Head] } else { &[Head] };
    chain(&mut joints, Some(chest), neck, neck_joints);
    // The head is what has this name, or else the end.
    joints[chest + 1..].iter_mut().for_each(|joint| joint.smpl = joint.smpl.filter(|smpl| *smpl != Head));
    let named = |joint: &Joint| joint.name.to_ascii_lowercase().contains("head");
    let head = joints[chest + 1..].iter().position(named).map_or(joints.len() - 1, |i| chest + 1 + i);
    joints[head].smpl = Some(Head);
    let legs = [[LeftHip, LeftKnee, LeftAnkle, LeftFoot], [RightHip, RightKnee, RightAnkle, RightFoot]];
    let arms = [[LeftCollar, LeftShoulder, LeftElbow, LeftWrist], [RightCollar, RightShoulder, RightElbow, RightWrist]];
    let collar = usize::from(rig.arm.split(',').count() == 3);
    for (side, (leg, arm)) in rig.sides.iter().zip(legs.iter().zip(&arms)) {
        chain(&mut joints, Some(0), &rig.leg.replace('#', side), leg);
        chain(&mut joints, Some(chest), &rig.arm.replace('#', side), &arm[collar..]);
    }
    joints
}

/// Knuth's linear congruential generator (MMIX).
struct Random(u64);

impl Random {
    /// A number from 0 to 1.
    fn part(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[(self.part() * of.len() as f64) as usize]
    }
}

/// Channels of the joints below the root.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Channels {
    Rotations,
    Translations,
    ZeroTranslations,
}

/// How a clip is written.
#[derive(Clone, Debug)]
struct Clip {
    rig: usize,
    channels: Channels,
    /// Text before and after every name.
    around: [&'static str; 2],
    /// Order of the rotations.
    order: [usize; 3],
    rotations_first: bool,
    /// Rows: the file's axes in the frame with x left, y up, z forward.
    axes: Matrix,
    /// Units of the file in a metre.
    per_metre: f64,
    /// Seed of the movement, of the order of children, and the first frame of the movement.
    seed: u64,
    shuffled: bool,
    begin: usize,
    frames: usize,
    period_s: f64,
    number: fn(f64) -> String,
    /// A joint above the hips, end sites.
    above: bool,
    ends: bool,
}

const Y_UP: Matrix = reader::IDENTITY;
const Z_UP: Matrix = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const Y_DOWN: Matrix = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
const X_UP: Matrix = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];

fn six_digits(x: f64) -> String {
    format!("{x:.6}")
}

const PLAIN: Clip = Clip {
    rig: 0,
    channels: Channels::Rotations,
    around: ["", ""],
    order: [2, 0, 1],
    rotations_first: false,
    axes: Y_UP,
    per_metre: 100.0,
    seed: 1,
    shuffled: false,
    begin: 5,
    frames: 24,
    period_s: 0.033_333,
    number: six_digits,
    above: false,
    ends: true,
};

impl Clip {
    fn named(&self, name: &str) -> String {
        format!("{}{name}{}", self.around[0], self.around[1])
    }

    /// Angles of a joint about the axes of its channels, degrees. They never reach those of a rest pose, and legs stay those of
    /// a person who stands.
    fn angles(&self, joint: &Joint, i: usize, frame: usize) -> [f64; 3] {
        let reach = match joint.smpl {
            Some(LeftShoulder | RightShoulder | LeftElbow | RightElbow | LeftWrist | RightWrist) => 65.0,
            Some(Head | Neck) => 25.0,
            _ => 5.0,
        };
        std::array::from_fn(|axis| {
            let mut random = Random(self.seed.wrapping_mul(7919) ^ (i * 3 + axis) as u64);
            (0..4).for_each(|_| _ = random.part());
            let (speed, phase) = (1.0 + 2.0 * random.part(), 6.3 * random.part());
            let at_s = (self.begin + frame) as f64 * self.period_s;
            reach * (speed * at_s + phase).sin() + 0.5
        })
    }

    fn text(&self, rig: &Rig) -> String {
        let joints = joints(rig);
        let mut text = String::from("HIERARCHY\n");
        let mut lines = vec![String::new(); self.frames];
        if self.above {
            let name = self.named("Origin");
            let _ = write!(text, "ROOT {name}\n{{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n");
            lines.iter_mut().for_each(|line| line.push_str("0 0 0 "));
        }
        self.joint(&joints, 0, 0, &mut text, &mut lines);
        text.push_str(if self.above { "}\n" } else { "" });
        let _ = write!(text, "MOTION\nFrames: {}\nFrame Time: {}\n", self.frames, self.period_s);
        lines.iter().for_each(|line| text = std::mem::take(&mut text) + line + "\n");
        text
    }

    /// Names or values of a joint's channels, in the file's order.
    fn channels_of(&self, moves: bool, positions: &str, rotations: &str) -> String {
        match (moves, self.rotations_first) {
            (false, _) => rotations.to_owned(),
            (true, false) => format!("{positions} {rotations}"),
            (true, true) => format!("{rotations} {positions}"),
        }
    }

    fn joint(&self, joints: &[Joint], i: usize, depth: usize, text: &mut String, lines: &mut [String]) {
        let joint = &joints[i];
        let parent = joint.parent.map_or([0.0; 3], |parent| joints[parent].at);
        let offset = std::array::from_fn(|axis| (joint.at[axis] - parent[axis]) * self.per_metre);
        let offset = apply(&self.axes, offset).map(|x| (self.number)(x)).join(" ");
        let moves = joint.parent.is_none() || self.channels != Channels::Rotations;
        let [positions, rotations] = [[0, 1, 2], self.order].map(|order| order.map(|axis| ["X", "Y", "Z"][axis]));
        let positions = positions.map(|axis| format!("{axis}position")).join(" ");
        let rotations = rotations.map(|axis| format!("{axis}rotation")).join(" ");
        let channels = format!("{} {}", if moves { 6 } else { 3 }, self.channels_of(moves, &positions, &rotations));
        let kind = if joint.parent.is_none() && !self.above { "ROOT" } else { "JOINT" };
        let (tab, name) = ("\t".repeat(depth), self.named(&joint.name));
        let _ = write!(text, "{tab}{kind} {name}\n{tab}{{\n{tab}\tOFFSET {offset}\n{tab}\tCHANNELS {channels}\n");
        for (frame, line) in lines.iter_mut().enumerate() {
            let relative = joint.parent.is_some() && self.channels == Channels::ZeroTranslations;
            let place = if relative { [0.0; 3].map(|x| (self.number)(x)).join(" ") } else { offset.clone() };
            let turns = self.angles(joint, i, frame).map(|x| (self.number)(x)).join(" ");
            let _ = write!(line, "{} ", self.channels_of(moves, &place, &turns));
        }
        let mut children: Vec<usize> = (0..joints.len()).filter(|&c| joints[c].parent == Some(i)).collect();
        if self.shuffled {
            let mut random = Random(self.seed ^ i as u64);
            (1..children.len()).for_each(|n| children.swap(n, (random.part() * (n + 1) as f64) as usize));
        }
        for &child in &children {
            self.joint(joints, child, depth + 1, text, lines);
        }
        if children.is_empty() && self.ends {
            let end = apply(&self.axes, [0.0, 0.0, 0.08 * self.per_metre]).map(|x| (self.number)(x)).join(" ");
            let _ = write!(text, "{tab}\tEnd Site\n{tab}\t{{\n{tab}\t\tOFFSET {end}\n{tab}\t}}\n");
        }
        let _ = writeln!(text, "{tab}}}");
    }

    /// Reads the text as users do, and returns the largest angle between the product and the second reader, degrees.
    fn largest_angle(&self, rig: &Rig, text: &str) -> Result<f64, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("clip.bvh");
        std::fs::write(&path, text).expect("written");
        let read = load(&path).map_err(|error| error.to_string())?;
        let truth = reader::read(text, self.channels == Channels::ZeroTranslations);
        let names = joints(rig);
        let index = |smpl| {
            let joint = names.iter().find(|joint| joint.smpl == Some(smpl)).expect("every rig has it");
            truth.names.iter().position(|name| *name == self.named(&joint.name)).expect("it is in the file")
        };
        let sought = JOINTS.map(index);
        // x forward, y left, z up.
        let turned = |m: &Matrix| std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]));
        let canonical = times(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &turned(&self.axes));
        if read.frames.len() != truth.frames.len() || (read.frame_rate_hz * truth.period_s - 1.0).abs() > 1e-9 {
            return Err(format!("{} frames of {} at {} Hz", read.frames.len(), self.frames, read.frame_rate_hz));
        }
        let angle = |motion: &Motion, n: usize, expected: &[reader::Pose]| {
            let (places, turns) = (motion.frames[n].positions, motion.frames[n].rotations);
            let line = |[a, b]: [usize; 2]| {
                let along = |[from, to]: [[f64; 3]; 2]| std::array::from_fn(|i| to[i] - from[i]);
                let own = [a, b].map(|joint| places[JOINTS[joint] as usize].map(f64::from));
                between(along(own), apply(&canonical, along([a, b].map(|joint| expected[sought[joint]].place))))
            };
            let turn = |joint: usize| {
                apart(&rows(turns[JOINTS[joint] as usize]), &times(&canonical, &expected[sought[joint]].turn))
            };
            let lines = LINES.map(line).into_iter().fold(0.0, f64::max);
            (0..JOINTS.len()).map(turn).fold(lines, f64::max)
        };
        let mut worst = truth.frames.iter().enumerate().map(|(n, frame)| angle(&read, n, frame)).fold(0.0, f64::max);
        // A slow clip is filled up to 60 Hz. Its own frames stay where they were.
        let filled = upsample(&read);
        for (n, frame) in truth.frames.iter().enumerate() {
            let at = n as f64 * filled.frame_rate_hz / read.frame_rate_hz;
            if (at - at.round()).abs() < 1e-6 {
                worst = worst.max(angle(&filled, at.round() as usize, frame));
            }
        }
        Ok(worst)
    }
}

/// Rows of the rotation of a quaternion x y z w.
fn rows(q: [f32; 4]) -> Matrix {
    let [x, y, z, w] = q.map(f64::from);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Checks clips, each with its name and its text. Returns their number.
fn check(clips: impl Iterator<Item = (String, Clip, String)>) -> usize {
    let (rigs, mut refused, mut wrong, mut count, mut worst) = (rigs(), Vec::new(), Vec::new(), 0, 0.0_f64);
    for (name, clip, text) in clips {
        count += 1;
        match clip.largest_angle(&rigs[clip.rig], &text) {
            Err(error) => refused.push(format!("{name}: {error}")),
            Ok(angle) if angle > ZERO_DEG => wrong.push(format!("{name}: {angle:.4} degrees")),
            Ok(angle) => worst = worst.max(angle),
        }
    }
    let (refusals, turned) = (refused.len(), wrong.len());
    println!("{refusals} of {count} refused, {turned} with another angle, the others within {worst:.6} degrees");
    assert!(refused.is_empty() && wrong.is_empty(), "refused:\n{}\nwrong:\n{}", refused.join("\n"), wrong.join("\n"));
    count
}

/// Name of a dialect, what it changes in the clip, and what in the text.
type Dialect = (&'static str, fn(&mut Clip), fn(String) -> String);

/// Changes every word of a text but the joints' names.
fn words(text: &str, change: impl Fn(&str) -> String) -> String {
    let word = |word: &str| if word.contains("mixamorig") { word.to_owned() } else { change(word) };
    text.split_inclusive([' ', '\t', '\n']).map(word).collect()
}

/// Changes the lines of the frames, as one text.
fn frames(text: &str, change: impl Fn(&str) -> String) -> String {
    let end = text.find("Frame Time").map_or(0, |at| at + text[at..].find('\n').unwrap_or(0) + 1);
    text[..end].to_owned() + &change(&text[end..])
}

const SAME: fn(String) -> String = |text| text;
const NONE: fn(&mut Clip) = |_| {};

const DIALECTS: [Dialect; 47] = [
    ("plain", NONE, SAME),
    ("carriage returns", NONE, |text| text.replace('\n', "\r\n")),
    ("carriage returns alone", NONE, |text| text.replace('\n', "\r")),
    ("byte order mark", NONE, |text| format!("\u{feff}{text}")),
    ("blanks instead of tabs", NONE, |text| text.replace('\t', "    ")),
    ("no indent", NONE, |text| text.replace('\t', "")),
    ("blanks at the ends of lines", NONE, |text| text.replace('\n', "  \t\n")),
    ("blank lines", NONE, |text| text.replace('\n', "\n\n")),
    ("blank lines first", NONE, |text| format!("\n \n{text}")),
    ("blank lines last", NONE, |text| text + "\n \n\t\n"),
    ("no line end at the end", NONE, |text| text.trim_end().to_owned()),
    ("tabs between words", NONE, |text| text.replace(' ', "\t")),
    ("brace behind the name", NONE, |text| text.replace('\t', "").replace("\n{", " {")),
    ("lower case", NONE, |text| words(&text, str::to_lowercase)),
    ("upper case", NONE, |text| words(&text, str::to_uppercase)),
    ("End site", NONE, |text| text.replace("End Site", "End site")),
    ("named end sites", NONE, |text| text.replace("End Site", "End Site Tip")),
    ("no end sites", |clip| clip.ends = false, SAME),
    ("end sites without channels", NONE, |text| text.replace(" 8.000000\n", " 8.000000 CHANNELS 0\n")),
    ("exponents", |clip| clip.number = |x| format!("{x:e}"), SAME),
    ("capital exponents", |clip| clip.number = |x| format!("{x:E}"), SAME),
    ("plus signs", |clip| clip.number = |x| format!("{x:+.7}"), SAME),
    ("seventeen digits", |clip| clip.number = |x| format!("{x:.17}"), SAME),
    (
        "no zero before the point",
        |clip| clip.number = |x| six_digits(x).replacen("0.", ".", usize::from(x.abs() < 1.0)),
        SAME,
    ),
    ("decimal commas", |clip| clip.number = |x| six_digits(x).replace('.', ","), |text| text.replace("0.03", "0,03")),
    ("tabs after the colons", NONE, |text| text.replace(": ", ":\t")),
    ("no blanks after the colons", NONE, |text| text.replace(": ", ":")),
    ("blanks before the colons", NONE, |text| text.replace(": ", " : ")),
    ("a number on each line", NONE, |text| frames(&text, |lines| lines.replace(' ', "\n"))),
    ("all frames on one line", NONE, |text| frames(&text, |lines| lines.replace('\n', " "))),
    ("rotations before positions", |clip| clip.rotations_first = true, SAME),
    ("XYZ", |clip| clip.order = [0, 1, 2], SAME),
    ("XZY", |clip| clip.order = [0, 2, 1], SAME),
    ("YXZ", |clip| clip.order = [1, 0, 2], SAME),
    ("YZX", |clip| clip.order = [1, 2, 0], SAME),
    ("ZYX", |clip| clip.order = [2, 1, 0], SAME),
    ("metres", |clip| clip.per_metre = 1.0, SAME),
    ("millimetres", |clip| clip.per_metre = 1000.0, SAME),
    ("inches", |clip| clip.per_metre = 1.0 / 0.0254, SAME),
    ("units of CMU", |clip| clip.per_metre = 1.0 / 0.056_444, SAME),
    ("no known unit", |clip| clip.per_metre = 7.0, SAME),
    ("z up", |clip| clip.axes = Z_UP, SAME),
    ("y down", |clip| clip.axes = Y_DOWN, SAME),
    ("x up", |clip| clip.axes = X_UP, SAME),
    ("a joint above the hips", |clip| clip.above = true, SAME),
    ("long names", |clip| clip.around = ["A_person_with_a_long_name_and_a_take_of_number_0001_", "_bind"], SAME),
    ("children in another order", |clip| clip.shuffled = true, SAME),
];

#[test]
fn no_dialect_is_refused_or_changes_an_angle() {
    let rigs = rigs();
    let written = DIALECTS.map(|(name, change, edit)| {
        let mut clip = PLAIN;
        change(&mut clip);
        let text = edit(clip.text(&rigs[clip.rig]));
        (name.to_owned(), clip, text)
    });
    assert!(check(written.into_iter()) >= 40);
}

#[test]
fn book_lists_every_dialect_and_naming_scheme() {
    let book = include_str!("../../../docs/src/motion-files.md").replace('\n', " ");
    let lists =
        [DIALECTS.map(|row| row.0).join(", "), rigs().iter().map(|rig| rig.name).collect::<Vec<_>>().join("; ")];
    lists.iter().for_each(|list| assert!(book.contains(list), "write this in motion-files.md: {list}"));
}

/// Every rig with every kind of channels, cut and written at random. `TELEOPD_CLIPS=5000` tries more.
#[test]
fn random_cuts_names_orders_and_rates_keep_every_angle() {
    let count = std::env::var("TELEOPD_CLIPS").map_or(200_u64, |count| count.parse().expect("a count"));
    let rigs = rigs();
    let clips = (0..count).map(|seed| {
        let mut random = Random(seed);
        (0..4).for_each(|_| _ = random.part());
        let clip = Clip {
            rig: seed as usize % rigs.len(),
            channels: [Channels::Rotations, Channels::Translations, Channels::ZeroTranslations]
                [seed as usize / rigs.len() % 3],
            around: [
                random.one(&["", "", "Bob:", "Subject_7_", "x-", "Actor1/", "The Person "]),
                random.one(&["", "", "_jnt", ".001", "_bind"]),
            ],
            order: random.one(&[[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]]),
            rotations_first: random.part() < 0.3,
            axes: random.one(&[Y_UP, Y_UP, Z_UP, Y_DOWN, X_UP]),
            per_metre: random.one(&[1.0, 100.0, 1000.0, 1.0 / 0.0254, 7.0]),
            seed: seed.wrapping_add(1),
            shuffled: random.part() < 0.5,
            begin: (random.part() * 500.0) as usize,
            frames: 12 + (random.part() * 40.0) as usize,
            period_s: random.one(&[0.1, 0.05, 0.04, 0.041_666_7, 0.033_333, 0.02, 0.016_667, 0.008_333, 0.002]),
            number: random.one(&[six_digits, |x| format!("{x:e}"), |x| format!("{x:+.9}")]),
            above: random.part() < 0.2,
            ends: random.part() < 0.8,
        };
        let text = clip.text(&rigs[clip.rig]);
        (format!("{seed}, {}, {clip:?}", rigs[clip.rig].name), clip, text)
    });
    assert_eq!(check(clips), count as usize);
}
