//! Layouts from files, the filter, and the mirrored person.

use crate::before_camera::frame;
use crate::support::{self, input_config, write_settings};
use config::{Loaded, Overrides, Settings, load};
use ingest::Filter;
use messages::{RawSkeleton, Skeleton, Smpl, Stamp};
use skeleton::DropReason;
use std::path::{Path, PathBuf};

/// The shipped settings with these layouts, in their own folder.
fn with(layouts: &[&str], folder: &Path) -> Result<Loaded, String> {
    let listed = format!("layouts = {layouts:?}");
    let path = write_settings(folder, |text| text.replace("layouts = []", &listed));
    load(&path, Overrides::default()).map_err(|error| error.to_string())
}

fn shipped(name: &str) -> String {
    support::shipped("skeletons").join(name).display().to_string()
}

#[test]
fn shipped_layouts_are_read_and_change_hash() {
    let folder = tempfile::tempdir().expect("a folder");
    let none = with(&[], folder.path()).expect("none");
    assert!(none.layouts.find(1038).is_none());
    let names = ["zed_body_38.toml", "openxr_fb_70.toml", "smpl_y_up.toml", "coco_17_image.toml"].map(shipped);
    let all = with(&names.each_ref().map(String::as_str), folder.path()).expect("all");
    for (number, name) in [(1038, "zed-body-38"), (1070, "openxr-fb-70"), (1024, "smpl-y-up"), (1017, "coco-17-image")]
    {
        assert_eq!(all.layouts.find(number).map(layouts::Map::name), Some(name));
    }
    assert!(names.iter().all(|name| all.files.contains(&PathBuf::from(name))));
    assert_eq!(std::fs::read_dir(support::shipped("skeletons")).expect("shipped").count(), names.len());
    // The text of the file counts, not only its name.
    let own = folder.path().join("own.toml");
    std::fs::copy(&names[0], &own).expect("copied");
    let before = with(&["own.toml"], folder.path()).expect("a copy, named relative to the settings").hash;
    let text = std::fs::read_to_string(&own).expect("there").replace("\"mm\"", "\"cm\"");
    std::fs::write(&own, text).expect("changed");
    assert_ne!(with(&["own.toml"], folder.path()).expect("another one").hash, before);
}

#[test]
fn f097_missing_wrong_or_duplicate_layout_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let zed = shipped("zed_body_38.toml");
    let refused = |layouts: &[&str]| with(layouts, folder.path()).expect_err("refused");
    assert!(refused(&["nowhere.toml"]).contains("nowhere.toml"));
    assert!(refused(&["."]).contains("is not a regular file"));
    let refusal = refused(&[&zed, &zed]);
    assert!(refusal.contains("zed_body_38.toml: number = 1038") && refusal.contains("zed-body-38 has it"), "{refusal}");
    let refusal = refused(&[zed.as_str(); 17]);
    assert!(refusal.contains("teleop.toml: ingest.layouts has 17 entries, at most 16 are allowed"), "{refusal}");
    let text = std::fs::read_to_string(&zed).expect("shipped").replace("x = \"left\"", "x = \"right\"");
    std::fs::write(folder.path().join("mirrored.toml"), text).expect("written");
    let refusal = refused(&["mirrored.toml"]);
    assert!(refusal.contains("mirrored.toml: handedness = \"right\""), "{refusal}");
    assert!(refusal.contains("determinant -1"), "{refusal}");
}

/// Shows the first frames of the built-in motion at 60 Hz, each after `change`. Returns the stage and the last person.
fn play(
    edit: impl FnOnce(&mut Settings),
    frames: u64,
    change: impl Fn(u64, &mut RawSkeleton),
) -> (ingest::State, Option<Skeleton>) {
    let motion = motion::builtin();
    let calibration = motion::calibrate(&motion, motion::CalibrationMode::First10s);
    let mut loaded = support::loaded();
    edit(&mut loaded.settings);
    let config = input_config(&loaded);
    let (mut state, mut last) = (ingest::State::default(), None);
    for i in 0..frames {
        let mut raw = motion::raw_frame(&motion, i as usize, &calibration);
        (raw.session_nonce, raw.header.sequence) = (7, i + 1);
        raw.header.origin = Stamp(1_000_000_000 + 16_666_667 * i);
        change(i, &mut raw);
        last = ingest::tick(&config, &mut state, raw.header.origin.plus_ns(1_000_000), &raw).skeleton;
    }
    (state, last)
}

