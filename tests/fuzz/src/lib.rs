//! Fuzz targets: each takes any bytes, feeds them to one door of the product or to one of its deciders, and panics if
//! what comes out breaks a promise. libFuzzer runs them (`libfuzzer`), and so does a plain test over the stored inputs
//! and over seeded changes of them (`tests/corpora.rs`).

mod bytes;
mod door;
mod engage;
mod files;
mod frames;
mod gate;
mod operators;
mod robots;
pub mod seeds;
mod settings;
mod skeletons;
mod udp;
mod weights;

/// A target: its name, which is also that of its folder of stored inputs, and what it runs.
pub type Target = (&'static str, fn(&[u8]));

/// Every target.
pub const TARGETS: [Target; 15] = [
    ("skeleton", skeletons::run),
    ("layouts", frames::run),
    ("door", door::run),
    ("bvh", files::bvh),
    ("npy", files::npy),
    ("npz", files::npz),
    ("mcap", files::mcap),
    ("mvn", udp::mvn),
    ("vmc", udp::vmc),
    ("robot", robots::run),
    ("settings", settings::run),
    ("weights", weights::run),
    ("operator", operators::run),
    ("engage", engage::run),
    ("gate", gate::run),
];

/// Runs the target of this name.
///
/// # Panics
/// If a promise is broken, or there is no such target.
pub fn run(target: &str, input: &[u8]) {
    let (_, run) = TARGETS.iter().find(|(name, _)| *name == target).expect("a target of this name");
    run(input);
}
