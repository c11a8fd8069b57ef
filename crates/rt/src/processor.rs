//! The processor's features that the arithmetic of the stages uses to choose its code.

/// Returns the vector level that the code uses here, and the features behind it.
pub fn cpu_features() -> String {
    let (level, features) = detect();
    let list = if features.is_empty() { String::from("none listed") } else { features.join(" ") };
    format!("{} ({level}: {list})", std::env::consts::ARCH)
}

#[cfg(target_arch = "x86_64")]
fn detect() -> (&'static str, Vec<&'static str>) {
    macro_rules! present {
        ($($name:tt)*) => { [$(($name, std::is_x86_feature_detected!($name))),*] };
    }
    let all = present!(
        "sse4.2" "avx" "f16c" "avx2" "fma" "bmi2" "avx512f" "avx512bw" "avx512cd" "avx512dq" "avx512vl" "avx512bf16"
        "avx512vnni"
    );
    let has = |wanted: &[&str]| wanted.iter().all(|name| all.contains(&(*name, true)));
    // The levels of the x86-64 psABI, by the features that matter to arithmetic.
    let level = if has(&["avx2", "fma", "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"]) {
        "v4, 512 bits"
    } else if has(&["avx2", "fma", "bmi2"]) {
        "v3, 256 bits"
    } else {
        "baseline, 128 bits"
    };
    (level, all.iter().filter(|(_, present)| *present).map(|(name, _)| *name).collect())
}

#[cfg(not(target_arch = "x86_64"))]
fn detect() -> (&'static str, Vec<&'static str>) {
    ("baseline", Vec::new())
}
