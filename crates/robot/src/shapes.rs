//! The only file that names parry: an independent second opinion on distances, for tests and tools, never for a tick.

use nalgebra::Vector3;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::Capsule;

/// Distance of two capsules in one frame by parry's GJK, m; 0 where they overlap. `None` where parry gives up.
pub fn capsule_distance_oracle(
    a: (&Vector3<f64>, &Vector3<f64>, f64),
    b: (&Vector3<f64>, &Vector3<f64>, f64),
) -> Option<f64> {
    let shape = |(p, q, radius): (&Vector3<f64>, &Vector3<f64>, f64)| {
        Capsule::new(Vector::new(p.x, p.y, p.z), Vector::new(q.x, q.y, q.z), radius)
    };
    query::distance(&Pose::IDENTITY, &shape(a), &Pose::IDENTITY, &shape(b))
        .ok()
        .map(|found| found.distance)
}

/// Volume of the convex hull of points by parry, m^3. `None` where they span no volume.
pub fn hull_volume_oracle(points: &[Vector3<f64>]) -> Option<f64> {
    let points: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let (vertices, triangles) = parry3d_f64::transformation::try_convex_hull(&points).ok()?;
    let corner = |index: u32| vertices[index as usize];
    let volume = |[a, b, c]: &[u32; 3]| corner(*a).dot(corner(*b).cross(corner(*c))) / 6.0;
    Some(triangles.iter().map(volume).sum())
}
