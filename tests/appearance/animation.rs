//! The short animation of the page in README: a browser's pictures, joined in an animated WebP.

use super::{Shown, loaded, played, shown};
use crate::browser::{Browser, decode_base64};
use serde_json::json;

/// Part of the built-in motion that is shown, s. At first the robot is behind, then it follows.
const SPAN_S: [f64; 2] = [2.5, 8.5];
/// Picture rate, Hz. It is low, so that the file is small.
const RATE_HZ: f64 = 10.0;
/// Size of the page, and scale of the animation.
const PAGE: [u32; 2] = [1280, 720];
const SCALE: f64 = 0.75;
/// Quality of a picture, 0 to 100. Letters are still readable.
const QUALITY: u32 = 60;
/// Largest file, bytes. README loads with it.
const BYTES_MAX: usize = 1_500_000;

fn chunk(tag: &[u8; 4], body: &[u8]) -> Vec<u8> {
    let mut all = tag.to_vec();
    all.extend((body.len() as u32).to_le_bytes());
    all.extend(body);
    all.resize(all.len().next_multiple_of(2), 0);
    all
}

fn three(value: u32) -> [u8; 3] {
    let [a, b, c, _] = value.to_le_bytes();
    [a, b, c]
}

/// Returns the chunks of a still WebP that hold its pixels.
fn pixels(picture: &[u8]) -> Vec<u8> {
    assert!(picture.starts_with(b"RIFF") && picture[8..12] == *b"WEBP", "not a WebP");
    let (mut all, mut rest) = (Vec::new(), &picture[12..]);
    while let Some((head, after)) = rest.split_at_checked(8) {
        let length = u32::from_le_bytes(head[4..].try_into().expect("four bytes")) as usize;
        if matches!(&head[..4], b"ALPH" | b"VP8 " | b"VP8L") {
            all.extend(chunk(head[..4].try_into().expect("four bytes"), &after[..length]));
        }
        rest = after.get(length.next_multiple_of(2)..).unwrap_or_default();
    }
    all
}

/// Joins still WebP pictures in one file. Each is shown for `every_ms` milliseconds. The container is that of
/// <https://developers.google.com/speed/webp/docs/riff_container>.
fn animated(pictures: &[Vec<u8>], [width, height]: [u32; 2], every_ms: u32) -> Vec<u8> {
    let (has_animation, for_ever, not_blended) = (0x02, 0_u16, 0x02);
    let size = [three(width - 1), three(height - 1)].concat();
    let mut body = b"WEBP".to_vec();
    body.extend(chunk(b"VP8X", &[&[has_animation, 0, 0, 0], size.as_slice()].concat()));
    body.extend(chunk(b"ANIM", &[[255; 4].as_slice(), &for_ever.to_le_bytes()].concat()));
    for picture in pictures {
        let corner = [0; 6];
        let head = [corner.as_slice(), &size, &three(every_ms), &[not_blended]].concat();
        body.extend(chunk(b"ANMF", &[head, pixels(picture)].concat()));
    }
    chunk(b"RIFF", &body)
}

fn picture(browser: &mut Browser) -> Vec<u8> {
    let clip = json!({ "x": 0, "y": 0, "width": PAGE[0], "height": PAGE[1], "scale": SCALE });
    let with = json!({ "format": "webp", "quality": QUALITY, "clip": clip });
    let shot = browser.ask("Page.captureScreenshot", &with);
    decode_base64(shot["data"].as_str().expect("a picture"))
}

#[test]
#[ignore = "makes a file of the documents: cargo test --release --test system short_animation -- --ignored"]
fn short_animation_of_the_page_is_made() {
    let asked = std::env::var_os("TELEOPD_ANIMATION");
    let (loaded, view) = (loaded(), shown());
    let Some(mut shown) = Shown::open(played(&loaded, 1.0, SPAN_S[1] + 1.0), &view) else { return };
    shown.browser.resize(PAGE[0], PAGE[1]);
    // The arms are widest at the beginning. The camera stays.
    shown.at(SPAN_S[0]);
    shown.hold_camera();
    // Without a request for the whole animation, two pictures test that it can be made.
    let count = if asked.is_some() { ((SPAN_S[1] - SPAN_S[0]) * RATE_HZ) as u32 } else { 2 };
    let pictures: Vec<Vec<u8>> = (0..count)
        .map(|n| {
            shown.seek(SPAN_S[0] + f64::from(n) / RATE_HZ);
            shown.stands();
            shown.both_inside();
            picture(&mut shown.browser)
        })
        .collect();
    let size = PAGE.map(|pixels| (f64::from(pixels) * SCALE) as u32);
    let file = animated(&pictures, size, (1000.0 / RATE_HZ) as u32);
    println!("{} pictures, {} kB", pictures.len(), file.len() / 1000);
    assert!(file.len() < BYTES_MAX, "{} bytes", file.len());
    // A browser can read it.
    let bytes: Vec<String> = file.iter().map(u8::to_string).collect();
    let found = shown.browser.evaluate_async(&format!(
        "const decoder = new ImageDecoder({{ type: 'image/webp', data: new Uint8Array([{}]) }}); \
         await decoder.tracks.ready; await decoder.completed; const {{ image }} = await decoder.decode({{ frameIndex: {} }}); \
         return [decoder.tracks.selectedTrack.frameCount, image.displayWidth, image.displayHeight];",
        bytes.join(","),
        count - 1
    ));
    assert_eq!(found, json!([count, size[0], size[1]]));
    if let Some(path) = asked {
        std::fs::write(path, file).expect("the animation");
    }
}
