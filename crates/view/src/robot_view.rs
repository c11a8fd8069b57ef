//! The robot as a page shows it: its model, its look, and the user's own meshes.

use crate::look::{Colour, Look, LookError, rows};
use crate::meshes::MeshFolder;
use config::Loaded;
use robot::{MeshVisual, Model, Pose};
use std::path::Path;
use std::sync::Arc;

/// Number of missing files that one error names.
const NAMED_MAX: usize = 3;

/// A mesh file of the user that is drawn for a link.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Name of its link.
    pub link: String,
    /// The body it moves with.
    pub body: usize,
    /// Transform from the mesh's frame to the body's frame, with the mesh's scale: rows of a 3 x 4 matrix.
    pub body_from_mesh: [[f64; 4]; 3],
    /// Path below the folder of meshes.
    pub file: String,
    /// Colour, if the mesh has none of its own.
    pub colour: Option<Colour>,
}

/// Robot data that a page shows.
#[derive(Clone, Debug)]
pub struct RobotView {
    /// Model of the robot with its obstacles.
    pub model: Model,
    /// Shapes and colours.
    pub look: Look,
    /// The user's meshes. Empty without a folder.
    pub meshes: Vec<Mesh>,
    /// Folder of the meshes.
    pub folder: Option<Arc<MeshFolder>>,
    /// Names of mesh files that are not in the folder.
    pub missing: Vec<String>,
    /// `retarget::Settings::following_delays_ms`.
    pub following_delays_ms: [f64; 2],
}

impl RobotView {
    /// Creates the view of `loaded`'s robot, with the look beside its robot file and the meshes below `folder`.
    /// A folder with none of the robot's meshes is refused.
    pub fn load(loaded: &Loaded, folder: Option<&Path>) -> Result<Self, LookError> {
        let look = Look::read(loaded.robot_file(), &loaded.model)?;
        let mut view = Self {
            model: loaded.model.clone(),
            look,
            meshes: Vec::new(),
            folder: None,
            missing: Vec::new(),
            following_delays_ms: loaded.settings.retarget.following_delays_ms(),
        };
        if let Some(folder) = folder {
            view.find_meshes(folder)?;
        }
        Ok(view)
    }

    fn find_meshes(&mut self, path: &Path) -> Result<(), LookError> {
        let folder = MeshFolder::open(path)?;
        let failed = |cause: &str| LookError::Read { file: path.display().to_string(), cause: cause.to_owned() };
        let named: Vec<MeshVisual> = self.model.meshes().collect();
        let links: Vec<String> = self.model.links().map(|(name, ..)| name.to_owned()).collect();
        for link in &links {
            // The look's meshes take precedence over the URDF's, because the author of the look knew the URDF.
            let looks = self.look.meshes.iter().filter(|mesh| mesh.link == *link);
            let looks: Vec<_> =
                looks.map(|mesh| (mesh.clone(), mesh.files.iter().find_map(|f| folder.find(f)))).collect();
            if !looks.is_empty() {
                for (mesh, found) in looks {
                    let (body, body_from_mesh, colour) = (mesh.body, mesh.body_from_mesh, mesh.colour);
                    match found {
                        Some(file) => self.meshes.push(Mesh { link: link.clone(), body, body_from_mesh, file, colour }),
                        None => self.missing.extend(mesh.files.first().cloned()),
                    }
                }
                continue;
            }
            let of_link =
                |is_collision| named.iter().filter(move |mesh| mesh.link == *link && mesh.is_collision == is_collision);
            let found = |is_collision| {
                of_link(is_collision).filter_map(|mesh| Some((mesh, folder.find(&mesh.file)?))).collect::<Vec<_>>()
            };
            // A mesh for collision checks is better than none.
            let files = Some(found(false)).filter(|files| !files.is_empty()).unwrap_or_else(|| found(true));
            if files.is_empty() {
                self.missing
                    .extend(of_link(false).next().or_else(|| of_link(true).next()).map(|mesh| mesh.file.clone()));
            }
            let files: Vec<_> = files.into_iter().map(|(mesh, file)| self.urdf_mesh(mesh, file)).collect();
            // Many makers name a link's mesh after the link, in the link's frame.
            if files.is_empty() && of_link(false).chain(of_link(true)).next().is_none() {
                self.meshes.extend(folder.find_link(link).and_then(|file| self.link_mesh(link, file)));
            }
            self.meshes.extend(files);
        }
        if self.meshes.is_empty() {
            let names: Vec<&str> = self.missing.iter().take(NAMED_MAX).map(String::as_str).collect();
            return Err(failed(&if names.is_empty() {
                "--meshes: neither the URDF nor the look file names a mesh file, and no file below it has the name of a \
                 link; leave the option out"
                    .to_owned()
            } else {
                format!("--meshes: none of the robot's mesh files is below it ({} ...)", names.join(", "))
            }));
        }
        self.folder = Some(Arc::new(folder));
        Ok(())
    }

    fn urdf_mesh(&self, mesh: &MeshVisual, file: String) -> Mesh {
        let own = mesh.colour.map(|rgb| Colour(rgb.map(|channel| (channel * 255.0).round() as u8)));
        Mesh {
            link: mesh.link.clone(),
            body: mesh.body,
            body_from_mesh: rows(&mesh.body_from_mesh, mesh.scale, &Pose::identity()),
            file,
            colour: own.or_else(|| self.look.colour_of(&mesh.link)),
        }
    }

    /// Returns the mesh `file` in the frame of the link.
    fn link_mesh(&self, link: &str, file: String) -> Option<Mesh> {
        let (_, body, body_from_link) = self.model.links().find(|(name, ..)| *name == link)?;
        let body_from_mesh = rows(body_from_link, [1.0; 3], &Pose::identity());
        Some(Mesh { link: link.to_owned(), body, body_from_mesh, file, colour: self.look.colour_of(link) })
    }

    /// Returns the bodies that begin at the left and right shoulder. An overlaid person is aligned with them.
    pub fn shoulder_bodies(&self) -> [usize; 2] {
        self.model.arms.each_ref().map(|arm| arm.range().start + 2)
    }
}
