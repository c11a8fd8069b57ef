//! Draws a person before a random camera, with a landmarker's errors, and the directions that the network shall find.

use super::people::{Body, Pairs, People};
use crate::sampling::normal;
use layouts::{DIRECTIONS, ImagePoints, LENGTHS, LIFTER_INPUTS, POINTS, Point};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Share of the arms that come from another person's frame.
const GRAFT_SHARE: f64 = 0.35;
/// Standard deviation of the turn of an arm and of a forearm, and the share of those that turn.
const TURN_DEG: f64 = 12.0;
const TURN_SHARE: f64 = 0.6;
/// Standard deviation of a body's proportions.
const PROPORTION: f64 = 0.1;
/// Share of the people who look at the camera, and the standard deviation of their turn, rad. Others are turned anyhow.
const FACING_SHARE: f64 = 0.65;
const FACING_RAD: f64 = 0.7;
/// Ranges of the camera's pitch and angle of view, degrees, and its distance, m. Standard deviation of its roll.
const PITCH_DEG: [f64; 2] = [-20.0, 25.0];
const VIEW_DEG: [f64; 2] = [45.0, 75.0];
const DISTANCE_M: [f64; 2] = [1.5, 5.0];
const ROLL_DEG: f64 = 3.0;
/// Depth at which a point still projects, m.
const DEPTH_MIN_M: f64 = 0.3;
/// Error of the lengths that a landmarker's session shows (standard deviation of its median over clips: 0.10 and 0.12), and the share of the images whose lengths are known.
const LENGTH_ERROR: f64 = 0.1;
const LENGTH_SHARE: f64 = 0.7;
/// Share of the images whose landmarker has no hands and no feet, as COCO's 17 points.
const FEW_POINTS_SHARE: f64 = 0.25;
/// How much of the formula's errors comes on top of real ones: people differ more than the images do.
const FORMULA_BESIDE_REAL: f64 = 0.35;
/// Shoulders are found higher than the joints, as a share of the trunk.
const SHOULDERS_HIGH: f64 = 0.065;
/// Half the breadth of an image, in its heights: 4 to 3.
const HALF_BREADTH: f64 = 0.667;

/// One image for the network.
#[derive(Clone, Debug)]
pub struct View {
    pub inputs: [f32; LIFTER_INPUTS],
    pub directions: [Vector3<f64>; DIRECTIONS],
}

/// Columns: the trunk's across, up, ahead.
fn trunk(body: &Body) -> Matrix3<f64> {
    let at = |point: Point| body[point as usize];
    let shoulders = at(Point::LeftShoulder) + at(Point::RightShoulder);
    let up = (shoulders - at(Point::LeftHip) - at(Point::RightHip)).normalize();
    let across = at(Point::LeftShoulder) - at(Point::RightShoulder);
    let across = (across - up * across.dot(&up)).normalize();
    Matrix3::from_columns(&[across, up, across.cross(&up)])
}

/// Returns the true directions of a body in the camera's axes, as `layouts::Lifted` has them.
pub fn directions(body: &Body) -> [Vector3<f64>; DIRECTIONS] {
    let axes = trunk(body);
    let limb = |from: usize, to: usize| axes.transpose() * (body[to] - body[from]).normalize();
    let hand = |side: usize| {
        let knuckles = (body[Point::LeftPinky as usize + side] + body[Point::LeftIndex as usize + side]) / 2.0;
        axes.transpose() * (knuckles - body[Point::LeftWrist as usize + side]).normalize()
    };
    [limb(5, 7), limb(6, 8), limb(7, 9), limb(8, 10), hand(0), hand(1), axes.column(0).into(), axes.column(1).into()]
}

/// Lengths of upper arm and forearm over the trunk's.
pub fn lengths(body: &Body) -> [f64; LENGTHS] {
    let long = |a: usize, b: usize| (body[a] - body[b]).norm();
    let trunk = (body[5] + body[6] - body[17] - body[18]).norm() / 2.0;
    [long(5, 7) + long(6, 8), long(7, 9) + long(8, 10)].map(|it| it / 2.0 / trunk)
}

/// Turn of the shoulders to the camera, rad.
pub fn turned(body: &Body) -> f64 {
    let across = body[Point::LeftShoulder as usize] - body[Point::RightShoulder as usize];
    across.z.atan2(across.x)
}

/// The trunk's size in the image.
fn size(points: &[[f64; 2]; POINTS]) -> f64 {
    let along = [0, 1].map(|i| (points[5][i] + points[6][i] - points[17][i] - points[18][i]) / 2.0);
    let across = (points[5][0] - points[6][0]).hypot(points[5][1] - points[6][1]);
    along[0].hypot(along[1]).max(1.2 * across).max(0.05)
}

fn within(rng: &mut Pcg64, [low, high]: [f64; 2]) -> f64 {
    rng.random_range(low..high)
}

