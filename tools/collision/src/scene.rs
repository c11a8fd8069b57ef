//! A URDF with its meshes: the shapes of a group's links in the frame of the group.

use crate::error::CollisionError;
use crate::mesh::{Points, read_mesh};
use crate::plan::{Finger, Group, Part, SIDE};
use crate::split::Matter;
use nalgebra::{Unit, UnitQuaternion, Vector3};
use robot::Pose;
use std::collections::HashMap;
use std::path::Path;
use urdf_rs::{Geometry, JointType};

/// Number of corners of the polygon around a circle. It lies outside the circle.
const CIRCLE_CORNERS: usize = 24;

pub struct Scene<'a> {
    robot: &'a urdf_rs::Robot,
    /// Folder of the files that follow `meshes/` in the URDF's file names. With `None`, a mesh is an error.
    meshes: Option<&'a Path>,
    fingers: &'a [Finger],
    held: Posture,
    /// Spheres are round. Otherwise their cubes stand for them.
    round: bool,
}

/// Returns true if a link has shapes, for collisions or else for drawing.
pub fn has_shapes(link: &urdf_rs::Link) -> bool {
    !link.collision.is_empty() || !link.visual.is_empty()
}

/// Joint positions by name, rad or m.
pub type Posture = HashMap<String, f64>;

impl<'a> Scene<'a> {
    pub fn new(robot: &'a urdf_rs::Robot, meshes: Option<&'a Path>, fingers: &'a [Finger]) -> Self {
        Self { robot, meshes, fingers, held: Posture::new(), round: false }
    }

    /// The same with these positions of the joints that nothing commands.
    pub fn holding(self, held: Posture) -> Self {
        Self { held, ..self }
    }

    /// The same with round spheres, to judge capsules that a person wrote. A fit takes their cubes.
    pub fn with_round_spheres(self) -> Self {
        Self { round: true, ..self }
    }

    /// Returns all that the capsules of a group must contain, in the frame of the group's link. For a group of
    /// two sides it is the left one, with the right one mirrored into it.
    pub fn matter(&self, group: &Group) -> Result<Matter, CollisionError> {
        if !group.frame.contains(SIDE) {
            return self.side(group, "");
        }
        let mut left = self.side(group, "left")?;
        let right = self.side(group, "right")?;
        let mirror = self.mirror(&group.frame, "right", "left")?;
        let map = |polygons: Vec<Points>| -> Vec<Points> {
            polygons.iter().map(|points| points.iter().map(&mirror).collect()).collect()
        };
        left.surface.extend(map(right.surface));
        left.pieces.extend(map(right.pieces));
        Ok(left)
    }

    /// Returns the map from a point in the frame of one side's link to its mirror image in the frame of the
    /// other side's link. The mirror is the plane y = 0 of the root, with all joints at zero.
    pub fn mirror(
        &self,
        frame: &str,
        from: &str,
        to: &str,
    ) -> Result<impl Fn(&Vector3<f64>) -> Vector3<f64> + use<>, CollisionError> {
        let root = self.root()?;
        let root_from = self.pose(&root, &frame.replace(SIDE, from), &Posture::new())?;
        let to_root = self.pose(&root, &frame.replace(SIDE, to), &Posture::new())?.inverse();
        Ok(move |point: &Vector3<f64>| {
            let p = root_from.transform_point(point);
            to_root.transform_point(&Vector3::new(p.x, -p.y, p.z))
        })
    }

    fn wrong(&self, cause: String) -> CollisionError {
        CollisionError::content(&self.robot.name, cause)
    }

    fn root(&self) -> Result<String, CollisionError> {
        let below = |link: &str| self.robot.joints.iter().any(|joint| joint.child.link == link);
        let root = self.robot.links.iter().find(|link| !below(&link.name));
        root.map(|link| link.name.clone()).ok_or_else(|| self.wrong("has no root link".into()))
    }

    fn side(&self, group: &Group, side: &str) -> Result<Matter, CollisionError> {
        let frame = group.frame.replace(SIDE, side);
        let mut matter = Matter::default();
        for part in &group.parts {
            let link = part.link.replace(SIDE, side);
            let pose = self.pose(&frame, &link, &Posture::new())?;
            matter.surface.extend(place(&self.shapes(&link, part.elements.as_deref())?, &pose));
            if part.below {
                self.sweep(&frame, part, side, &mut matter)?;
            }
        }
        Ok(matter)
    }

    /// Adds everything below the part's link, in all postures of its fingers.
    fn sweep(&self, frame: &str, part: &Part, side: &str, matter: &mut Matter) -> Result<(), CollisionError> {
        let top = part.link.replace(SIDE, side);
        for link in self.robot.links.iter().filter(|link| link.name != top) {
            let Some(poses) = self.poses(frame, &top, &link.name, side)? else { continue };
            let shapes = self.shapes(&link.name, None)?;
            if shapes.is_empty() {
                continue;
            }
            // A convex piece needs each corner only once.
            let mut corners: Points = shapes.into_iter().flatten().collect();
            corners.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
            corners.dedup();
            for pose in poses {
                matter.pieces.extend(place(std::slice::from_ref(&corners), &pose));
            }
        }
        Ok(())
    }

