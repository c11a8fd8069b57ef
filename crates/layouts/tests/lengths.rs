//! The lengths of a session in place of those of a camera's frame: directions stay, and doubt shows as confidence.

use crate::client::{CAMERA, frame};
use crate::salt::Chance;
use layouts::Lengths;
use messages::{RawSkeleton, Skeleton, skeleton_flag};
use nalgebra::Vector3;
use skeleton::{Config, Input, State, tick};

/// As `skeleton::Config::distrust_after_ns`.
const OTHER_NS: u64 = 250_000_000;
/// Ends of the bones of both arms: left upper arm and forearm, right ones.
const BONES: [[usize; 2]; 4] = [[16, 18], [18, 20], [17, 19], [19, 21]];

fn bone(raw: &RawSkeleton, [from, to]: [usize; 2]) -> Vector3<f32> {
    Vector3::from(raw.positions[to]) - Vector3::from(raw.positions[from])
}

/// Makes the bones of an arm longer by these factors, in their directions.
fn stretch(raw: &mut RawSkeleton, side: usize, factors: [f32; 2]) {
    let bones = [0, 1].map(|n| bone(raw, BONES[2 * side + n]));
    for n in [0, 1] {
        let [from, to] = BONES[2 * side + n];
        raw.positions[to] = (Vector3::from(raw.positions[from]) + bones[n] * factors[n]).into();
    }
}

fn settled(lengths: &mut Lengths, mut raw: RawSkeleton) -> RawSkeleton {
    lengths.settle(CAMERA, 0.5, Some(OTHER_NS), &mut raw);
    raw
}

/// The person of a frame, judged with the bounds of a camera.
fn person(state: &mut State, raw: &RawSkeleton) -> Option<Skeleton> {
    let config = Config { length_change_max: f64::INFINITY, length_step_max: f64::INFINITY, ..Config::default() };
    tick(&config, state, raw.header.origin, Input { raw, stored: None }).skeleton
}

#[test]
fn frame_gets_lengths_of_session_and_keeps_directions() {
    let (mut lengths, mut state, mut chance) = (Lengths::default(), State::default(), Chance(1));
    let mut before: Option<[f32; 4]> = None;
    for i in 0..300 {
        let mut raw = frame(i);
        for side in [0, 1] {
            stretch(&mut raw, side, [0, 1].map(|_| 0.8 + 0.5 * chance.uniform()));
        }
        let out = settled(&mut lengths, raw);
        for ends in BONES {
            assert!(bone(&out, ends).angle(&bone(&raw, ends)) < 2e-3, "frame {i}: {ends:?}");
        }
        let now = BONES.map(|ends| bone(&out, ends).norm());
        if let Some(before) = before.filter(|_| i > 200) {
            let change = now.iter().zip(before).map(|(now, before)| (now / before - 1.0).abs());
            assert!(change.fold(0.0, f32::max) < 0.002, "frame {i}: {before:?} to {now:?}");
        }
        before = Some(now);
        let flags = person(&mut state, &out).map(|person| person.flags & skeleton_flag::ALL);
        assert_eq!(flags, Some(skeleton_flag::ALL), "frame {i}");
    }
}

#[test]
fn f013_repeated_frame_stays_a_repetition() {
    let mut lengths = Lengths::default();
    (0..10).for_each(|i| _ = settled(&mut lengths, frame(i)));
    let mut longer = frame(10);
    stretch(&mut longer, 0, [1.2, 1.1]);
    let first = settled(&mut lengths, longer);
    assert_ne!(first.positions[..22], longer.positions[..22]);
    longer.header.sequence += 1;
    assert_eq!(settled(&mut lengths, longer).positions[..22], first.positions[..22]);
}

