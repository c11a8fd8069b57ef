//! Layouts: any layout file, and any bits of a frame of each layout.

use crate::bytes::Bytes;
use crate::skeletons::{WORDS, set};
use config::Settings;
use layouts::{Layouts, Map};
use messages::{CUSTOM_LAYOUTS, Layout, RawSkeleton, SMPL_JOINTS, SkeletonLayout, Stamp, raw_flag};
use skeleton::DropReason;
use std::sync::LazyLock;

pub(crate) const FILES: [&str; 3] = [
    include_str!("../../../config/skeletons/zed_body_38.toml"),
    include_str!("../../../config/skeletons/openxr_fb_70.toml"),
    include_str!("../../../config/skeletons/smpl_y_up.toml"),
];

static SHIPPED: LazyLock<ingest::Config> = LazyLock::new(|| {
    let mut layouts = Layouts::default();
    for text in FILES {
        layouts.add("shipped", Map::parse("shipped", text).expect("shipped")).expect("numbers of their own");
    }
    with(layouts)
});

/// Returns the shipped settings with these layouts.
fn with(layouts: Layouts) -> ingest::Config {
    let settings = Settings::parse("teleop.toml", crate::settings::TEXT).expect("shipped");
    world::input_config(&settings.ingest, layouts, &config::Operators::default(), None)
}

/// Runs the input. The first byte selects the meaning of the others. 0: a file. 1: changes of a shipped file
/// (length, place, number of bytes removed, bytes inserted). Else a frame: its layout, its flags, and overwritten
/// words (place, bits).
pub(crate) fn run(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    match kind {
        0 => file(&String::from_utf8_lossy(rest)),
        1 => file(&changed(rest)),
        _ => frame(&SHIPPED, rest),
    }
}

fn changed(rest: &[u8]) -> String {
    let mut bytes = Bytes::new(rest);
    let mut text = FILES[usize::from(bytes.u8()) % FILES.len()].as_bytes().to_vec();
    while !bytes.is_empty() {
        let (length, place, out) =
            (usize::from(bytes.u8() % 32), usize::from(bytes.u16()), usize::from(bytes.u8() % 32));
        let place = place % (text.len() + 1);
        let end = (place + out).min(text.len());
        text.splice(place..end, bytes.take(length).iter().copied());
    }
    String::from_utf8_lossy(&text).into_owned()
}

/// Checks that the file is rejected by name, or that it is a layout whose frames are rejected or good.
fn file(text: &str) {
    let map = match Map::parse("layout.toml", text) {
        Ok(map) => map,
        Err(error) => {
            assert!(error.to_string().contains("layout.toml"), "names no file: {error}");
            return;
        }
    };
    assert!(CUSTOM_LAYOUTS.contains(&map.number()), "{}", map.number());
    let number = map.number().to_le_bytes();
    let mut layouts = Layouts::default();
    layouts.add("layout.toml", map).expect("a number of its own");
    let config = with(layouts);
    for count in 1..=96 {
        for flags in [0, raw_flag::ROTATIONS, raw_flag::ROTATIONS | raw_flag::LOCAL] {
            frame(&config, &[&number[..2], &[count, flags as u8]].concat());
        }
    }
}

fn frame(config: &ingest::Config, rest: &[u8]) {
    let mut bytes = Bytes::new(rest);
    let mut raw = RawSkeleton::ZERO;
    raw.header.origin = Stamp(1_000_000_000);
    raw.layout = u32::from(bytes.u16());
    raw.joint_count = u32::from(bytes.u8());
    raw.flags = u32::from(bytes.u8());
    raw.confidence.fill(1.0);
    raw.rotations.fill([0.0, 0.0, 0.0, 1.0]);
    while !bytes.is_empty() {
        set(&mut raw, usize::from(bytes.u16()) % WORDS, bytes.u32());
    }
    if let Ok(out) = config.layouts.convert(&raw) {
        assert_eq!(out.layout, SkeletonLayout::Smpl22 as u32);
        if raw.layout != out.layout {
            assert_eq!(out.joint_count as usize, SMPL_JOINTS);
            assert_eq!(out.flags & raw_flag::LOCAL, 0, "local rotations became global ones");
        }
        assert_eq!((out.header, out.session_nonce, out.operator_id), (raw.header, raw.session_nonce, raw.operator_id));
    }
    let mut state = ingest::State::default();
    let out = ingest::tick(config, &mut state, Stamp(1_001_000_000), &raw);
    assert_eq!(out.skeleton.is_some(), out.drop.is_none(), "accepted or dropped, never both");
    let dropped: u64 = DropReason::ALL.into_iter().map(|reason| state.skeleton.dropped(reason)).sum();
    assert_eq!(state.skeleton.accepted() + dropped, 1, "every frame is counted once");
    if let Some(person) = out.skeleton {
        assert!(person.positions.iter().flatten().all(|x| x.is_finite()), "{:?}", person.positions);
    }
}
