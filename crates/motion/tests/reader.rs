//! A second reader of BVH, for tests: the file's text in, every joint's pose out. It shares no code with the product, not even
//! a library of matrices, and it guesses nothing: what a file leaves open is given.

/// Rows of a rotation.
pub type Matrix = [[f64; 3]; 3];

pub const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Pose of a joint in the file's frame and unit.
#[derive(Clone, Copy)]
pub struct Pose {
    pub place: [f64; 3],
    pub turn: Matrix,
}

pub struct Clip {
    pub names: Vec<String>,
    pub period_s: f64,
    pub frames: Vec<Vec<Pose>>,
}

pub fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

pub fn apply(a: &Matrix, v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

/// Rotation about one axis.
fn about(axis: usize, degrees: f64) -> Matrix {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut turn = IDENTITY;
    (turn[b][b], turn[b][c], turn[c][b], turn[c][c]) = (cos, -sin, sin, cos);
    turn
}

/// Angle between two directions, degrees.
pub fn between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot: f64 = (0..3).map(|i| a[i] * b[i]).sum();
    let cross: [f64; 3] = std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
    cross.iter().map(|x| x * x).sum::<f64>().sqrt().atan2(dot).to_degrees()
}

/// Largest angle between the axes of two rotations, degrees.
pub fn apart(a: &Matrix, b: &Matrix) -> f64 {
    let column = |m: &Matrix, j: usize| std::array::from_fn(|i| m[i][j]);
    (0..3).map(|j| between(column(a, j), column(b, j))).fold(0.0, f64::max)
}

fn number(word: &str) -> f64 {
    word.replace(',', ".").parse().unwrap_or_else(|_| panic!("{word} is no number"))
}

struct Joint {
    parent: Option<usize>,
    offset: [f64; 3],
    channels: Vec<String>,
}

/// Reads a file. With `adds` the positions of joints below the root are relative to their offsets.
pub fn read(text: &str, adds: bool) -> Clip {
    let mut words = text.trim_start_matches('\u{feff}').split_whitespace();
    let (mut joints, mut names, mut open): (Vec<Joint>, Vec<String>, Vec<usize>) = Default::default();
    while let Some(word) = words.next() {
        match word.to_ascii_lowercase().as_str() {
            "root" | "joint" | "end" => {
                let name: Vec<&str> = words.by_ref().take_while(|word| *word != "{").collect();
                let parent = open.last().copied();
                open.push(joints.len());
                names.push(name.join(" "));
                joints.push(Joint { parent, offset: [0.0; 3], channels: Vec::new() });
            }
            "offset" => joints[open[open.len() - 1]].offset = std::array::from_fn(|_| number(words.next().unwrap())),
            "channels" => {
                let count = words.next().unwrap().parse().unwrap();
                let channels = words.by_ref().take(count).map(str::to_ascii_lowercase).collect();
                joints[open[open.len() - 1]].channels = channels;
            }
            "}" => drop(open.pop()),
            "motion" => break,
            _ => {}
        }
    }
    // The two numbers of the header, with or without a space before them.
    let mut header = words.by_ref().filter_map(|word| {
        let digits = word.trim_start_matches(|c: char| c.is_alphabetic() || c == ':');
        (!digits.is_empty()).then(|| number(digits))
    });
    let [count, period_s] = std::array::from_fn(|_| header.next().expect("a header"));
    let mut frames = Vec::new();
    for _ in 0..count as usize {
        let mut poses: Vec<Pose> = Vec::new();
        for joint in &joints {
            let (mut place, mut turn) = (joint.offset, IDENTITY);
            for channel in &joint.channels {
                let value = number(words.next().expect("a number"));
                let axis = usize::from(channel.as_bytes()[0] - b'x');
                match channel.ends_with("position") {
                    true if adds && joint.parent.is_some() => place[axis] += value,
                    true => place[axis] = value,
                    false => turn = times(&turn, &about(axis, value)),
                }
            }
            if let Some(parent) = joint.parent.map(|parent| poses[parent]) {
                let offset = apply(&parent.turn, place);
                place = std::array::from_fn(|i| parent.place[i] + offset[i]);
                turn = times(&parent.turn, &turn);
            }
            poses.push(Pose { place, turn });
        }
        frames.push(poses);
    }
    assert_eq!(words.next(), None, "nothing follows the frames");
    Clip { names, period_s, frames }
}
