//! The shipped robots beside the person: from their look, or from their capsules.

use super::{Shown, played};
use crate::browser::decode_base64;
use config::Overrides;
use serde_json::json;
use view::RobotView;

/// Robots of config/robots, from 0.7 m to 1.8 m high.
const ROBOTS: &str = "tiago_dual unitree_g1 openarm_v10 franka_fr3_duo rby1a unitree_h1 ur5e_pair \
                      viperx_pair reachy_2 booster_t1 tiago_pro";
/// A laptop and a phone.
const SIZES: [[u32; 2]; 2] = [[1280, 720], [390, 844]];
/// The closed form needs no weights.
const METHOD: &str = "[retarget]\nmethod = \"closed-form\"\n";

/// Also writes a picture of each robot into the folder of TELEOPD_PICTURES, as NAME.webp.
#[test]
#[ignore = "draws for a minute: cargo test --release --test system every_shipped_robot -- --ignored"]
fn every_shipped_robot_is_in_the_frame_with_the_person() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("teleop.toml");
    harness::write_settings(&harness::config(), METHOD, &config).expect("settings");
    for name in ROBOTS.split(' ') {
        let overrides = Overrides { engage_without_realtime: true, robot: Some(name.into()), ..Overrides::default() };
        let loaded = config::load(&config, overrides).unwrap_or_else(|error| panic!("{name}: {error}"));
        let view = RobotView::load(&loaded, None).expect("a look or none");
        let Some(mut shown) = Shown::open(played(&loaded, 1.0, 9.0), &view) else { return };
        for [width, height] in SIZES {
            shown.browser.resize(width, height);
            // Arms stretched to the sides, and one arm up.
            for at_s in [1.0, 7.0] {
                shown.at(at_s);
                let [_, [left, bottom, right, top]] = shown.both_inside();
                let large = (right - left).max(top - bottom);
                println!("{name}: {width} x {height}, {at_s} s: {:.2} x {:.2}", right - left, top - bottom);
                assert!(large > 0.3, "{name}: {width} x {height}, {at_s} s: the robot is tiny, {large}");
            }
        }
        if let Some(pictures) = std::env::var_os("TELEOPD_PICTURES") {
            let [width, height] = SIZES[0];
            shown.browser.resize(width, height);
            shown.at(7.0);
            let [left, top, right, bottom] = Shown::edges(&mut shown.browser, "#stage");
            let clip = json!({ "x": left, "y": top, "width": right - left, "height": bottom - top, "scale": 1 });
            let with = json!({ "format": "webp", "quality": 80, "clip": clip });
            let shot = shown.browser.ask("Page.captureScreenshot", &with);
            let picture = decode_base64(shot["data"].as_str().expect("a picture"));
            std::fs::write(std::path::Path::new(&pictures).join(format!("{name}.webp")), picture).expect("written");
        }
    }
}