/// A landmarker's errors on images, sorted by the turn of the shoulders.
#[derive(Clone, Debug)]
pub struct Errors {
    /// Turn, errors as shares of the trunk's size, and visibilities.
    rows: Vec<(f64, [[f32; 2]; POINTS], [f32; POINTS])>,
}

impl Errors {
    pub fn new(pairs: &Pairs) -> Self {
        let mut rows = Vec::new();
        for pair in pairs.clips.iter().flat_map(|(_, pairs)| pairs) {
            let size = size(&pair.projected);
            let off = |n: usize| {
                [0, 1].map(|i| {
                    ((f64::from(pair.found.points[n][i]) - pair.projected[n][i]) / size).clamp(-1.5, 1.5) as f32
                })
            };
            let errors = ImagePoints { points: std::array::from_fn(off), seen: pair.found.seen };
            let turn = turned(&pair.truth);
            for (turn, it) in [(turn, errors), (-turn, errors.mirrored())] {
                rows.push((turn, it.points, it.seen));
            }
        }
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { rows }
    }

    /// Draws the errors of an image whose person is turned about as much.
    fn near(&self, turn: f64, rng: &mut Pcg64) -> &(f64, [[f32; 2]; POINTS], [f32; POINTS]) {
        let count = self.rows.len();
        let at = self.rows.partition_point(|row| row.0 < turn) as i64 + (normal(rng) * 0.02 * count as f64) as i64;
        &self.rows[at.rem_euclid(count as i64) as usize]
    }
}

/// Draws one image. The same generator gives the same image.
pub fn draw(people: &People, real: Option<&Errors>, rng: &mut Pcg64) -> View {
    let mut body = people.at(rng.random_range(0.0..1.0));
    graft(&mut body, people, rng);
    proportion(&mut body, rng);
    if rng.random_bool(0.5) {
        body = mirrored(&body);
    }
    let (body, focal) = before_camera(&body, rng);
    let projected = body.map(|p| [0, 1].map(|i| focal * p[i] / p.z.max(DEPTH_MIN_M)));
    let mut image = formula(&body, &projected, if real.is_some() { FORMULA_BESIDE_REAL } else { 1.0 }, rng);
    if let Some(real) = real {
        let (_, errors, seen) = real.near(turned(&body), rng);
        let size = size(&projected) as f32;
        for (point, error) in image.points.iter_mut().zip(errors) {
            point.iter_mut().zip(error).for_each(|(point, error)| *point += error * size);
        }
        if rng.random_bool(0.8) {
            image.seen = *seen;
        }
    }
    if rng.random_bool(FEW_POINTS_SHARE) {
        for point in (Point::LeftPinky as usize..=Point::RightThumb as usize).chain(Point::LeftHeel as usize..POINTS) {
            image.seen[point] = 0.0;
        }
    }
    let known = lengths(&body).map(|it| it * (LENGTH_ERROR * normal(rng)).exp());
    let inputs = image.inputs(rng.random_bool(LENGTH_SHARE).then_some(known)).unwrap_or([0.0; LIFTER_INPUTS]);
    View { inputs, directions: directions(&body) }
}

/// Gives arms of other people, and turns them: postures that nobody recorded.
fn graft(body: &mut Body, people: &People, rng: &mut Pcg64) {
    let other = people.at(rng.random_range(0.0..1.0));
    let change = trunk(body) * trunk(&other).transpose();
    for side in 0..2 {
        let arm = [7, 9, 11, 13, 15].map(|point| point + side);
        let shoulder = 5 + side;
        if rng.random_bool(GRAFT_SHARE) {
            for point in arm {
                body[point] = body[shoulder] + change * (other[point] - other[shoulder]);
            }
        }
        for (centre, moved) in [(shoulder, &arm[..]), (arm[0], &arm[1..])] {
            if rng.random_bool(TURN_SHARE) {
                let axis = Vector3::from_fn(|_, _| normal(rng)) * TURN_DEG.to_radians();
                let turn = Rotation3::from_scaled_axis(axis);
                for &point in moved {
                    body[point] = body[centre] + turn * (body[point] - body[centre]);
                }
            }
        }
    }
}

/// Changes the lengths of shoulders, upper arms, forearms, hips, legs and head.
fn proportion(body: &mut Body, rng: &mut Pcg64) {
    let factors: [f64; 6] = std::array::from_fn(|_| 1.0 + PROPORTION * normal(rng).clamp(-2.0, 2.0));
    let before = *body;
    let (shoulders, hips) = ((before[5] + before[6]) / 2.0, (before[17] + before[18]) / 2.0);
    for point in 0..5 {
        body[point] = shoulders + (before[point] - shoulders) * factors[5];
    }
    for side in 0..2 {
        body[5 + side] = shoulders + (before[5 + side] - shoulders) * factors[0];
        body[7 + side] = body[5 + side] + (before[7 + side] - before[5 + side]) * factors[1];
        body[9 + side] = body[7 + side] + (before[9 + side] - before[7 + side]) * factors[2];
        for point in [11, 13, 15] {
            body[point + side] = body[9 + side] + before[point + side] - before[9 + side];
        }
        body[17 + side] = hips + (before[17 + side] - hips) * factors[3];
        for point in [19, 21, 23, 25] {
            body[point + side] = body[17 + side] + (before[point + side] - before[17 + side]) * factors[4];
        }
    }
}

