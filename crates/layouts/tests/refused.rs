//! Frames that do not match their layout, and numbers that are not finite.

use crate::client::{Turn, accept, bent};
use crate::golden::clients;
use layouts::Layouts;
use messages::{RAW_JOINTS_MAX, SkeletonLayout, raw_flag};
use skeleton::DropReason;

#[test]
fn frame_with_wrong_layout_count_or_flags_is_refused() {
    let layouts = Layouts::default();
    for client in clients() {
        let good = client.send(&bent(), Turn::identity());
        accept(&layouts, &good).expect("a person");
        let with = |change: &dyn Fn(&mut messages::RawSkeleton)| {
            let mut raw = good;
            change(&mut raw);
            accept(&layouts, &raw).expect_err("refused")
        };
        for number in [0, 9, 999, 1000, u32::MAX] {
            assert_eq!(with(&|raw| raw.layout = number), DropReason::Layout);
        }
        for count in [0, good.joint_count - 1, good.joint_count + 1, RAW_JOINTS_MAX as u32 + 1, u32::MAX] {
            assert_eq!(with(&|raw| raw.joint_count = count), DropReason::Count, "{count}");
        }
        for flags in [16, 1 << 12, raw_flag::LOCAL, raw_flag::LOCAL | 16] {
            assert_eq!(with(&|raw| raw.flags = flags), DropReason::Count, "{flags}");
        }
        let mirrored = with(&|raw| raw.flags = raw_flag::MIRRORED | raw_flag::ROTATIONS);
        let has_rotations = client.number != SkeletonLayout::MediaPipe33 as u32;
        assert_eq!(mirrored, if has_rotations { DropReason::Mirrored } else { DropReason::Count });
        let local = raw_flag::LOCAL | raw_flag::ROTATIONS;
        if client.number > SkeletonLayout::Smpl24 as u32 {
            assert_eq!(with(&|raw| raw.flags = local), DropReason::Count);
        }
        if !has_rotations {
            assert_eq!(with(&|raw| raw.flags = raw_flag::ROTATIONS), DropReason::Count);
        }
    }
}

#[test]
fn f001_nan_infinite_or_huge_value_is_refused_in_every_layout() {
    let layouts = Layouts::default();
    for client in clients() {
        let good = client.send(&bent(), Turn::identity());
        for smpl in 0..messages::SMPL_JOINTS {
            let Some(index) = client.index(smpl) else { continue };
            for (bad, reason) in [
                (f32::NAN, DropReason::NotFinite),
                (f32::INFINITY, DropReason::NotFinite),
                (f32::MAX, DropReason::OutOfRange),
            ] {
                for axis in 0..3 {
                    let mut raw = good;
                    raw.positions[index][axis] = bad;
                    assert_eq!(accept(&layouts, &raw).expect_err("no position"), reason, "{} {smpl}", client.number);
                }
                let mut raw = good;
                raw.confidence[index] = bad;
                assert_eq!(accept(&layouts, &raw).expect_err("no confidence"), reason, "{} {smpl}", client.number);
                if client.rotations {
                    let mut raw = good;
                    raw.rotations[index][3] = bad;
                    let reason = if bad.is_finite() { DropReason::NotUnit } else { reason };
                    assert_eq!(accept(&layouts, &raw).expect_err("no rotation"), reason, "{} {smpl}", client.number);
                }
            }
        }
        let mut raw = good;
        raw.confidence[client.index(16).expect("a shoulder")] = -0.1;
        assert_eq!(accept(&layouts, &raw).expect_err("no confidence"), DropReason::OutOfRange);
    }
}

#[test]
fn local_rotation_that_is_not_unit_is_refused() {
    let mut raw = messages::RawSkeleton { joint_count: 24, layout: SkeletonLayout::Smpl24 as u32, ..bare() };
    accept(&Layouts::default(), &raw).expect("a T-pose");
    raw.rotations[18] = [0.0, 0.0, 0.0, 2.0];
    raw.rotations[20] = [0.0, 0.0, 0.0, 0.5];
    assert_eq!(accept(&Layouts::default(), &raw).expect_err("no units"), DropReason::NotUnit);
    raw.rotations[18] = [0.0, 0.0, 0.0, f32::NAN];
    assert_eq!(accept(&Layouts::default(), &raw).expect_err("no numbers"), DropReason::NotFinite);
}

/// Local rotations of a T-pose.
fn bare() -> messages::RawSkeleton {
    let mut raw = clients()[0].frame();
    raw.flags = raw_flag::ROTATIONS | raw_flag::LOCAL;
    raw.positions[0] = [0.0; 3];
    raw.rotations = [[0.0, 0.0, 0.0, 1.0]; _];
    raw.confidence = [1.0; _];
    raw
}