    /// Returns the poses of `link` in `frame`, in all postures of the fingers from `top` down to it. `None` if it is
    /// not below `top`.
    fn poses(&self, frame: &str, top: &str, link: &str, side: &str) -> Result<Option<Vec<Pose>>, CollisionError> {
        let Some(joints) = self.chain(top, link) else { return Ok(None) };
        let postures = self.postures(&joints, side)?;
        postures.iter().map(|posture| self.pose(frame, link, posture)).collect::<Result<_, _>>().map(Some)
    }

    /// Returns the polygons of a link in the link's frame, and the link's poses in `frame`: one for each posture of
    /// the fingers from `top` down to it.
    pub fn swept(&self, frame: &str, top: &str, link: &str) -> Result<(Vec<Points>, Vec<Pose>), CollisionError> {
        let poses = self.poses(frame, top, link, "")?;
        let poses = poses.ok_or_else(|| self.wrong(format!("link `{link}` is not below `{top}`")))?;
        Ok((self.shapes(link, None)?, poses))
    }

    /// Returns the postures of the movable joints of one chain: a grid over the free joint and the common flexion.
    fn postures(&self, joints: &[&urdf_rs::Joint], side: &str) -> Result<Vec<Posture>, CollisionError> {
        let mut movable = joints.iter().filter(|joint| joint.joint_type != JointType::Fixed).peekable();
        if movable.peek().is_none() {
            return Ok(vec![Posture::new()]);
        }
        let is = |name: &str, joint: &urdf_rs::Joint| name.replace(SIDE, side) == joint.name;
        let of_finger = |finger: &&Finger| {
            let known = |joint: &&urdf_rs::Joint| {
                joint.joint_type == JointType::Fixed
                    || is(&finger.free, joint)
                    || finger.coupled.iter().any(|name| is(name, joint))
            };
            joints.iter().all(known)
        };
        let Some(finger) = self.fingers.iter().find(of_finger) else {
            let name = movable.next().map_or("", |joint| joint.name.as_str());
            return Err(self.wrong(format!("joint `{name}` moves inside a group and belongs to no finger of the plan")));
        };
        let share = |step: usize, steps: usize| step as f64 / steps.saturating_sub(1).max(1) as f64;
        let mut postures = Vec::new();
        for free in 0..finger.free_steps.max(1) {
            for coupled in 0..finger.coupled_steps.max(1) {
                let position = |joint: &urdf_rs::Joint| {
                    let s = if is(&finger.free, joint) {
                        share(free, finger.free_steps)
                    } else {
                        share(coupled, finger.coupled_steps)
                    };
                    joint.limit.lower + s * (joint.limit.upper - joint.limit.lower)
                };
                let movable = joints.iter().filter(|joint| joint.joint_type != JointType::Fixed);
                postures.push(movable.map(|joint| (joint.name.clone(), position(joint))).collect());
            }
        }
        Ok(postures)
    }

    /// Returns the joints from `top` down to `link`. `None` if it is not below.
    fn chain(&self, top: &str, link: &str) -> Option<Vec<&urdf_rs::Joint>> {
        let mut joints = Vec::new();
        let mut here = link;
        while here != top {
            let joint = self.robot.joints.iter().find(|joint| joint.child.link == here)?;
            if joints.len() > self.robot.joints.len() {
                return None;
            }
            joints.push(joint);
            here = &joint.parent.link;
        }
        joints.reverse();
        Some(joints)
    }

    /// Returns the pose of `link` in the frame of `top`. Joints are at the posture, else where they are held, else at
    /// zero.
    pub fn pose(&self, top: &str, link: &str, posture: &Posture) -> Result<Pose, CollisionError> {
        let joints = self.chain(top, link);
        let joints = joints.ok_or_else(|| self.wrong(format!("link `{link}` is neither `{top}` nor below it")))?;
        Ok(joints.iter().fold(Pose::identity(), |pose, joint| {
            let origin = pose.compose(&Pose::from_xyz_rpy(*joint.origin.xyz, *joint.origin.rpy));
            let q = posture.get(&joint.name).or_else(|| self.held.get(&joint.name)).copied().unwrap_or(0.0);
            let axis = Unit::new_normalize(Vector3::from(*joint.axis.xyz));
            let turn = match joint.joint_type {
                JointType::Fixed => Pose::identity(),
                JointType::Prismatic => Pose { t: axis.into_inner() * q, ..Pose::identity() },
                _ => Pose { r: UnitQuaternion::from_axis_angle(&axis, q).into(), t: Vector3::zeros() },
            };
            origin.compose(&turn)
        }))
    }

    pub fn points(&self, link: &str) -> Result<Points, CollisionError> {
        Ok(self.shapes(link, None)?.into_iter().flatten().collect())
    }

