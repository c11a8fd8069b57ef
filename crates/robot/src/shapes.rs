//! The only file that uses parry. It is an independent second computation of distances, for tests and tools,
//! never for a tick.

use crate::pose::Pose as RobotPose;
use nalgebra::Vector3;
use parry3d_f64::math::{Matrix, Pose, Rotation, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{ConvexPolyhedron, Segment};

/// Distance of the segments a0 a1 and b0 b1 by parry, m. Its GJK on capsules, `query::distance`, is only accurate
/// to 1e-5 (parry 0.31.1, `findings/parry_capsule_distance.sh`).
pub fn segment_distance_oracle(a0: &Vector3<f64>, a1: &Vector3<f64>, b0: &Vector3<f64>, b1: &Vector3<f64>) -> f64 {
    let point = |p: &Vector3<f64>| Vector::new(p.x, p.y, p.z);
    let (first, second) = (Segment::new(point(a0), point(a1)), Segment::new(point(b0), point(b1)));
    let (on_first, on_second) =
        query::details::closest_points_segment_segment_with_locations(&Pose::IDENTITY, &first, &second);
    (first.point_at(&on_first) - second.point_at(&on_second)).length()
}

/// Volume of the convex hull of points by parry, m^3. `None` if they span no volume.
pub fn hull_volume_oracle(points: &[Vector3<f64>]) -> Option<f64> {
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = parry3d_f64::transformation::try_convex_hull(&points).ok()?;
    let corner = |index: u32| vertices[index as usize];
    let volume = |[a, b, c]: &[u32; 3]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0;
    Some(triangles.iter().map(volume).sum())
}

/// A convex hull, for proofs that need less slack than capsules leave. The distance by parry's GJK may be too
/// high by 1e-5 of itself.
#[derive(Clone)]
pub struct Hull(ConvexPolyhedron);

impl Hull {
    /// Creates the convex hull of points, m. `None` if they span no volume.
    pub fn new(points: &[Vector3<f64>]) -> Option<Self> {
        let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
        ConvexPolyhedron::from_convex_hull(&points).map(Self)
    }

    /// Its corners, m.
    pub fn corners(&self) -> Vec<Vector3<f64>> {
        self.0.points().iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect()
    }

    /// Distance of two hulls at these poses by parry's GJK, m. It is 0 if they overlap or if parry gives up.
    pub fn distance_m(&self, pose: &RobotPose, other: &Self, other_pose: &RobotPose) -> f64 {
        query::distance(&place(pose), &self.0, &place(other_pose), &other.0).map_or(0.0, |found| found.distance)
    }
}

fn place(pose: &RobotPose) -> Pose {
    let column = |i: usize| Vector::new(pose.r[(0, i)], pose.r[(1, i)], pose.r[(2, i)]);
    let rotation = Rotation::from_mat3(&Matrix::from_cols(column(0), column(1), column(2)));
    Pose::from_parts(Vector::new(pose.t.x, pose.t.y, pose.t.z), rotation)
}
