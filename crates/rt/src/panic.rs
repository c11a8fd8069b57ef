//! Ends a process that has found a bug in itself.

/// Makes a panic of any thread end the process at once (SIGABRT), after its message. Nothing is unwound and nothing
/// more is sent. A process that goes on after a bug is worse than a silent one, and silence stops the robot.
pub fn abort_on_panic() {
    let default_hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        default_hook(panic);
        std::process::abort();
    }));
}

#[cfg(test)]
mod tests {
    use super::abort_on_panic;
    use std::os::unix::process::ExitStatusExt;
    use std::process::Command;

    const ROLE: &str = "RT_TEST_PANICS";

    /// Not a test by itself: it is the process that panics in a thread other than its first.
    #[test]
    fn child_process_that_panics() {
        if std::env::var_os(ROLE).is_some() {
            abort_on_panic();
            let _ = std::thread::spawn(|| panic!("a bug")).join();
        }
    }

    #[test]
    fn panic_of_any_thread_aborts_process_with_its_message() {
        let this = std::env::current_exe().expect("a test program");
        let test = "panic::tests::child_process_that_panics";
        let output =
            Command::new(this).args(["--exact", test, "--nocapture"]).env(ROLE, "1").output().expect("it runs");
        assert_eq!(output.status.signal(), Some(6), "SIGABRT: {output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("a bug"), "{output:?}");
    }
}
