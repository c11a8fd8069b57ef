//! The lifter of a camera's image points: what it gives a frame, and what it refuses.

use crate::before_camera::frame;
use crate::salt::Chance;
use layouts::{
    DIRECTIONS, ImagePoints, LIFTER_OUTPUTS, LIFTER_WIDTHS, LastImage, Layouts, Lift, Lifted, Lifter, LifterManifest,
    Map, POINTS, Point,
};
use messages::{Layout, RawSkeleton, SkeletonLayout, Smpl, Stamp, raw_flag};
use nalgebra::Vector3;
use perceptron::Dense;
use rt::count_allocations;
use std::f64::consts::FRAC_PI_2;

const COCO: &str = include_str!("../../../config/skeletons/coco_17_image.toml");

/// Directions in the trunk's axes (across, up, ahead), then the trunk's across and up in the camera's.
const PERSON: [[f32; 3]; DIRECTIONS] = [
    [1.0, 0.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 0.6, 0.8],
    [0.0, 0.0, 1.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 0.0],
    [0.0, -1.0, 0.0],
];

/// Layers that give a person with these concentrations where the right little finger is hidden, and the mirror image where
/// the left one is: a hidden unit and its opposite carry the difference of what is seen, since silu(z) - silu(-z) = z.
fn layers(person: &[[f32; 3]; DIRECTIONS], concentrations: [f64; DIRECTIONS]) -> Vec<Dense> {
    let dense =
        |w: &[usize]| Dense { inputs: w[0], outputs: w[1], weight: vec![0.0; w[0] * w[1]], bias: vec![0.0; w[1]] };
    let mut layers: Vec<Dense> = LIFTER_WIDTHS.windows(2).map(dense).collect();
    let fingers = [Point::LeftPinky, Point::RightPinky].map(|point| 2 * POINTS + point as usize);
    for (layer, from) in layers.iter_mut().zip([fingers, [0, 1], [0, 1]]) {
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            layer.weight[row * layer.inputs + from[column]] = if row == column { 1.0 } else { -1.0 };
        }
    }
    let own = Lifted { directions: person.map(|d| Vector3::from(d).map(f64::from)), concentrations };
    let [own, other] = [own, own.mirrored()].map(|it| -> [f32; LIFTER_OUTPUTS] {
        std::array::from_fn(|n| match n % 4 {
            3 => (it.concentrations[n / 4].exp_m1().ln() - 2.0) as f32,
            axis => 0.5 * it.directions[n / 4][axis] as f32,
        })
    });
    let last = layers.last_mut().expect("layers");
    for (n, (own, other)) in own.into_iter().zip(other).enumerate() {
        last.bias[n] = (own + other) / 2.0;
        last.weight[n * last.inputs..][..2].copy_from_slice(&[(own - other) / 2.0, (other - own) / 2.0]);
    }
    layers
}

fn lifted(lifter: &Lifter, layouts: &Layouts, raw: &RawSkeleton) -> RawSkeleton {
    let mut out = layouts.convert(raw).expect("a layout");
    let image = layouts.find(raw.layout).and_then(|map| map.image(raw)).expect("points of an image");
    assert_eq!(lifter.apply(&image, None, Stamp(1), &mut LastImage::default(), &mut out), Lift::Done);
    out
}

fn direction(frame: &RawSkeleton, from: Smpl, to: Smpl) -> Vector3<f32> {
    let [from, to] = [from, to].map(|joint| Vector3::from(frame.positions[joint as usize]));
    (to - from).normalize()
}

