//! One source for all fuzzers: the target is the program's own name.
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz_targets::run(env!("CARGO_BIN_NAME"), input));