#[test]
fn short_or_long_bone_lowers_confidence_of_its_arm_alone() {
    for (factors, used) in
        [([1.0, 1.0], true), ([1.0, 0.8], true), ([1.0, 0.2], false), ([0.2, 1.0], false), ([1.0, 3.0], false)]
    {
        let (mut lengths, mut state) = (Lengths::default(), State::default());
        (0..10).for_each(|i| _ = person(&mut state, &settled(&mut lengths, frame(i))));
        let mut raw = frame(10);
        stretch(&mut raw, 0, factors);
        let out = settled(&mut lengths, raw);
        assert_eq!(out.confidence[18].min(out.confidence[20]) >= 0.5, used, "{factors:?}");
        assert_eq!((out.confidence[19], out.confidence[21]), (1.0, 1.0), "{factors:?}");
        let flags = person(&mut state, &out).expect("the frame is used").flags;
        let [upper, fore] = [skeleton_flag::LIMB[0], skeleton_flag::LIMB[1]];
        assert_eq!(flags & (upper | fore) == upper | fore, used, "{factors:?}");
        assert_eq!(flags & skeleton_flag::ALL & !(upper | fore), skeleton_flag::ALL & !(upper | fore), "{factors:?}");
    }
}

#[test]
fn other_person_has_lengths_of_their_own() {
    let mut lengths = Lengths::default();
    (0..100).for_each(|i| _ = settled(&mut lengths, frame(i)));
    let mut other = frame(100);
    (0..2).for_each(|side| stretch(&mut other, side, [1.2, 1.1]));
    other.operator_id += 1;
    let out = settled(&mut lengths, other);
    assert!((bone(&out, BONES[0]).norm() / bone(&other, BONES[0]).norm() - 1.0).abs() < 1e-5);
}

#[test]
fn joints_that_coincide_at_first_teach_no_length() {
    let mut lengths = Lengths::default();
    let mut first = frame(0);
    (0..2).for_each(|side| stretch(&mut first, side, [1.0, 0.0]));
    assert!(settled(&mut lengths, first).confidence[20] < 0.5);
    let out = settled(&mut lengths, frame(1));
    assert!((bone(&out, BONES[1]).norm() / bone(&frame(1), BONES[1]).norm() - 1.0).abs() < 1e-5);
}

/// The same posture of a smaller body, which trembles: a frame that repeats teaches nothing.
fn smaller(i: u64, factor: f32) -> RawSkeleton {
    let mut raw = frame(i);
    let tremble = 1.0 + 1e-4 * (i % 7) as f32;
    raw.positions[..22].as_flattened_mut().iter_mut().for_each(|x| *x *= factor * tremble);
    raw
}

#[test]
fn f016_body_of_another_size_is_another_person() {
    for (factor, is_other) in [(0.85, false), (0.66, true), (1.5, true)] {
        let mut lengths = Lengths::default();
        (0..100).for_each(|i| _ = settled(&mut lengths, smaller(i, 1.0)));
        let mut refused = Vec::new();
        for i in 100..130 {
            let mut raw = smaller(i, factor);
            if !lengths.settle(CAMERA, 0.5, Some(OTHER_NS), &mut raw) {
                assert_eq!(raw.positions[..22], smaller(i, factor).positions[..22], "frame {i} stays as it is");
                refused.push(i);
            }
        }
        assert_eq!(!refused.is_empty(), is_other, "{factor}");
        if is_other {
            let (first, last) = (refused[0], refused[refused.len() - 1]);
            assert!((103..=112).contains(&first) && (7..=9).contains(&(last - first)), "{factor}: {first} to {last}");
            let trunk = |raw: &RawSkeleton| bone(raw, [1, 16]).norm();
            let settled = settled(&mut lengths, smaller(130, factor));
            assert!((trunk(&settled) / trunk(&smaller(130, factor)) - 1.0).abs() < 1e-3, "{factor}: its own lengths");
        }
    }
    // One image of another size, and a wrong first one, refuse nobody.
    let mut lengths = Lengths::default();
    for i in 0..60 {
        let mut raw = smaller(i, if i == 0 || i == 40 { 0.5 } else { 1.0 });
        assert!(lengths.settle(CAMERA, 0.5, Some(OTHER_NS), &mut raw), "frame {i}");
        let trunk = |raw: &RawSkeleton| bone(raw, [1, 16]).norm();
        assert!(i < 15 || (trunk(&raw) / trunk(&frame(i)) - 1.0).abs() < 0.06, "frame {i}");
    }
}
