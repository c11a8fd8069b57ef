//! A thread that lives as long as its owner wants.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread::{Builder, JoinHandle};

/// A thread. Dropping it sets the thread's flag, and waits for its end.
#[derive(Debug)]
pub struct Background {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Background {
    /// Starts `work` in a thread of this name. The work returns soon after its flag was set.
    ///
    /// # Errors
    /// Returns an error if the system starts no thread.
    pub fn start(name: &str, work: impl FnOnce(&AtomicBool) + Send + 'static) -> std::io::Result<Self> {
        let ends = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&ends);
        let thread = Builder::new().name(name.into()).spawn(move || work(&flag))?;
        Ok(Self { ends, thread: Some(thread) })
    }

    /// Starts `work` with what `open` opens in the thread and what cannot leave it, such as a port of the bus. Waits for `open`.
    ///
    /// # Errors
    /// Returns the error of `open`.
    ///
    /// # Panics
    /// Panics if the system starts no thread, or if `open` panics.
    pub fn opened<T, E: Send + 'static>(
        name: &str,
        open: impl FnOnce() -> Result<T, E> + Send + 'static,
        work: impl FnOnce(T, &AtomicBool) + Send + 'static,
    ) -> Result<Self, E> {
        let (opened, outcome) = channel();
        let thread = Self::start(name, move |ends| match open() {
            Ok(ports) => {
                let _ = opened.send(Ok(()));
                work(ports, ends);
            }
            Err(error) => _ = opened.send(Err(error)),
        });
        let thread = thread.expect("the system starts a thread");
        outcome.recv().expect("the thread answers before it ends")?;
        Ok(thread)
    }

    /// Returns true once the work has returned.
    pub fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_thread_is_asked_to_end_and_waited_for() {
        let (begun, seen) = channel();
        let work = move |number: i32, ends: &AtomicBool| {
            begun.send(number).expect("the test waits");
            while !ends.load(Ordering::Acquire) {
                std::thread::yield_now();
            }
            begun.send(number + 1).expect("the test waits");
        };
        let thread = Background::opened("test", || Ok::<_, String>(7), work).expect("it opens");
        assert_eq!((seen.recv(), thread.has_ended()), (Ok(7), false));
        drop(thread);
        assert_eq!(seen.try_recv(), Ok(8));
        let refused = Background::opened("test", || Err::<(), _>("no port"), |(), _| unreachable!());
        assert_eq!(refused.err(), Some("no port"));
    }
}
