//! The only file that names parry: an independent second opinion on distances, for tests and tools, never for a tick.

use crate::pose::Pose as RobotPose;
use nalgebra::Vector3;
use parry3d_f64::math::{Matrix, Pose, Rotation, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{Capsule, ConvexPolyhedron};

/// Distance of two capsules in one frame by parry's GJK, m; 0 where they overlap. `None` where parry gives up.
pub fn capsule_distance_oracle(
    a: (&Vector3<f64>, &Vector3<f64>, f64),
    b: (&Vector3<f64>, &Vector3<f64>, f64),
) -> Option<f64> {
    let shape = |(p, q, radius): (&Vector3<f64>, &Vector3<f64>, f64)| {
        Capsule::new(Vector::new(p.x, p.y, p.z), Vector::new(q.x, q.y, q.z), radius)
    };
    query::distance(&Pose::IDENTITY, &shape(a), &Pose::IDENTITY, &shape(b)).ok().map(|found| found.distance)
}

/// Volume of the convex hull of points by parry, m^3. `None` where they span no volume.
pub fn hull_volume_oracle(points: &[Vector3<f64>]) -> Option<f64> {
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = parry3d_f64::transformation::try_convex_hull(&points).ok()?;
    let corner = |index: u32| vertices[index as usize];
    let volume = |[a, b, c]: &[u32; 3]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0;
    Some(triangles.iter().map(volume).sum())
}

/// A convex hull, for proofs that need less slack than capsules leave.
#[derive(Clone)]
pub struct Hull(ConvexPolyhedron);

impl Hull {
    /// The convex hull of points, m; `None` where they span no volume.
    pub fn new(points: &[Vector3<f64>]) -> Option<Self> {
        let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        ConvexPolyhedron::from_convex_hull(&points).map(Self)
    }

    /// Its corners, m.
    pub fn corners(&self) -> Vec<Vector3<f64>> {
        self.0.points().iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect()
    }

    /// Distance of two hulls at these poses by parry's GJK, m; 0 where they overlap or where parry gives up.
    pub fn distance_m(&self, pose: &RobotPose, other: &Self, other_pose: &RobotPose) -> f64 {
        let place = |pose: &RobotPose| {
            let column = |i: usize| Vector::new(pose.r[(0, i)], pose.r[(1, i)], pose.r[(2, i)]);
            let rotation = Rotation::from_mat3(&Matrix::from_cols(column(0), column(1), column(2)));
            Pose::from_parts(Vector::new(pose.t.x, pose.t.y, pose.t.z), rotation)
        };
        query::distance(&place(pose), &self.0, &place(other_pose), &other.0).map_or(0.0, |found| found.distance)
    }
}
