//! The command `collision cover`.

use crate::{held, own_urdf, parse_all, robot_texts};
use collision::cover::cover as judge;
use collision::error::CollisionError;
use robot::Model;
use rt::out;
use std::path::PathBuf;

/// Options of `collision cover`.
#[derive(clap::Args)]
pub(crate) struct Cover {
    /// Robot file.
    robot: PathBuf,
    /// URDF with meshes or primitives [default: the URDF of the robot file]. Each further URDF adds the links that the
    /// previous ones do not have.
    #[arg(long)]
    urdf: Vec<PathBuf>,
    /// Folder of the meshes. The part after `/meshes/` in the URDF's file names is looked up in it.
    #[arg(long)]
    meshes: Option<PathBuf>,
    /// Leave this link out, because its shape is not a part of the robot. May be given several times.
    #[arg(long, value_name = "LINK")]
    without: Vec<String>,
}

/// Prints the page. Returns false if a shape sticks out of its capsules.
pub(crate) fn cover(options: &Cover) -> Result<bool, CollisionError> {
    let (toml, urdf) = robot_texts(&options.robot)?;
    let model = Model::from_text(&toml.0, &toml.1, &urdf.0, &urdf.1)?;
    let own = [own_urdf(&options.robot, &toml.1)?];
    let shapes = parse_all(if options.urdf.is_empty() { &own } else { &options.urdf })?;
    let found = judge(&model, &shapes, options.meshes.as_deref(), &held(&toml)?.1, &options.without)?;
    out!("{}", found.page().trim_end());
    Ok(found.holds())
}