#[test]
fn frame_gets_directions_in_our_axes_and_keeps_its_lengths() {
    let (layouts, lifter) = (Layouts::default(), Lifter::new(&layers(&PERSON, [50.0; DIRECTIONS])));
    let before = layouts.convert(&frame()).expect("a layout");
    let after = lifted(&lifter, &layouts, &frame());
    // The person's left is y, up z, and ahead x.
    for (from, to, want) in [
        (Smpl::LeftShoulder, Smpl::LeftElbow, [0.0, 1.0, 0.0]),
        (Smpl::RightShoulder, Smpl::RightElbow, [0.0, 0.0, -1.0]),
        (Smpl::LeftElbow, Smpl::LeftWrist, [0.8, 0.0, 0.6]),
        (Smpl::RightElbow, Smpl::RightWrist, [1.0, 0.0, 0.0]),
        (Smpl::RightShoulder, Smpl::LeftShoulder, [0.0, 1.0, 0.0]),
        (Smpl::RightHip, Smpl::LeftHip, [0.0, 1.0, 0.0]),
    ] {
        let off = (direction(&after, from, to) - Vector3::from(want)).norm();
        assert!(off < 1e-5, "{from:?} to {to:?} is off by {off}");
        if (from as usize) > Smpl::RightHip as usize && from != Smpl::RightShoulder {
            let long = |frame: &RawSkeleton| {
                (Vector3::from(frame.positions[to as usize]) - Vector3::from(frame.positions[from as usize])).norm()
            };
            assert!((long(&after) - long(&before)).abs() < 1e-5, "{from:?} to {to:?}");
        }
    }
    assert_eq!(after.positions[Smpl::LeftKnee as usize], before.positions[Smpl::LeftKnee as usize]);
}

#[test]
fn mirrored_image_shows_the_same_person() {
    let layouts = Layouts::default();
    let map = layouts.find(SkeletonLayout::MediaPipe66 as u32).expect("built in");
    let mut raw = frame();
    raw.positions[33 + 15] = [0.3, -0.1, 0.0];
    let mut mirrored = RawSkeleton { flags: raw_flag::MIRRORED, ..raw };
    for n in 33..66 {
        let other = if n == 33 { n } else { ((n - 34) ^ 1) + 34 };
        // The face's landmarks are not pairs of neighbours: those of its points are taken one by one.
        let other = match n - 33 {
            2 => 33 + 5,
            5 => 33 + 2,
            7 => 33 + 8,
            8 => 33 + 7,
            11.. => ((n - 44) ^ 1) + 44,
            _ => other,
        };
        let [x, y, z] = raw.positions[other];
        (mirrored.positions[n], mirrored.confidence[n]) = ([-x, y, z], raw.confidence[other]);
    }
    assert_eq!(map.image(&mirrored), map.image(&raw));
}

#[test]
fn mirror_image_is_lifted_to_the_mirrored_person() {
    let mut layers = layers(&PERSON, [9.0; DIRECTIONS]);
    layers[3].bias[1] += 0.4; // Both sides differ.
    let image = ImagePoints { points: [[0.1, 0.2]; POINTS], seen: [1.0; POINTS] };
    let [own, other] = [image, image.mirrored()].map(|image| Lifter::new(&layers).lift(&image, None).expect("numbers"));
    assert!((own.directions[0] - other.mirrored().directions[0]).norm() < 1e-6, "{own:?} {other:?}");
    assert!(own.concentrations[0] < 8.9, "both sides disagree, so it is less sure: {own:?}");
}

#[test]
fn doubt_of_an_arm_lowers_its_confidence_alone() {
    // Expected angles of 9 and 45 degrees, and of more than a right angle.
    let k = |deg: f64| FRAC_PI_2 / deg.to_radians().powi(2);
    let layers = layers(&PERSON, [k(9.0), k(45.0), k(9.0), k(45.0), 50.0, 50.0, 50.0, 50.0]);
    let after = lifted(&Lifter::new(&layers), &Layouts::default(), &frame());
    for (joint, want) in
        [(Smpl::LeftElbow, 0.9), (Smpl::LeftWrist, 0.9), (Smpl::RightElbow, 0.5), (Smpl::RightWrist, 0.5)]
    {
        assert!((after.confidence[joint as usize] - want).abs() < 1e-4, "{joint:?}");
    }
    assert_eq!(after.confidence[Smpl::LeftShoulder as usize], 1.0);
    let wild = Lifted::new(&[f32::NAN; LIFTER_OUTPUTS]);
    assert!(wild.is_none() && Lifted::new(&[0.0; LIFTER_OUTPUTS]).is_none());
}

