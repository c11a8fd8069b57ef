//! Two stick figures for a terminal, drawn with Braille dots. They show the person and the robot on their floor,
//! from the front.

use messages::{JOINTS_MAX, SMPL_JOINTS, SMPL_PARENT, Smpl};

/// Columns of one figure, in characters. Two figures and a gap fit a terminal 80 columns wide.
pub const COLUMNS: usize = 38;
/// Rows of one figure, in characters. With the floor and the live line they fit a terminal of 24 rows.
pub const ROWS: usize = 20;
/// Gap between the two figures.
const GAP: &str = "  ";
/// Columns and rows of the whole picture, including the live line and the line of the cursor.
pub const SIZE: (usize, usize) = (2 * COLUMNS + GAP.len(), ROWS + 3);

/// Height that fills the canvas, m: a person with the hands above the head.
const HEIGHT_M: f64 = 2.15;
/// Distance from the wrist to the knuckles, m (Winter, Biomechanics, fig. 4.1: half of 0.108 of 1.75 m).
const HAND_M: f64 = 0.095;
/// Plausible height of the hips above the feet, m: from a squatting person to one 2 m tall who stands. Outside
/// this range the foot positions are not used.
const HIPS_M: std::ops::Range<f64> = 0.3..1.25;
/// Height of the hips above the floor if the foot positions are implausible, m.
const STANDING_HIPS_M: f64 = 0.98;
/// A capsule of the base whose lowest point is below this height stands on the floor, m.
const BASE_M: f64 = 0.1;
/// The torso has a head if it reaches higher than this above the shoulders, m.
const NECK_M: f64 = 0.1;

/// Colours of SGR, ISO 6429: cyan, yellow, and dim for the floor.
const PERSON: &str = "\x1b[36m";
const ROBOT: &str = "\x1b[33m";
const FLOOR: &str = "\x1b[2m";
const PLAIN: &str = "\x1b[0m";

/// A grid of Braille dots. Each character has two dots across and four down.
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

    /// Draws a square of dots: a hand.
    fn blob(&mut self, [x, y]: [f64; 2]) {
        for across in -1..=1 {
            self.line([x + f64::from(across), y - 1.0], [x + f64::from(across), y + 1.0]);
        }
    }

    fn head(&mut self, [x, y]: [f64; 2]) {
        for step in 0..16 {
            let (sin, cos) = (f64::from(step) * core::f64::consts::TAU / 16.0).sin_cos();
            self.dot(x + 3.0 * cos, y - 2.0 + 3.0 * sin);
        }
    }

    fn rows(&self) -> impl Iterator<Item = String> {
        let braille = |&bits: &u8| char::from_u32(0x2800 + u32::from(bits)).unwrap_or(' ');
        self.cells.iter().map(move |row| row.iter().map(braille).collect())
    }
}

/// Dots per metre. A dot is as wide as it is high.
const DOTS_PER_M: f64 = (ROWS * 4) as f64 / HEIGHT_M;

/// Projects a point as seen from the front: the figure's left is on the right. `up_m` is the height above the
/// floor. The floor is at the lowest dots.
fn project(left_m: f64, up_m: f64) -> [f64; 2] {
    [COLUMNS as f64 + left_m * DOTS_PER_M, (ROWS * 4) as f64 - 1.0 - up_m * DOTS_PER_M]
}

