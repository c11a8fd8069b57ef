//! Stick figures: the human, and the robot's arms on the same shoulders.

use crate::clips::Human;
use crate::methods::Posture;
use messages::{SMPL_JOINTS, Smpl};
use motion::SMPL_ARMS;
use nalgebra::{Matrix3, Vector3};
use plotters::prelude::*;
use retarget::{ArmModel, Limbs};
use skeleton::torso_rotation;

/// View of the upper bodies: from the front, 30 degrees to their left and 12 degrees from above.
const AZIMUTH_RAD: f64 = 0.52;
const ELEVATION_RAD: f64 = 0.21;
/// Colours of the left arm, of the right arm, of the rest, and of a robot's rest.
const LEFT: RGBColor = RGBColor(200, 40, 60);
const RIGHT: RGBColor = RGBColor(40, 90, 200);
const BODY: RGBColor = RGBColor(90, 90, 90);
const ROBOT: RGBColor = RGBColor(190, 130, 40);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureKind {
    Human,
    Robot,
}

pub fn limbs_of(arm: &ArmModel, posture: &Posture) -> Human {
    posture.each_ref().map(|q| arm.forward(q))
}

/// Returns a person's joints (m) with elbows and wrists moved to these limbs. Bones keep their lengths. The
/// joints are unchanged if the torso has no direction.
pub fn with_limbs(positions: &[[f32; 3]; SMPL_JOINTS], limbs: &Human) -> [[f32; 3]; SMPL_JOINTS] {
    let mut out = *positions;
    let Some(torso) = torso_rotation(positions) else { return out };
    for (side, [shoulder, elbow, wrist]) in
        SMPL_ARMS.map(|chain| chain.map(|joint| joint as usize)).into_iter().enumerate()
    {
        let Limbs { upper, fore } = limbs[side];
        let mut from = point(positions, shoulder);
        for (rotation, start, end) in [(upper, shoulder, elbow), (fore, elbow, wrist)] {
            let length = (point(positions, end) - point(positions, start)).norm();
            let mut bone = rotation * Vector3::y() * length;
            if side == 1 {
                bone.y = -bone.y;
            }
            from += torso * bone;
            out[end] = from.cast::<f32>().into();
        }
    }
    out
}

fn point(positions: &[[f32; 3]; SMPL_JOINTS], joint: usize) -> Vector3<f64> {
    Vector3::from(positions[joint]).cast()
}

pub type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
pub type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Draws the upper body into the middle of `area`. It faces the viewer for any heading of the torso.
pub fn draw(area: &Area<'_>, positions: &[[f32; 3]; SMPL_JOINTS], who: FigureKind) -> Drawn {
    let torso = torso_rotation(positions).unwrap_or_else(Matrix3::identity);
    let (width, height) = area.dim_in_pixel();
    let scale = f64::from(width.min(height)) * 0.62;
    let middle = (point(positions, Smpl::LeftShoulder as usize) + point(positions, Smpl::RightShoulder as usize)) / 2.0;
    let at = |joint: Smpl| screen(&torso.tr_mul(&(point(positions, joint as usize) - middle)), scale, width, height);
    let body = if who == FigureKind::Robot { ROBOT } else { BODY };
    let trunk = [Smpl::Pelvis, Smpl::Spine3, Smpl::Neck, Smpl::Head].map(at);
    let shoulders = [Smpl::LeftShoulder, Smpl::Neck, Smpl::RightShoulder].map(at);
    area.draw(&PathElement::new(trunk, body.stroke_width(4)))?;
    area.draw(&PathElement::new(shoulders, body.stroke_width(4)))?;
    let head = at(Smpl::Head);
    let radius = (0.1 * scale) as i32;
    match who {
        FigureKind::Human => area.draw(&Circle::new((head.0, head.1 - radius), radius, body.stroke_width(2)))?,
        FigureKind::Robot => {
            let corners = [(head.0 - radius, head.1 - 2 * radius), (head.0 + radius, head.1)];
            area.draw(&Rectangle::new(corners, body.stroke_width(2)))?;
        }
    }
    for (joints, colour) in SMPL_ARMS.into_iter().zip([LEFT, RIGHT]) {
        let points = joints.map(at);
        area.draw(&PathElement::new(points, colour.stroke_width(4)))?;
        for joint in points {
            area.draw(&Circle::new(joint, 4, colour.filled()))?;
        }
    }
    Ok(())
}

/// Returns the pixels of a point in the torso frame, m from the middle between the shoulders.
fn screen(p: &Vector3<f64>, scale: f64, width: u32, height: u32) -> (i32, i32) {
    let (sin, cos) = AZIMUTH_RAD.sin_cos();
    // The viewer faces the person, so the person's left is on the right.
    let (across, toward) = (p.y * cos - p.x * sin, p.x * cos + p.y * sin);
    let (sin, cos) = ELEVATION_RAD.sin_cos();
    let up = p.z * cos - toward * sin;
    let x = f64::from(width) * 0.5 + across * scale;
    let y = f64::from(height) * 0.46 - up * scale;
    (x as i32, y as i32)
}