#[test]
fn layout_of_image_points_alone_gives_a_person() {
    let mut layouts = Layouts::default();
    let map = Map::parse("coco.toml", COCO).expect("shipped");
    assert!(map.is_flat() && !layouts.find(4).expect("built in").is_flat());
    layouts.add("coco.toml", map).expect("a number of its own");
    let mut raw = RawSkeleton { layout: 1017, joint_count: 17, ..RawSkeleton::ZERO };
    let body = frame();
    for (point, landmark) in [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28].into_iter().enumerate() {
        (raw.positions[point], raw.confidence[point]) = (body.positions[33 + landmark], 1.0);
    }
    let after = lifted(&Lifter::new(&layers(&PERSON, [50.0; DIRECTIONS])), &layouts, &raw);
    let skeleton = skeleton::Config { length_change_max: f64::INFINITY, ..skeleton::Config::default() };
    let mut state = skeleton::State::default();
    let seen = (1..20).filter_map(|i| {
        let mut raw = after;
        raw.header.sequence = i;
        raw.header.origin.0 = 1_000_000_000 + i * 33_333_333;
        raw.positions[Smpl::LeftWrist as usize][0] += 1e-4 * i as f32;
        skeleton::tick(&skeleton, &mut state, raw.header.origin, skeleton::Input { raw: &raw, stored: None }).skeleton
    });
    assert!(seen.count() > 10, "the person is accepted");
}