/// Draws the person. `positions` are SMPL-22 joint positions in metres, z up, with any heading.
pub fn human(positions: &[[f32; 3]; SMPL_JOINTS]) -> Canvas {
    let mut canvas = Canvas::new();
    let at = |joint: Smpl| positions[joint as usize].map(f64::from);
    let (left, right) = (at(Smpl::LeftHip), at(Smpl::RightHip));
    let (sin, cos) = (right[0] - left[0]).atan2(left[1] - right[1]).sin_cos();
    let pelvis = at(Smpl::Pelvis);
    let lowest = [Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot].map(|joint| at(joint)[2]);
    let lowest = lowest.into_iter().fold(f64::INFINITY, f64::min);
    let floor = if HIPS_M.contains(&(pelvis[2] - lowest)) { lowest } else { pelvis[2] - STANDING_HIPS_M };
    let turned = |joint: usize| {
        let p = positions[joint].map(f64::from);
        project(-sin * (p[0] - pelvis[0]) + cos * (p[1] - pelvis[1]), p[2] - floor)
    };
    for (joint, &parent) in SMPL_PARENT.iter().enumerate().skip(1) {
        canvas.line(turned(parent), turned(joint));
    }
    canvas.head(turned(Smpl::Head as usize));
    for (elbow, wrist) in [(Smpl::LeftElbow, Smpl::LeftWrist), (Smpl::RightElbow, Smpl::RightWrist)] {
        let (from, to) = (turned(elbow as usize), turned(wrist as usize));
        // Extends the visible forearm beyond the wrist by the length of a hand.
        let forearm_m = (0..3).map(|axis| (at(wrist)[axis] - at(elbow)[axis]).powi(2)).sum::<f64>().sqrt().max(0.05);
        let hand = [0, 1].map(|axis| to[axis] + (to[axis] - from[axis]) * HAND_M / forearm_m);
        canvas.line(to, hand);
        canvas.blob(hand);
    }
    // The feet point at the viewer, so their tips are drawn apart.
    for (foot, outwards) in [(Smpl::LeftFoot, 1.0), (Smpl::RightFoot, -1.0)] {
        let [x, y] = turned(foot as usize);
        canvas.line([x - outwards, y], [x + 3.0 * outwards, y]);
    }
    canvas
}

/// Draws the robot with `model` at the joint positions `q`: its base, its column, its head if it has one, and lines
/// through the origins of its arms' bodies.
pub fn robot(model: &robot::Model, frames: &mut robot::Frames, q: &[f64; JOINTS_MAX]) -> Canvas {
    let mut canvas = Canvas::new();
    model.forward(q, frames);
    let origin = |body: usize| {
        let t = frames.base_from_body[body].t;
        project(t.y, t.z)
    };
    let body = |joint: usize| origin(joint + 1);
    let shoulders = model.arms.each_ref().map(|arm| frames.base_from_body[arm.range().start + 1].t);
    let chest = (shoulders[0] + shoulders[1]) / 2.0;
    let chest = [chest.y, chest.z];
    let neck = project(chest[0], chest[1]);
    for arm in &model.arms {
        let hand = arm.range().end - 1;
        let mut last = neck;
        for joint in arm.range() {
            let next = body(joint);
            canvas.line(last, next);
            last = next;
        }
        // The point where the hand's collision geometry reaches furthest.
        let ends = model.capsules.iter().filter(|one| one.body == hand + 1).flat_map(|one| [one.a, one.b]);
        let pose = &frames.base_from_body[hand + 1];
        if let Some(tip) = ends.max_by(|a, b| a.norm().total_cmp(&b.norm())) {
            let tip = pose.r * tip + pose.t;
            let tip = project(tip.y, tip.z);
            canvas.line(last, tip);
            canvas.blob(tip);
        }
    }
    let foot = base(&mut canvas, model);
    if model.torso_body > 0 {
        canvas.line(neck, origin(model.torso_body));
        canvas.line(origin(model.torso_body), foot);
    } else {
        canvas.line(neck, foot);
    }
    if let Some(head) = head(model, frames, chest[1]) {
        canvas.line(neck, head);
        canvas.head(head);
    }
    canvas
}

