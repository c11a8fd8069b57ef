//! The command `collision draw`.

use crate::{own_urdf, parse_all, robot_texts};
use clap::ValueEnum;
use collision::draw::{Cloud, draw as draw_views, draw_row};
use collision::error::CollisionError;
use collision::scene::Scene;
use messages::JOINTS_MAX;
use robot::Model;
use std::path::PathBuf;

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
    /// Robot file. Several are drawn from the front, side by side.
    #[arg(required = true)]
    robot: Vec<PathBuf>,
    /// URDF with meshes or primitives [default: the URDF of the robot file].
    #[arg(long)]
    urdf: Vec<PathBuf>,
    /// Folder of the meshes.
    #[arg(long)]
    meshes: Option<PathBuf>,
    /// The picture to write, .png.
    #[arg(long)]
    out: PathBuf,
    /// The posture.
    #[arg(long, value_enum, default_value = "home")]
    pose: Pose,
}

/// Draws the robot or the robots. Always returns true.
pub(crate) fn draw(options: &Draw) -> Result<bool, CollisionError> {
    let read = |file: &PathBuf| {
        let (toml, urdf) = robot_texts(file)?;
        Ok(Model::from_text(&toml.0, &toml.1, &urdf.0, &urdf.1)?)
    };
    let models = options.robot.iter().map(read).collect::<Result<Vec<Model>, CollisionError>>()?;
    let [model] = models.as_slice() else {
        let robots: Vec<_> = models.iter().map(|model| (model, options.posture(model))).collect();
        draw_row(&robots, &options.out)?;
        return Ok(true);
    };
    let own = own_urdf(&options.robot[0], &model.texts.toml)?;
    let shapes = parse_all(if options.urdf.is_empty() { std::slice::from_ref(&own) } else { &options.urdf })?;
    let scene = Scene::new(&shapes, options.meshes.as_deref(), &[]);
    let mut clouds = Vec::new();
    // Links that the model does not have (a finger, a wheel) are not drawn.
    for link in shapes.links.iter().filter(|link| model.link_body(&link.name).is_some()) {
        let points = scene.points(&link.name)?;
        clouds.push(Cloud { link: link.name.clone(), points });
    }
    draw_views(model, &options.posture(model), &clouds, &options.out)?;
    Ok(true)
}

impl Draw {
    fn posture(&self, model: &Model) -> [f64; JOINTS_MAX] {
        if matches!(self.pose, Pose::Reference) { model.t_pose() } else { model.home }
    }
}
