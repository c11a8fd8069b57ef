//! Two stick figures for a terminal, drawn with Braille dots: the person and the robot, seen from the front.

use messages::{JOINTS, LEFT_ARM, RIGHT_ARM, SMPL_JOINTS, SMPL_PARENT, Smpl};

/// Columns of one figure, in characters.
pub const COLUMNS: usize = 36;
/// Rows of one figure, in characters.
pub const ROWS: usize = 16;

/// A grid of Braille dots: two across and four down in each character.
pub struct Canvas {
    cells: [[u8; COLUMNS]; ROWS],
}

/// Bit of each dot of a Braille character, by row and column (Unicode 16.0, block U+2800).
const DOTS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

impl Canvas {
    fn new() -> Self {
        Self { cells: [[0; COLUMNS]; ROWS] }
    }

    fn dot(&mut self, x: f64, y: f64) {
        if x < 0.0 || y < 0.0 {
            return;
        }
        let (column, row) = (x as usize, y as usize);
        if column < COLUMNS * 2 && row < ROWS * 4 {
            self.cells[row / 4][column / 2] |= DOTS[row % 4][column % 2];
        }
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2]) {
        let length = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).min(1000.0);
        let steps = length.ceil().max(1.0) as usize;
        for step in 0..=steps {
            let t = step as f64 / steps as f64;
            self.dot(from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]));
        }
    }

    /// The rows as text, each `COLUMNS` characters wide.
    pub fn rows(&self) -> impl Iterator<Item = String> {
        self.cells.iter().map(|row| row.iter().map(|&bits| char::from(bits)).map(braille).collect())
    }
}

fn braille(bits: char) -> char {
    char::from_u32(0x2800 + bits as u32).unwrap_or(' ')
}

/// Seen from the front: the figure's left is on the right; metres to dots, with the feet (or the floor) at the bottom.
fn project(point: [f64; 3], centre: [f64; 2], floor: f64) -> [f64; 2] {
    // 2.1 m of height fill the canvas, arms up included; a dot is as wide as it is high.
    let dots_per_m = (ROWS * 4) as f64 / 2.1;
    let across = point[1] - centre[1];
    [COLUMNS as f64 + across * dots_per_m, (ROWS * 4) as f64 - 1.0 - (point[2] - floor) * dots_per_m]
}

/// The person. `positions`: SMPL-22 in metres, z up, any heading.
pub fn human(positions: &[[f32; 3]; SMPL_JOINTS]) -> Canvas {
    let mut canvas = Canvas::new();
    let at = |joint: Smpl| positions[joint as usize].map(f64::from);
    let (left, right) = (at(Smpl::LeftHip), at(Smpl::RightHip));
    let heading = (right[0] - left[0]).atan2(left[1] - right[1]);
    let pelvis = at(Smpl::Pelvis);
    let floor = pelvis[2] - 0.98;
    let turned = |joint: usize| {
        let p = positions[joint].map(f64::from);
        let (dx, dy) = (p[0] - pelvis[0], p[1] - pelvis[1]);
        let (sin, cos) = heading.sin_cos();
        [cos * dx + sin * dy, -sin * dx + cos * dy, p[2]]
    };
    for (joint, &parent) in SMPL_PARENT.iter().enumerate().skip(1) {
        let (from, to) = (turned(parent), turned(joint));
        canvas.line(project(from, [0.0; 2], floor), project(to, [0.0; 2], floor));
    }
    head(&mut canvas, project(turned(Smpl::Head as usize), [0.0; 2], floor));
    canvas
}

/// The robot. `model` and its joint positions `q`, drawn through the origins of its moving bodies.
pub fn robot(model: &robot::Model, frames: &mut robot::Frames, q: &[f64; JOINTS]) -> Canvas {
    let mut canvas = Canvas::new();
    model.forward(q, frames);
    let body = |joint: usize| {
        let t = frames.base_from_body[joint + 1].t;
        project([t.x, t.y, t.z], [0.0; 2], 0.0)
    };
    let torso = body(0);
    for arm in [LEFT_ARM, RIGHT_ARM] {
        let mut last = torso;
        for joint in arm {
            let next = body(joint);
            canvas.line(last, next);
            last = next;
        }
    }
    let base = project([0.0; 3], [0.0; 2], 0.0);
    canvas.line(torso, base);
    canvas.line([base[0] - 8.0, base[1]], [base[0] + 8.0, base[1]]);
    canvas.line(torso, body(2));
    head(&mut canvas, body(2));
    canvas
}

fn head(canvas: &mut Canvas, centre: [f64; 2]) {
    for step in 0..16 {
        let (sin, cos) = (f64::from(step) * core::f64::consts::TAU / 16.0).sin_cos();
        canvas.dot(centre[0] + 3.0 * cos, centre[1] - 2.0 + 3.0 * sin);
    }
}
