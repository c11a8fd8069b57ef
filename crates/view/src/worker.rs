//! A thread that carries out a page's requests, so that the page never waits.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// The page's side of the thread. Dropping it ends the thread once the current work is done.
pub struct Worker<Ask, Answer> {
    asks: Sender<Ask>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
}

impl<Ask: Send + 'static, Answer: Send + 'static> Worker<Ask, Answer> {
    /// Starts `work` in a thread of that name. It returns once nobody can send requests any more.
    pub fn start(
        name: &str,
        work: impl FnOnce(&Receiver<Ask>, Sender<Answer>) + Send + 'static,
    ) -> std::io::Result<Self> {
        let (asks, asked) = channel();
        let (answer, answers) = channel();
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || work(&asked, answer))?;
        Ok(Self { asks, answers, thread: Some(thread) })
    }
}

impl<Ask, Answer> Worker<Ask, Answer> {
    pub fn ask(&self, ask: Ask) {
        let _ = self.asks.send(ask);
    }

    pub fn answer(&self) -> Option<Answer> {
        self.answers.try_recv().ok()
    }
}

impl<Ask, Answer> Drop for Worker<Ask, Answer> {
    fn drop(&mut self) {
        let (closed, _) = channel();
        self.asks = closed;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
