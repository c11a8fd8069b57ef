//! Flushes denormal numbers to zero. Some processors need a hundred times as long for them, and filters that
//! decay to zero produce them.
#![allow(unsafe_code)]

/// Makes the calling thread, and the threads that it starts later, use zero in place of denormal numbers. This
/// holds for inputs and results below 2.2e-308 in f64, 1.2e-38 in f32. Returns in words what then holds.
///
/// Every program whose figures are compared bit for bit with the daemon's calls it first. The compiler does not
/// know of this setting. A denormal number that it computes itself, from constants, stays one.
pub fn flush_denormals() -> Result<String, String> {
    control::set();
    if control::is_set() && is_flushed() {
        Ok(String::from(control::NAME))
    } else {
        Err(format!("{} was written, but denormal numbers are not flushed", control::NAME))
    }
}

/// Returns true if arithmetic on this thread gives zero in place of a denormal number, and takes it as zero. It
/// is not inlined, because the compiler could move a product across the instruction that changes its meaning.
#[inline(never)]
fn is_flushed() -> bool {
    use std::hint::black_box;
    let gives = black_box(f64::MIN_POSITIVE) * black_box(0.5);
    // 2^-1074 times 2^1023 is an ordinary number, unless the first factor counts as zero.
    let takes = black_box(f64::from_bits(1)) * black_box(f64::from_bits(0x7fe0_0000_0000_0000));
    black_box(gives) == 0.0 && black_box(takes) == 0.0
}

#[cfg(target_arch = "x86_64")]
mod control {
    use std::arch::asm;

    pub(super) const NAME: &str = "MXCSR.FTZ and MXCSR.DAZ";
    /// Flush to zero, bit 15, and denormals are zero, bit 6 (Intel SDM volume 1, 10.2.3).
    const BITS: u32 = 1 << 15 | 1 << 6;

    fn read() -> u32 {
        let mut mxcsr = 0_u32;
        // SAFETY: stmxcsr writes four bytes to `mxcsr`, which is writable, and changes nothing else.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut mxcsr, options(nostack, preserves_flags)) };
        mxcsr
    }

    pub(super) fn set() {
        let wanted = read() | BITS;
        // SAFETY: ldmxcsr reads four bytes of `wanted`. Only bits that every x86_64 has are added. No code here depends
        // on denormal numbers. The compiler assumes the default, and at most keeps a denormal number that it folded.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const wanted, options(nostack, preserves_flags)) };
    }

    pub(super) fn is_set() -> bool {
        read() & BITS == BITS
    }
}

#[cfg(target_arch = "aarch64")]
mod control {
    use std::arch::asm;

    pub(super) const NAME: &str = "FPCR.FZ";
    /// Flush to zero, inputs and results, bit 24 (Arm ARM, FPCR).
    const BITS: u64 = 1 << 24;

    fn read() -> u64 {
        let fpcr: u64;
        // SAFETY: reads a register that every aarch64 has.
        unsafe { asm!("mrs {}, fpcr", out(reg) fpcr, options(nomem, nostack, preserves_flags)) };
        fpcr
    }

    pub(super) fn set() {
        let wanted = read() | BITS;
        // SAFETY: writes FPCR with one more bit that every aarch64 has. No code here depends on denormal numbers. The
        // compiler assumes the default, and at most keeps a denormal number that it folded.
        unsafe { asm!("msr fpcr, {}", in(reg) wanted, options(nostack, preserves_flags)) };
    }

    pub(super) fn is_set() -> bool {
        read() & BITS == BITS
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod control {
    pub(super) const NAME: &str = "nothing (unknown on this processor)";

    pub(super) fn set() {}

    pub(super) fn is_set() -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flush_denormals_affects_own_thread_and_children_only() {
        assert!(!is_flushed(), "the default keeps them");
        let (before, outcome, after, child) = std::thread::spawn(|| {
            let before = is_flushed();
            let outcome = flush_denormals();
            let child = std::thread::spawn(is_flushed).join().expect("the child does not panic");
            (before, outcome, is_flushed(), child)
        })
        .join()
        .expect("the thread does not panic");
        assert!(!before);
        match outcome {
            Ok(what) => assert!(after && child, "{what}: here {after}, in a child {child}"),
            Err(why) => println!("not on this processor: {why}"),
        }
        assert!(!is_flushed(), "another thread keeps the default");
    }
}
