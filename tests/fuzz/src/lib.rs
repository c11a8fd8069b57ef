//! Fuzz targets. Each takes any bytes and feeds them to one input of the product, or to one part that decides. It
//! panics if the result breaks a guarantee. libFuzzer runs them (`libfuzzer`). A plain test also runs them over
//! the stored inputs and over seeded changes of them (`tests/corpora.rs`).

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

/// A target: its name and its function. The name is also that of its folder of stored inputs.
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
/// Panics if a guarantee is broken, or if there is no such target.
pub fn run(target: &str, input: &[u8]) {
    let (_, run) = TARGETS.iter().find(|(name, _)| *name == target).expect("a target of this name");
    run(input);
}