#[test]
fn f017_outliers_are_counted_only_where_settings_enable_filter() {
    let found = |filter: Filter, outliers_mad: f64| {
        let (state, _) = play(
            |Settings { ingest, .. }| (ingest.filter, ingest.filter_outliers_mad) = (filter, outliers_mad),
            60,
            |i, raw| raw.positions[Smpl::LeftWrist as usize][0] += if i == 40 { 0.08 } else { 0.0 },
        );
        (state.outliers(), state.skeleton.dropped(DropReason::LengthStep))
    };
    assert_eq!(found(Filter::All, 3.0), (1, 0));
    assert_eq!(found(Filter::All, 0.0).0, 0);
    let (outliers, dropped) = found(Filter::Cameras, 3.0);
    assert!(outliers == 0 && dropped > 0, "what is measured is passed on as it is: {outliers}, {dropped}");
}

#[test]
fn mirrored_person_waves_with_other_hand() {
    // The right hand waves from 5 s on.
    let waving = |mirror: bool| play(|settings| settings.ingest.mirror = mirror, 330, |_, _| ()).1.expect("a person");
    let (person, image) = (waving(false), waving(true));
    let heights =
        |person: &Skeleton| [Smpl::LeftWrist, Smpl::RightWrist].map(|wrist| person.positions[wrist as usize][2]);
    let [left, right] = heights(&person);
    assert!(right > left + 0.3, "the right hand waves: {left} m, {right} m");
    assert_eq!(heights(&image), [right, left]);
    let [x, y, z, w] = person.limbs[messages::Limb::RightFore as usize];
    assert_eq!(image.limbs[messages::Limb::LeftFore as usize], [0.0 - x, y, 0.0 - z, w]);
    assert_eq!(image.flags, person.flags | messages::skeleton_flag::IMAGE, "both arms are seen");
}

/// A person before a camera, whose landmarks in the image are this far aside. They tremble, as a real landmarker's do.
fn before_camera(aside: f32, n: u64) -> RawSkeleton {
    let mut raw = frame();
    for landmark in &mut raw.positions[..66] {
        landmark[1] += 1e-3 * (n % 7) as f32;
    }
    for landmark in &mut raw.positions[33..66] {
        landmark[0] += aside;
    }
    raw.session_nonce = 1;
    raw.header.sequence = n + 1;
    raw
}

#[test]
fn f016_another_person_in_the_image_is_a_new_one_whatever_the_stamps() {
    let settings = input_config(&support::loaded());
    // Delays of the first person's and the second one's frames, and how far ahead the first frame of the second one says to be, ms.
    for (first_lag, lag, ahead) in [(30, 30, 0), (60, 20, 0), (90, 30, 0), (30, 30, 500), (30, 30, 3_600_000)] {
        let mut state = ingest::State::default();
        let (mut first, mut second, mut refused, mut now) = (None, None, 0, Stamp::NONE);
        for n in 0..150 {
            let is_second = n >= 90;
            let mut raw = before_camera(if is_second { 0.15 } else { 0.0 }, n);
            let seen_ms = 10_000 + n * 33;
            let lag_ms = if is_second { lag } else { first_lag };
            let more_ms = if n == 90 { ahead } else { 0 };
            raw.header.origin = Stamp((seen_ms + more_ms) * 1_000_000);
            // A later frame does not overtake.
            now = now.max(Stamp((seen_ms + lag_ms) * 1_000_000));
            let person = ingest::tick(&settings, &mut state, now, &raw).skeleton;
            assert!(person.is_none_or(|person| person.flags & messages::skeleton_flag::ONE_CAMERA != 0));
            match person {
                Some(skeleton) if is_second => second = second.or(Some(skeleton.operator_id)),
                Some(skeleton) => first = Some(skeleton.operator_id),
                None => refused += 1,
            }
        }
        let context = format!("{first_lag} to {lag} ms, {ahead} ms ahead: {first:?}, {second:?}, {refused} refused");
        assert!(first.is_some() && second.is_some() && first != second, "{context}");
        assert!((7..14).contains(&refused), "{context}");
    }
}
