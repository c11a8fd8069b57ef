//! The command `collision draw`.

use crate::{parse_all, robot_texts};
use clap::ValueEnum;
use collision::draw::{Cloud, draw as draw_views};
use collision::error::CollisionError;
use collision::scene::Scene;
use robot::Model;
use std::path::{Path, PathBuf};

/// A posture.
#[derive(Clone, Copy, ValueEnum)]
enum Pose {
    /// The robot file's home.
    Home,
    /// Both arms straight out to the sides: the robot file's reference, with the other joints at home.
    Reference,
}

/// Options of `collision draw`.
#[derive(clap::Args)]
pub(crate) struct Draw {
    /// Robot file.
    robot: PathBuf,
    /// URDF with meshes or primitives [default: the URDF of the robot file].
    #[arg(long)]
    urdf: Vec<PathBuf>,
    /// Folder of the meshes.
    #[arg(long)]
    meshes: Option<PathBuf>,
    /// The picture to write, .png or .svg.
    #[arg(long)]
    out: PathBuf,
    /// The posture.
    #[arg(long, value_enum, default_value = "home")]
    pose: Pose,
}

/// Draws the robot. Always returns true.
pub(crate) fn draw(options: &Draw) -> Result<bool, CollisionError> {
    let (toml, urdf) = robot_texts(&options.robot)?;
    let model = Model::from_text(&toml.0, &toml.1, &urdf.0, &urdf.1)?;
    let own = options.robot.parent().unwrap_or(Path::new(".")).join(robot::urdf_file(&toml.0, &toml.1)?);
    let shapes = parse_all(if options.urdf.is_empty() { std::slice::from_ref(&own) } else { &options.urdf })?;
    let scene = Scene::new(&shapes, options.meshes.as_deref(), &[]);
    let mut clouds = Vec::new();
    // Links that the model does not have (a finger, a wheel) are not drawn.
    for link in shapes.links.iter().filter(|link| model.link_body(&link.name).is_some()) {
        let points = scene.points(&link.name)?;
        clouds.push(Cloud { link: link.name.clone(), points });
    }
    let mut q = model.home;
    if matches!(options.pose, Pose::Reference) {
        for arm in &model.arms {
            arm.joints.iter().zip(&arm.reference).for_each(|(j, position)| q[*j] = *position);
        }
    }
    draw_views(&model, &q, &clouds, &options.out)?;
    Ok(true)
}
