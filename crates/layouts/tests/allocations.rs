//! No conversion allocates.

use crate::salt::ON;
use layouts::{Layouts, NoiseState};
use messages::{Layout, RawSkeleton};
use rt::count_allocations;

#[test]
fn f076_conversion_and_filter_allocate_nothing() {
    let layouts = Layouts::default();
    let mut converted = 0;
    for (number, joints) in [(1, 22), (2, 24), (3, 24), (4, 33), (5, 32), (6, 23), (7, 55), (8, 66)] {
        for flags in 0..8 {
            let mut raw = RawSkeleton { layout: number, joint_count: joints, flags, ..RawSkeleton::ZERO };
            raw.confidence.fill(1.0);
            let (out, counted) = count_allocations(|| layouts.convert(&raw));
            assert_eq!(counted.allocated, 0, "layout {number}, flags {flags}");
            converted += usize::from(out.is_ok());
            let mut state = NoiseState::default();
            for origin in 1..30 {
                let (wild, jumped) = (if origin == 20 { 0.1 } else { 0.0 }, if origin > 25 { 1.0 } else { 0.0 });
                let mut noise = raw;
                noise.header.origin.0 = origin * 10_000_000;
                noise.positions[..22].fill([0.001 * origin as f32 + wild + jumped, 0.0, 0.0]);
                let ((), counted) = count_allocations(|| ON.filter(&mut state, number, &mut noise));
                assert_eq!(counted.allocated, 0, "layout {number}");
            }
            assert_eq!(state.rejected(), 22);
        }
    }
    // A frame of SMPL-22 is passed on without a check unless it has local rotations: 4 + 2. SMPL-24 accepts 6
    // combinations of flags. Three layouts accept positions or global rotations, mirrored or not: 4 each.
    // MediaPipe (twice) accepts positions only, Unity local rotations only: 2 each.
    assert_eq!(converted, 6 + 6 + 4 * 3 + 2 + 2 + 2);
}