/// Returns the lower end of the head: the last body joint above the torso, or else what the torso carries above the
/// shoulders. `None` if the robot ends at its shoulders.
fn head(model: &robot::Model, frames: &robot::Frames, shoulders_m: f64) -> Option<[f64; 2]> {
    let last = model.body_count;
    if last > model.torso_body {
        let t = frames.base_from_body[last].t;
        return Some(project(t.y, t.z));
    }
    let pose = &frames.base_from_body[model.torso_body];
    let carried = model.capsules.iter().filter(|capsule| capsule.body == model.torso_body);
    let ends = carried.flat_map(|capsule| [capsule.a, capsule.b].map(|end| pose.transform_point(&end)));
    let top = ends.max_by(|a, b| a.z.total_cmp(&b.z)).filter(|top| top.z > shoulders_m + NECK_M)?;
    Some(project(top.y, top.z))
}

/// Draws what never moves: a box around everything that lies on the floor, and a line for each leg or pedestal. Returns
/// the place where the body begins.
fn base(canvas: &mut Canvas, model: &robot::Model) -> [f64; 2] {
    let (mut wide_m, mut high_m, mut top_m) = (0.0_f64, 0.0_f64, 0.0_f64);
    for capsule in model.capsules.iter().filter(|capsule| capsule.body == 0) {
        let (a, b) = if capsule.a.z < capsule.b.z { (capsule.a, capsule.b) } else { (capsule.b, capsule.a) };
        let (low_m, stands) = (a.z - capsule.radius_m, b.z - a.z > (b - a).xy().norm());
        if low_m < BASE_M && !stands {
            wide_m = wide_m.max(a.y.abs().max(b.y.abs()) + capsule.radius_m);
            high_m = high_m.max(b.z + capsule.radius_m);
        } else {
            let foot_m = if low_m < BASE_M { low_m.max(0.0) } else { a.z };
            canvas.line(project(a.y, foot_m), project(b.y, b.z));
            top_m = top_m.max(b.z);
        }
    }
    top_m = top_m.max(high_m);
    let corners = [(-wide_m, 0.0), (-wide_m, high_m), (wide_m, high_m), (wide_m, 0.0)].map(|(y, z)| project(y, z));
    for (i, corner) in corners.iter().enumerate() {
        canvas.line(*corner, corners[(i + 1) % corners.len()]);
    }
    project(0.0, top_m)
}

