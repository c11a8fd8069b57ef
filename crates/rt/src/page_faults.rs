//! Page faults. After READY none should wait for a disk.
#![allow(unsafe_code)]

/// Page faults so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageFaults {
    /// Faults that needed input or output.
    pub major: u64,
    /// Faults that were served from memory.
    pub minor: u64,
}

impl PageFaults {
    /// Returns the faults of the whole process.
    pub fn of_process() -> Self {
        Self::from_usage(libc::RUSAGE_SELF)
    }

    /// Returns the faults of the calling thread.
    pub fn of_thread() -> Self {
        Self::from_usage(libc::RUSAGE_THREAD)
    }

    /// Returns the faults since `earlier`.
    pub fn since(self, earlier: Self) -> Self {
        Self { major: self.major.saturating_sub(earlier.major), minor: self.minor.saturating_sub(earlier.minor) }
    }

    fn from_usage(who: libc::c_int) -> Self {
        let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
        // SAFETY: `usage` is writable memory of the right size, and all-zero bits are a valid rusage.
        let usage = unsafe {
            let rc = libc::getrusage(who, usage.as_mut_ptr());
            assert_eq!(rc, 0, "getrusage knows RUSAGE_SELF and RUSAGE_THREAD");
            usage.assume_init()
        };
        Self { major: usage.ru_majflt as u64, minor: usage.ru_minflt as u64 }
    }
}
