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