    fn shapes(&self, link: &str, elements: Option<&[usize]>) -> Result<Vec<Points>, CollisionError> {
        let found = self.robot.links.iter().find(|known| known.name == link);
        let found = found.ok_or_else(|| self.wrong(format!("has no link `{link}`")))?;
        let mut polygons = Vec::new();
        let collision = found.collision.iter().map(|element| (&element.origin, &element.geometry));
        // Drawn shapes stand in for a link that has no others.
        let drawn = found.visual.iter().map(|element| (&element.origin, &element.geometry));
        let drawn = drawn.filter(|_| found.collision.is_empty());
        for (index, (origin, geometry)) in collision.chain(drawn).enumerate() {
            if elements.is_some_and(|chosen| !chosen.contains(&index)) {
                continue;
            }
            let pose = Pose::from_xyz_rpy(*origin.xyz, *origin.rpy);
            polygons.extend(place(&self.geometry(link, geometry)?, &pose));
        }
        Ok(polygons)
    }

    fn geometry(&self, link: &str, geometry: &Geometry) -> Result<Vec<Points>, CollisionError> {
        match geometry {
            Geometry::Box { size } => Ok(prism(&rectangle(size[0], size[1]), size[2])),
            Geometry::Cylinder { radius, length } => Ok(prism(&circle(*radius), *length)),
            Geometry::Sphere { radius } if self.round => Ok(ball(*radius)),
            Geometry::Sphere { radius } => Ok(prism(&rectangle(2.0 * radius, 2.0 * radius), 2.0 * radius)),
            Geometry::Capsule { radius, length } => Ok(prism(&circle(*radius), length + 2.0 * radius)),
            Geometry::Mesh { filename, scale } => {
                let folder =
                    self.meshes.ok_or_else(|| self.wrong(format!("link `{link}` has a mesh; give --meshes")))?;
                let below = filename.rsplit_once("/meshes/").map_or(filename.as_str(), |(_, below)| below);
                let scale = scale.map_or(Vector3::repeat(1.0), |scale| Vector3::from(*scale));
                let path = folder.join(below);
                // The folder may be the one that has `meshes`, or `meshes` itself.
                let inner = below.strip_prefix("meshes/").map(|below| folder.join(below));
                let path = inner.filter(|inner| !path.exists() && inner.exists()).unwrap_or(path);
                let mut triangles = read_mesh(&path)?;
                triangles.iter_mut().flatten().for_each(|point| point.component_mul_assign(&scale));
                // A point 10 m from its link does not belong to a robot. The mesh is probably in millimetres.
                if triangles.iter().flatten().any(|point| !(point.amax() <= 10.0)) {
                    return Err(CollisionError::content(filename, "extends farther than 10 m; is a scale missing?"));
                }
                Ok(triangles)
            }
        }
    }
}

fn place(polygons: &[Points], pose: &Pose) -> Vec<Points> {
    polygons.iter().map(|points| points.iter().map(|point| pose.transform_point(point)).collect()).collect()
}

fn rectangle(x: f64, y: f64) -> Vec<[f64; 2]> {
    vec![[0.5 * x, 0.5 * y], [-0.5 * x, 0.5 * y], [-0.5 * x, -0.5 * y], [0.5 * x, -0.5 * y]]
}

/// Returns a regular polygon around the circle.
fn circle(radius: f64) -> Vec<[f64; 2]> {
    let step = std::f64::consts::TAU / CIRCLE_CORNERS as f64;
    let outer = radius / (0.5 * step).cos();
    (0..CIRCLE_CORNERS).map(|i| (step * i as f64).sin_cos()).map(|(sin, cos)| [outer * cos, outer * sin]).collect()
}

/// Returns a polyhedron whose corners lie on the sphere. Its faces lie at most 0.9 % of the radius below it.
fn ball(radius: f64) -> Vec<Points> {
    let step = std::f64::consts::TAU / CIRCLE_CORNERS as f64;
    let at = |ring: usize, corner: usize| {
        let ((up, out), (sin, cos)) =
            ((step * ring as f64 - 0.25 * std::f64::consts::TAU).sin_cos(), (step * corner as f64).sin_cos());
        radius * Vector3::new(out * cos, out * sin, up)
    };
    let rings = (0..CIRCLE_CORNERS / 2).flat_map(|ring| (0..CIRCLE_CORNERS).map(move |corner| (ring, corner)));
    rings.map(|(r, c)| vec![at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]).collect()
}

/// Returns the surface of a prism of height `z` on a base around the origin: bottom, top and sides.
fn prism(base: &[[f64; 2]], z: f64) -> Vec<Points> {
    let at = |corner: &[f64; 2], z: f64| Vector3::new(corner[0], corner[1], z);
    let (low, high) = (-0.5 * z, 0.5 * z);
    let mut polygons: Vec<Points> =
        [low, high].iter().map(|z| base.iter().map(|corner| at(corner, *z)).collect()).collect();
    for (i, here) in base.iter().enumerate() {
        let next = &base[(i + 1) % base.len()];
        polygons.push(vec![at(here, low), at(next, low), at(next, high), at(here, high)]);
    }
    polygons
}