pub fn picture(human: &Canvas, robot: &Canvas, colour: bool) -> String {
    let painted = |sgr: &str, text: &str| {
        if colour { format!("{sgr}{text}{PLAIN}") } else { text.to_owned() }
    };
    let rows = human.rows().zip(robot.rows());
    let rows = rows.map(|(left, right)| painted(PERSON, &left) + GAP + &painted(ROBOT, &right) + "\n");
    let floor = |name: &str| format!("{name:\u{2500}^COLUMNS$}");
    rows.collect::<String>() + &painted(FLOOR, &(floor(" the person ") + GAP + &floor(" the robot "))) + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn drawn(frame: usize) -> [Canvas; 2] {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
        let model = config::load(&config, config::Overrides::default()).expect("settings").model;
        let home = model.home;
        [human(&motion::builtin().frames[frame].positions), robot(&model, &mut robot::Frames::default(), &home)]
    }

    fn any(canvas: &Canvas, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> bool {
        let dot = |x: usize, y: usize| canvas.cells[y / 4][x / 2] & DOTS[y % 4][x % 2] != 0;
        rows.into_iter().any(|y| columns.clone().any(|x| dot(x, y)))
    }

    #[test]
    fn person_stands_on_floor_and_has_hands() {
        let [person, _] = drawn(0);
        let last = ROWS * 4 - 1;
        assert!(any(&person, 0..COLUMNS, last..last + 1), "right foot");
        assert!(any(&person, COLUMNS..2 * COLUMNS, last..last + 1), "left foot");
        // In a T-pose the hand is 0.184 + 0.326 + 0.256 + 0.095 m from the middle. It is three dots high.
        let hand = COLUMNS + (0.861 * DOTS_PER_M) as usize;
        let rows = (0..ROWS * 4).filter(|&y| any(&person, hand - 1..hand + 2, y..y + 1)).count();
        assert!((3..=4).contains(&rows), "{rows} rows of dots at the hand");
        assert!(!any(&person, 0..2 * COLUMNS, 0..4), "nothing is above the head");
    }

    /// Two of them have no head, two have a lift, two stand on legs.
    #[test]
    fn figure_of_every_shipped_robot_has_hands_and_stands() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
        for (name, has_head, high_m) in [
            ("tiago_dual", true, 1.0..1.6),
            ("unitree_g1", true, 1.0..1.5),
            ("rby1a", true, 1.0..1.8),
            ("openarm_v10", false, 0.6..1.0),
            ("unitree_h1", true, 1.7..2.0),
            ("franka_fr3_duo", false, 1.2..1.7),
        ] {
            let overrides = config::Overrides::robot(Some(&name.into()));
            let (_, model) = config::load_robot(&config, &overrides).unwrap_or_else(|error| panic!("{error}"));
            let mut frames = robot::Frames::default();
            let canvas = robot(&model, &mut frames, &model.t_pose());
            println!("{}", picture(&human(&motion::builtin().frames[0].positions), &canvas, false));
            let rows = ROWS * 4;
            assert!(any(&canvas, 0..2 * COLUMNS, rows - 2..rows), "{name} stands on the floor");
            let top = (0..rows).find(|&y| any(&canvas, COLUMNS - 4..COLUMNS + 4, y..y + 1)).expect("a body");
            let top_m = (rows - top) as f64 / DOTS_PER_M;
            assert!(high_m.contains(&top_m), "{name} is {top_m} m high");
            let shoulders_m = frames.base_from_body[model.arms[0].range().start + 1].t.z;
            assert_eq!(head(&model, &frames, shoulders_m).is_some(), has_head, "{name}");
            let hand = frames.base_from_body[model.arms[0].hand_body()].t;
            let [x, y] = project(hand.y, hand.z).map(|at| at as usize);
            // Long arms reach beyond the canvas.
            let inside = x + 3 < 2 * COLUMNS;
            assert!(!inside || any(&canvas, x - 2..x + 3, y - 2..y + 3), "{name}: a hand at {x}, {y}");
        }
    }

    #[test]
    fn picture_fits_80_columns_and_is_coloured_on_request() {
        let [person, robot] = drawn(700);
        let plain = picture(&person, &robot, false);
        assert_eq!(plain.lines().count() + 2, SIZE.1);
        assert!(SIZE.0 <= 80 && SIZE.1 < 24, "{SIZE:?}");
        assert!(plain.lines().all(|line| line.chars().count() == SIZE.0), "{plain}");
        assert!(plain.lines().last().is_some_and(|floor| floor.contains("\u{2500} the person \u{2500}")), "{plain}");
        assert!(!plain.contains('\x1b'));
        let coloured = picture(&person, &robot, true);
        assert!(coloured.contains(PERSON) && coloured.contains(ROBOT) && coloured.contains(FLOOR));
        let stripped = [PERSON, ROBOT, FLOOR, PLAIN].iter().fold(coloured, |text, sgr| text.replace(sgr, ""));
        assert_eq!(stripped, plain);
    }

    #[test]
    fn person_with_implausible_feet_is_drawn_by_hips() {
        let mut positions = motion::builtin().frames[0].positions;
        for joint in [Smpl::LeftAnkle, Smpl::RightAnkle, Smpl::LeftFoot, Smpl::RightFoot] {
            positions[joint as usize][2] = -7.0;
        }
        let hips = ROWS * 4 - (STANDING_HIPS_M * DOTS_PER_M) as usize;
        assert!(any(&human(&positions), COLUMNS - 4..COLUMNS + 4, hips - 2..hips + 2));
        positions.iter_mut().flatten().for_each(|value| *value = f32::NAN);
        human(&positions);
    }
}
