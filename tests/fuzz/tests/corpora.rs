//! Runs every target over its stored inputs, over good ones, and over seeded changes of both. The executions are
//! the same each time. Environment variables can request more of them.

use fuzz_targets::{TARGETS, run, seeds};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::path::Path;
use std::time::{Duration, Instant};

/// Number of changed inputs per target. `FUZZ_EXECUTIONS` sets more. `FUZZ_SECONDS` sets a duration.
const EXECUTIONS: usize = 1500;
/// Longest input that changes can make.
const LENGTH_MAX: usize = 4096;
/// Largest memory that any input may use, kB.
const MEMORY_MAX_KB: u64 = 512 << 10;

fn stored(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut files: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files.iter().map(|file| std::fs::read(file).expect("a stored input")).collect()
}

/// Returns an input with one to eight changes of the kinds that libFuzzer makes.
fn changed(inputs: &[Vec<u8>], rng: &mut Pcg64) -> Vec<u8> {
    let mut input = inputs[rng.random_range(0..inputs.len())].clone();
    for _ in 0..rng.random_range(1..=8) {
        let at = rng.random_range(0..=input.len());
        let end = (at + rng.random_range(1..=16)).min(input.len());
        match rng.random_range(0..7) {
            0 if at < input.len() => input[at] ^= 1 << rng.random_range(0..8),
            1 if at < input.len() => input[at] = rng.random(),
            2 => input.insert(at, rng.random()),
            3 => drop(input.drain(at..end)),
            4 => {
                let copy = input[at..end].to_vec();
                input.splice(at..at, copy);
            }
            5 => {
                let other = &inputs[rng.random_range(0..inputs.len())];
                let from = rng.random_range(0..=other.len());
                input.truncate(at);
                input.extend(&other[from..]);
            }
            _ => {
                let special = [0, 1, 0x7f, 0x80, 0xff][rng.random_range(0..5)];
                input[at..end].fill(special);
            }
        }
    }
    input.truncate(LENGTH_MAX);
    input
}

/// Returns the peak memory of this process, kB. `None` if there is no Linux /proc.
fn peak_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().trim_end_matches(" kB").parse().ok()
}

fn exercise(target: &str) {
    let asked = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<usize>().ok());
    let least = asked("FUZZ_EXECUTIONS").unwrap_or(EXECUTIONS);
    let until = Instant::now() + Duration::from_secs(asked("FUZZ_SECONDS").unwrap_or(0) as u64);
    let mut inputs = stored(target);
    assert!(!inputs.is_empty(), "{target} has no stored input");
    inputs.extend(seeds::for_target(target));
    for input in &inputs {
        run(target, input);
    }
    let mut rng = Pcg64::seed_from_u64(104);
    let mut executions = 0;
    while executions < least || Instant::now() < until {
        run(target, &changed(&inputs, &mut rng));
        executions += 1;
    }
    let peak = peak_kb().unwrap_or(0);
    println!("{target}: {} inputs, {executions} changes of them, at most {} MB", inputs.len(), peak >> 10);
    assert!(peak <= MEMORY_MAX_KB, "{peak} kB");
}

#[test]
fn every_target_has_a_test_and_a_fuzzer() {
    let here = include_str!("corpora.rs");
    let fuzzers = include_str!("../libfuzzer/Cargo.toml");
    for (target, _) in TARGETS {
        assert!(here.contains(&format!("exercise(\"{target}\")")), "{target}");
        assert!(fuzzers.contains(&format!("name = \"{target}\"")), "{target}");
    }
}

#[test]
fn f001_f002_f003_f014_f018_skeleton_bits_are_dropped_or_valid() {
    exercise("skeleton");
}

#[test]
fn f001_f097_any_layout_bits_and_text_are_refused_or_valid() {
    exercise("layouts");
}

#[test]
fn f018_any_packet_on_a_socket_is_a_whole_frame_or_refused() {
    exercise("door");
}

#[test]
fn f104_any_bytes_of_a_bvh_give_a_motion_or_an_error() {
    exercise("bvh");
}

#[test]
fn f104_any_bytes_of_an_npy_give_a_motion_or_an_error() {
    exercise("npy");
}

#[test]
fn f096_f104_any_bytes_of_a_recording_give_a_motion_or_an_error() {
    exercise("mcap");
}

#[test]
fn f001_f018_any_packets_of_mvn_are_a_person_or_refused() {
    exercise("mvn");
}

#[test]
fn f001_f018_any_packets_of_vmc_are_a_person_or_refused() {
    exercise("vmc");
}

#[test]
fn f096_f104_any_bytes_of_an_npz_give_a_motion_or_an_error() {
    exercise("npz");
}

#[test]
fn f099_f100_any_robot_text_gives_plausible_limits_or_an_error() {
    exercise("robot");
}

#[test]
fn f097_f098_any_text_of_settings_is_within_bounds_or_refused() {
    exercise("settings");
}

#[test]
fn f093_f096_any_bytes_of_weights_are_refused_or_match_hash() {
    exercise("weights");
}

#[test]
fn f068_f069_any_operator_packets_leave_at_most_one_holder() {
    exercise("operator");
}

#[test]
fn f071_any_input_keeps_the_state_machine_to_its_rules() {
    exercise("engage");
}

#[test]
fn f039_f040_any_proposal_leaves_the_setpoint_within_limits() {
    exercise("gate");
}
