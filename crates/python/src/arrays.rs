//! Arrays in and out, errors, and computing beside the interpreter: all functions share these.

use messages::JOINTS_MAX;
use numpy::{Element, IntoPyArray, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Time between two looks for Ctrl-C while something is computed.
const LOOK_PERIOD: Duration = Duration::from_millis(100);

/// Returns a value error with this text.
pub(crate) fn refused(cause: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(cause.to_string())
}

/// Names the options of the programs as the arguments of `read_motion`.
pub(crate) fn in_python(text: &str) -> String {
    let text = text.replace("--frame-rate HZ", "frame_rate_hz").replace("--frame-rate", "frame_rate_hz");
    text.replace(" --", " ").replace("(--", "(")
}

/// Returns the error of a file that cannot be read.
pub(crate) fn unread(cause: impl std::fmt::Display) -> PyErr {
    PyOSError::new_err(cause.to_string())
}

/// Runs `job` in a thread of its own without the interpreter's lock, and returns its result. The thread flushes denormal
/// numbers, as every program does, and the interpreter's threads do not. `job` should end soon once its argument is true,
/// which happens on Ctrl-C.
///
/// # Errors
/// Returns the exception of a signal.
pub(crate) fn computed<T: Send>(py: Python<'_>, job: impl FnOnce(&AtomicBool) -> T + Send) -> PyResult<T> {
    let interrupted = AtomicBool::new(false);
    py.detach(|| {
        std::thread::scope(|scope| {
            let (ended, end) = channel::<()>();
            let computing = scope.spawn(|| {
                // Dropped at the end of the job, also by a panic.
                let _ended = ended;
                let _ = rt::flush_denormals();
                job(&interrupted)
            });
            let mut signal = Ok(());
            while end.recv_timeout(LOOK_PERIOD) == Err(RecvTimeoutError::Timeout) {
                if signal.is_ok() {
                    signal = Python::attach(|py| py.check_signals());
                    interrupted.store(signal.is_err(), Ordering::Relaxed);
                }
            }
            let result = computing.join().unwrap_or_else(|cause| std::panic::resume_unwind(cause));
            signal.map(|()| result)
        })
    })
}

/// Returns an array of this shape.
pub(crate) fn array<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    values.into_pyarray(py).reshape(shape.to_vec())
}

/// Appends the robot's joints of a message to a column.
pub(crate) fn push_joints(column: &mut Vec<f64>, values: &[f64; JOINTS_MAX], count: usize) {
    column.extend_from_slice(&values[..count]);
}

/// Returns the positions of `count` joints as a row of all joints. Those that are not there are zero.
pub(crate) fn row(values: &[f64], count: usize) -> [f64; JOINTS_MAX] {
    let mut q = [0.0; JOINTS_MAX];
    q[..count].copy_from_slice(&values[..count]);
    q
}
