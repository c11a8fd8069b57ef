//! Frames that do not match their layout, and numbers that are not finite.

use crate::client::{Turn, accept, bent};
use crate::golden::clients;
use layouts::Layouts;
use messages::{RAW_JOINTS_MAX, RawSkeleton, SkeletonLayout, raw_flag, skeleton_flag};
use skeleton::DropReason;

/// Reason to refuse this frame after a change.
fn refused(good: &RawSkeleton, change: impl Fn(&mut RawSkeleton)) -> DropReason {
    let mut raw = *good;
    change(&mut raw);
    accept(&Layouts::default(), &raw).expect_err("refused")
}

#[test]
fn frame_with_wrong_layout_count_or_flags_is_refused() {
    for client in clients() {
        let good = client.send(&bent(), Turn::identity());
        accept(&Layouts::default(), &good).expect("a person");
        for number in [0, 9, 999, 1000, u32::MAX] {
            assert_eq!(refused(&good, |raw| raw.layout = number), DropReason::Layout);
        }
        for count in [0, good.joint_count - 1, good.joint_count + 1, RAW_JOINTS_MAX as u32 + 1, u32::MAX] {
            assert_eq!(refused(&good, |raw| raw.joint_count = count), DropReason::Count, "{count}");
        }
        for flags in [16, 1 << 12, raw_flag::LOCAL, raw_flag::LOCAL | 16] {
            assert_eq!(refused(&good, |raw| raw.flags = flags), DropReason::Count, "{flags}");
        }
        let mirrored = refused(&good, |raw| raw.flags = raw_flag::MIRRORED | raw_flag::ROTATIONS);
        let has_rotations = client.number != SkeletonLayout::MediaPipe33 as u32;
        assert_eq!(mirrored, if has_rotations { DropReason::Mirrored } else { DropReason::Count });
        let local = raw_flag::LOCAL | raw_flag::ROTATIONS;
        if client.number > SkeletonLayout::Smpl24 as u32 {
            assert_eq!(refused(&good, |raw| raw.flags = local), DropReason::Count);
        }
        if !has_rotations {
            assert_eq!(refused(&good, |raw| raw.flags = raw_flag::ROTATIONS), DropReason::Count);
        }
    }
}

/// Limbs of a side that a frame has without this joint of it, as bits: upper arm 1, forearm 2. `None` if nothing can be used.
fn left_without(smpl: usize, hangs_on: [usize; 2]) -> Option<[bool; 2]> {
    match smpl {
        1 | 2 | 16 | 17 if hangs_on[0] == 0 => None,
        13 | 14 | 16 | 17 if hangs_on[0] > 0 => Some([false; 2]),
        18 | 19 => Some([false; 2]),
        20 | 21 => Some([true, false]),
        0 | 3 | 6 | 9 if hangs_on[1] > 0 => None,
        _ => Some([true; 2]),
    }
}

/// Checks that a frame without this joint keeps all else. `hangs_on` says whether a rotation is unknown, and whether all are local.
fn check(raw: &RawSkeleton, smpl: usize, hangs_on: [usize; 2]) {
    let found = accept(&Layouts::default(), raw);
    let Some(limbs) = left_without(smpl, hangs_on) else {
        return assert_eq!(found.expect_err("no trunk"), DropReason::TrunkLost, "{} {smpl}", raw.layout);
    };
    let found = found.unwrap_or_else(|reason| panic!("{} {smpl}: {reason:?}", raw.layout));
    // Those of the left side have odd numbers up to the hips, and even ones from the shoulders on.
    let right = if smpl < 13 { smpl % 3 == 2 } else { smpl == 14 || smpl > 15 && smpl % 2 == 1 };
    for (side, limb) in [(false, 0), (false, 1), (true, 0), (true, 1)] {
        let expected = side != right || limbs[limb];
        let flag = skeleton_flag::LIMB[2 * usize::from(side) + limb];
        assert_eq!(found.flags & flag != 0, expected, "{} {smpl}: limb {limb}, right {side}", raw.layout);
    }
}

#[test]
fn f001_joint_that_is_marked_as_not_seen_costs_no_other_in_every_layout() {
    for client in clients() {
        let good = client.send(&bent(), Turn::identity());
        let identity = if client.w_first { [1.0, 0.0, 0.0, 0.0] } else { [0.0, 0.0, 0.0, 1.0] };
        for smpl in 0..messages::SMPL_JOINTS {
            // The head of landmarks is between the ears.
            let Some(index) = client.index(smpl).filter(|_| smpl != 15) else { continue };
            for mark in [[f32::NAN; 3], [0.0; 3], [1.0, f32::INFINITY, 1.0]] {
                let mut raw = good;
                raw.positions[index] = mark;
                check(&raw, smpl, [0, 0]);
            }
            let mut raw = good;
            raw.confidence[index] = f32::NAN;
            check(&raw, smpl, [0, 0]);
            if let Some(head) = client.index(15).filter(|_| client.rotations) {
                let mut raw = good;
                raw.rotations[head] = [f32::NAN; 4];
                let found = accept(&Layouts::default(), &raw).expect("the arms are seen");
                assert_eq!(found.flags & skeleton_flag::HEAD, 0, "{}", raw.layout);
            }
            for mark in [[f32::NAN; 4], [0.0; 4]].into_iter().filter(|_| client.rotations) {
                let mut raw = good;
                raw.rotations[index] = mark;
                check(&raw, smpl, [1, 0]);
                if client.number <= SkeletonLayout::Smpl24 as u32 {
                    raw.rotations = [identity; _];
                    raw.rotations[index] = mark;
                    raw.flags = raw_flag::ROTATIONS | raw_flag::LOCAL;
                    check(&raw, smpl, [1, 1]);
                }
            }
        }
    }
}

#[test]
fn huge_value_or_wrong_confidence_is_refused_in_every_layout() {
    for client in clients() {
        let good = client.send(&bent(), Turn::identity());
        for index in (0..messages::SMPL_JOINTS).filter_map(|smpl| client.index(smpl)) {
            for axis in 0..3 {
                assert_eq!(refused(&good, |raw| raw.positions[index][axis] = f32::MAX), DropReason::OutOfRange);
            }
            for (confidence, reason) in [(f32::INFINITY, DropReason::NotFinite), (-0.1, DropReason::OutOfRange)] {
                assert_eq!(refused(&good, |raw| raw.confidence[index] = confidence), reason);
            }
            if client.rotations {
                assert_eq!(refused(&good, |raw| raw.rotations[index][3] = f32::MAX), DropReason::NotUnit);
            }
        }
    }
}

#[test]
fn local_rotation_that_is_not_unit_is_refused() {
    let mut raw = RawSkeleton { joint_count: 24, layout: SkeletonLayout::Smpl24 as u32, ..bare() };
    accept(&Layouts::default(), &raw).expect("a T-pose");
    raw.rotations[18] = [0.0, 0.0, 0.0, 2.0];
    raw.rotations[20] = [0.0, 0.0, 0.0, 0.5];
    assert_eq!(accept(&Layouts::default(), &raw).expect_err("no units"), DropReason::NotUnit);
}

/// Local rotations of a T-pose.
fn bare() -> RawSkeleton {
    let mut raw = clients()[0].frame();
    raw.flags = raw_flag::ROTATIONS | raw_flag::LOCAL;
    raw.positions[0] = [0.0; 3];
    raw.rotations = [[0.0, 0.0, 0.0, 1.0]; _];
    raw.confidence = [1.0; _];
    raw
}
