//! One program for all tests, so that it is linked once.

fn message(sent_ms: f64, age_ms: f64, numbers: &[f32]) -> Vec<u8> {
    let mut bytes = [sent_ms, age_ms].map(f64::to_le_bytes).concat();
    numbers.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    bytes
}

/// Returns a generator of random numbers. They are the same in every run.
fn random() -> impl FnMut() -> usize {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as usize
    }
}

fn damage(bytes: &mut [u8], count: usize, next: &mut impl FnMut() -> usize) {
    for _ in 0..count {
        bytes[next() % bytes.len()] = next() as u8;
    }
}

mod frames;
mod headset;
mod look;
mod meshes;
mod page;
mod recording_view;
mod shares;
mod sight;
