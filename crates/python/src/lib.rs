//! The native part of the package `teleopd` for Python. It reads robots, motions and recordings, retargets motions to
//! postures, and plays them through all stages in virtual time. Arrays are NumPy's, and the interpreter's lock is released
//! while something is computed. No iceoryx2 node and no real-time thread runs here.
//!
//! `teleopd/__init__.py` has the classes that people use. It checks shapes and units before it calls this module.

// Bounds are written as `!(value <= bound)` so that NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod arrays;
mod certify;
mod motions;
mod recording;
mod retargeter;
mod robots;

/// The module `teleopd._native`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::certify::certify;
    #[pymodule_export]
    use crate::motions::{Motion, read_motion};
    #[pymodule_export]
    use crate::recording::read_recording;
    #[pymodule_export]
    use crate::retargeter::{Retargeter, interpolate};
    #[pymodule_export]
    use crate::robots::Robot;
}