#[test]
fn wrong_point_of_a_layout_is_refused_by_name() {
    for (from, to, message) in [
        ("point = \"nose\"", "point = \"snout\"", "coco.toml: joint \"nose\" point = \"snout\" must be one of nose, "),
        ("point = \"left_eye\"", "point = \"nose\"", "must be a point that no other row names"),
        ("point = \"nose\"", "point = \"nose\", is = \"head\"", "must be given without `is` and `half_of`"),
        ("camera = true ", "camera = false", "must be given with camera = true only"),
        ("point = \"left_hip\"", "is = \"left_hip\"", "must be among those that some joint `is`"),
    ] {
        let error = Map::parse("coco.toml", &COCO.replacen(from, to, 1)).expect_err(to).to_string();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn written_network_is_read_and_another_one_refused() {
    // Its last bias is 7, which 16 bits hold.
    let concentration = 9_f64.exp().ln_1p();
    let layers = layers(&PERSON, [concentration; DIRECTIONS]);
    let (tensors, manifest) = Lifter::write(&layers, &LifterManifest::default()).expect("numbers");
    let image = ImagePoints { points: [[0.1, 0.2]; POINTS], seen: [1.0; POINTS] };
    let read = Lifter::read(&manifest, &tensors).expect("as written").lift(&image, None).expect("numbers");
    assert!((read.concentrations[0] - concentration).abs() < 1e-4);
    for (from, to, message) in [
        ("format = 1", "format = 2", "manifest: format is 2, expected 1"),
        ("sha256 = \"", "sha256 = \"0", "sha256 of the tensors is "),
        ("200,", "100,", "manifest: widths is "),
    ] {
        let error = Lifter::read(&manifest.replacen(from, to, 1), &tensors).expect_err(to).to_string();
        assert!(error.starts_with(message), "{error}");
    }
}

/// Lifts images that are 33 ms apart: each with its network. Returns the left upper arm's direction and confidence after each.
fn film(networks: &[&Lifter]) -> Vec<(Vector3<f32>, f32)> {
    let (layouts, mut last) = (Layouts::default(), LastImage::default());
    let mut raw = frame();
    let image = layouts.find(raw.layout).and_then(|map| map.image(&raw)).expect("points of an image");
    let shown = networks.iter().map(|lifter| {
        raw.header.origin.0 += 33_000_000;
        let mut out = layouts.convert(&raw).expect("a layout");
        assert_eq!(lifter.apply(&image, None, raw.header.origin, &mut last, &mut out), Lift::Done);
        (direction(&out, Smpl::LeftShoulder, Smpl::LeftElbow), out.confidence[Smpl::LeftElbow as usize])
    });
    shown.collect()
}

/// A network whose left upper arm points up, with this concentration.
fn raised(concentration: f64) -> Lifter {
    let mut person = PERSON;
    person[0] = [0.0, 1.0, 0.0];
    Lifter::new(&layers(&person, [concentration; DIRECTIONS]))
}

#[test]
fn arm_turns_as_fast_as_its_doubt_permits_and_is_left_out_if_the_doubt_lasts() {
    let aside = Lifter::new(&layers(&PERSON, [50.0; DIRECTIONS]));
    let degrees = |shown: &[(Vector3<f32>, f32)]| {
        let turns = shown.windows(2).map(|pair| pair[0].0.angle(&pair[1].0).to_degrees());
        turns.collect::<Vec<_>>()
    };
    // Sure: 12 rad/s, so a jump by 90 degrees takes four images.
    let sure = raised(50.0);
    let turns = degrees(&film(&[&aside, &sure, &sure, &sure, &sure, &sure]));
    for (turn, want) in turns.iter().zip([22.7, 22.7, 22.7, 21.9, 0.0]) {
        assert!((turn - want).abs() < 0.1, "{turns:?}");
    }
    // Expected to be 35 degrees off: half of it.
    let doubtful = raised(4.21);
    let turns = degrees(&film(&[&aside, &doubtful, &doubtful]));
    assert!(turns.iter().all(|turn| (turn - 11.35).abs() < 0.4), "{turns:?}");
    // A guess: the arm holds, and comes back from there. For 2 s it counts, then no longer. The first image counts little.
    let guess = raised(0.3);
    let shown = film(&[&[&guess; 2][..], &[&aside; 60], &[&guess; 90], &[&aside; 90]].concat());
    assert!(degrees(&shown)[8..].iter().all(|turn| *turn < 0.01), "it holds");
    let counts: Vec<bool> = shown.iter().map(|(_, confidence)| *confidence >= 0.5).collect();
    assert!([1, 8, 61, 76, 151, 241].map(|n| counts[n]) == [false, true, true, true, false, true], "{shown:?}");
}

/// A landmarker that takes a back for a front moves no shoulder at once, and a single swapped image nothing.
#[test]
fn f016_trunk_turns_no_faster_than_a_person() {
    let mut back = PERSON;
    back[6] = PERSON[6].map(|x| -x);
    let [front, behind] = [PERSON, back].map(|person| Lifter::new(&layers(&person, [50.0; DIRECTIONS])));
    let (layouts, mut last, mut raw) = (Layouts::default(), LastImage::default(), frame());
    let image = layouts.find(raw.layout).and_then(|map| map.image(&raw)).expect("points of an image");
    let mut shown = |lifter: &Lifter, ms: u64| {
        raw.header.origin.0 += ms * 1_000_000;
        let (mut out, mut next) = (layouts.convert(&raw).expect("a layout"), last);
        let done = lifter.apply(&image, None, raw.header.origin, &mut next, &mut out);
        last = if done == Lift::Done { next } else { last };
        (done == Lift::Done).then(|| direction(&out, Smpl::RightShoulder, Smpl::LeftShoulder).y)
    };
    assert_eq!((shown(&front, 1000), shown(&behind, 33), shown(&front, 33)), (Some(1.0), None, Some(1.0)));
    assert_eq!(shown(&behind, 33), None);
    assert!(shown(&behind, 33).is_some_and(|across| (across - 0.792_f32.cos()).abs() < 1e-3));
    // From there less than a right angle is left after another image.
    let rest: Vec<_> = (0..6).map(|_| shown(&behind, 33)).collect();
    assert!(
        rest.iter().filter(|across| across.is_none()).count() == 1 && rest[5].is_some_and(|across| across < -0.999)
    );
    // At 25 images a second none is refused: the robot would stop.
    assert!((0..9).all(|_| shown(&front, 40).is_some()));
}

#[test]
fn person_who_was_gone_for_a_quarter_of_a_second_is_believed_at_once() {
    let (layouts, mut last) = (Layouts::default(), LastImage::default());
    let mut raw = frame();
    let image = layouts.find(raw.layout).and_then(|map| map.image(&raw)).expect("points of an image");
    let mut after = |lifter: &Lifter, ms: u64, operator_id: u32| {
        raw.header.origin.0 += ms * 1_000_000;
        raw.operator_id = operator_id;
        let mut out = layouts.convert(&raw).expect("a layout");
        lifter.apply(&image, None, raw.header.origin, &mut last, &mut out);
        direction(&out, Smpl::LeftShoulder, Smpl::LeftElbow).z
    };
    let (aside, up) = (Lifter::new(&layers(&PERSON, [50.0; DIRECTIONS])), raised(50.0));
    assert!(after(&aside, 1000, 1).abs() < 1e-6);
    assert!(after(&up, 260, 1) > 0.999);
    assert!(after(&aside, 33, 1) > 0.3, "it turns slowly");
    assert!(after(&up, 33, 2) > 0.999, "somebody else");
    assert!(after(&aside, 0, 2) > 0.999, "no time, no turn");
}

#[test]
fn f016_trunk_that_jumps_or_glides_in_the_image_is_another_persons() {
    let layouts = Layouts::default();
    let (mut raw, mut last) = (frame(), LastImage::default());
    let lifter = Lifter::new(&layers(&PERSON, [50.0; DIRECTIONS]));
    let mut knows = |aside: f32, factor: f32, ms: u64| {
        let mut shown = frame();
        for place in &mut shown.positions[33..66] {
            *place = [place[0] * factor + aside, place[1] * factor, 0.0];
        }
        let image = layouts.find(raw.layout).and_then(|map| map.image(&shown)).expect("points of an image");
        raw.header.origin.0 += ms * 1_000_000;
        let now = raw.header.origin;
        let mut out = layouts.convert(&raw).expect("a layout");
        let is_other = last.is_other(&image, now, &out);
        if !is_other {
            lifter.apply(&image, None, now, &mut last, &mut out);
        }
        !is_other
    };
    // The trunk has 0.175 of the image's height.
    assert!(knows(0.0, 1.0, 1000));
    assert!(knows(0.09, 1.0, 33), "a step aside");
    assert!(!knows(0.09 + 0.2, 1.0, 33) && !knows(0.09, 2.5, 33), "somebody else");
    assert!(knows(0.09, 1.0, 33), "one image of somebody else changes nothing");
    assert!(knows(0.09 + 0.2, 1.0, 400), "in that time a person walks as far");
    assert!(!knows(-0.3, 1.0, 5000), "but never through half the image");
    assert!(knows(0.29, 1.0, 1000));
    let glides = (1..=5).all(|step| knows(0.29 - 0.09 * step as f32, 1.0, 17));
    assert!(!glides, "nobody walks a metre in a twelfth of a second");
}

#[test]
fn f076_any_bits_lift_without_panic_or_allocation() {
    let (layouts, lifter) = (Layouts::default(), Lifter::new(&layers(&PERSON, [9.0; DIRECTIONS])));
    let map = layouts.find(SkeletonLayout::MediaPipe66 as u32).expect("built in");
    let (mut chance, mut last) = (Chance(3), LastImage::default());
    for round in 0..2_000 {
        let mut raw = frame();
        raw.header.origin.0 = (chance.uniform() * 4e9) as u64;
        for _ in 0..round % 60 {
            let bits = f32::from_bits((chance.uniform() * 4e9) as u32);
            raw.positions[(chance.uniform() * 66.0) as usize][(chance.uniform() * 2.0) as usize] = bits;
            raw.confidence[(chance.uniform() * 66.0) as usize] = f32::from_bits((chance.uniform() * 4e9) as u32);
        }
        let Ok(mut out) = layouts.convert(&raw) else { continue };
        let (_, counted) = count_allocations(|| {
            map.image(&raw).map(|image| {
                let now = Stamp((chance.uniform() * 4e9) as u64);
                (last.is_other(&image, now, &out), lifter.apply(&image, None, now, &mut last, &mut out))
            })
        });
        assert_eq!(counted.allocated, 0);
    }
}