fn mirrored(body: &Body) -> Body {
    std::array::from_fn(|point| {
        let other = body[if point == 0 { 0 } else { ((point - 1) ^ 1) + 1 }];
        Vector3::new(-other.x, other.y, other.z)
    })
}

/// Returns the body in the axes of a random camera, and the camera's focal length in heights of the image.
fn before_camera(body: &Body, rng: &mut Pcg64) -> (Body, f64) {
    let across = body[5] - body[6] + body[17] - body[18];
    let heading = (-across.z).atan2(across.x);
    let turn = if rng.random_bool(FACING_SHARE) { FACING_RAD * normal(rng) } else { within(rng, [-PI, PI]) };
    let pitch = within(rng, PITCH_DEG).to_radians();
    let roll = (ROLL_DEG * normal(rng)).to_radians();
    let far = within(rng, DISTANCE_M);
    let focal = 0.5 / (within(rng, VIEW_DEG).to_radians() / 2.0).tan();
    let facing = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let axes = facing
        * Rotation3::from_axis_angle(&Vector3::z_axis(), roll).matrix()
        * Rotation3::from_axis_angle(&Vector3::x_axis(), pitch).matrix()
        * Rotation3::from_axis_angle(&Vector3::y_axis(), -(turn + heading)).matrix();
    let centre = (body[5] + body[6] + body[17] + body[18]) / 4.0;
    let aside = Vector3::new(0.2 * normal(rng), 0.125 * normal(rng) - 0.1, 0.0) * (far / focal / 2.0);
    (body.map(|p| axes * (p - centre) + aside + Vector3::z() * far), focal)
}

/// Spread of a landmarker's errors as shares of the trunk: face, ears, shoulders, elbows, wrists, hands, hips, legs.
const SPREAD: [f64; 8] = [0.054, 0.07, 0.044, 0.047, 0.057, 0.072, 0.062, 0.052];

fn spread(point: usize) -> f64 {
    SPREAD[match point {
        0..3 => 0,
        3..5 => 1,
        5..7 => 2,
        7..9 => 3,
        9..11 => 4,
        11..17 => 5,
        17..19 => 6,
        _ => 7,
    }]
}

/// Draws errors and visibilities: each point by its spread, shoulders too high, and arms that are guessed as a whole. The far
/// arm of a person who is seen from the side is guessed often.
fn formula(body: &Body, projected: &[[f64; 2]; POINTS], share: f64, rng: &mut Pcg64) -> ImagePoints {
    let size = size(projected);
    let loud = size * share * (0.4 * normal(rng)).exp();
    let side = turned(body).abs().to_degrees();
    let hidden_share = if (55.0..125.0).contains(&side) {
        0.5
    } else if side >= 125.0 {
        0.3
    } else {
        0.08
    };
    let far = usize::from(body[6].z > body[5].z);
    let up = [0, 1].map(|i| (projected[5][i] + projected[6][i] - projected[17][i] - projected[18][i]) / 2.0);
    let mut guess = [[0.0; 2]; POINTS];
    let mut hidden = [false; POINTS];
    for arm in 0..2 {
        let chance = if arm == far || side > 125.0 { hidden_share } else { 0.06 };
        let (elbow, wrist) = (rng.random_bool(chance), rng.random_bool((1.3 * chance).min(1.0)));
        let common = [normal(rng), normal(rng)];
        for (points, is_hidden, wide) in [(&[7][..], elbow, 0.13), (&[9, 11, 13, 15][..], wrist, 0.22)] {
            for point in points.iter().map(|point| point + arm).filter(|_| is_hidden) {
                hidden[point] = true;
                guess[point] = common.map(|common| wide * (0.8 * common + 0.6 * normal(rng)));
            }
        }
    }
    let mut image = ImagePoints::NONE;
    for point in 0..POINTS {
        let gone = projected[point][0].abs() > HALF_BREADTH || projected[point][1].abs() > 0.5;
        let wide = spread(point) + if gone { 0.15 } else { 0.0 };
        let high = if (5..7).contains(&point) { SHOULDERS_HIGH * share } else { 0.0 };
        image.points[point] = [0, 1].map(|i| {
            let error = (wide * normal(rng) + guess[point][i]) * loud + high * up[i];
            (projected[point][i] + error) as f32
        });
        let seen = if hidden[point] || gone { within(rng, [0.01, 0.65]) } else { within(rng, [0.85, 1.0]) };
        image.seen[point] = seen as f32;
    }
    image
}
