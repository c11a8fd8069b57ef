//! A person before a camera. Tests of `world` use it, too.

use messages::{Layout, RawSkeleton, SkeletonLayout};

/// A frame of MediaPipe's 66 landmarks: a person who stands before the camera, arms down.
pub fn frame() -> RawSkeleton {
    let mut raw = RawSkeleton { layout: SkeletonLayout::MediaPipe66 as u32, joint_count: 66, ..RawSkeleton::ZERO };
    let places = [
        (0, 0.0, -0.7),
        (11, 0.18, -0.5),
        (13, 0.2, -0.22),
        (15, 0.2, 0.02),
        (23, 0.1, 0.0),
        (25, 0.1, 0.4),
        (27, 0.1, 0.8),
    ];
    for (landmark, x, y) in places {
        for (n, sign) in [(landmark, 1.0), (landmark + usize::from(landmark > 0), -1.0)] {
            raw.positions[n] = [sign * x, y, 0.0];
            raw.positions[33 + n] = [0.35 * sign * x, 0.35 * y, 0.0];
        }
    }
    raw.confidence[..66].fill(1.0);
    // A hidden finger tells the image from its mirror image.
    raw.confidence[33 + 18] = 0.0;
    raw
}
