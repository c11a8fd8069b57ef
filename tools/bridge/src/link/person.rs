//! The robot's end on the skeleton socket: one client for each operator.

use doors::{Client, DoorError, Reply};
use messages::{Feedback, RawSkeleton, Stamp};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// Time until a failed connection is tried again, ns.
const RETRY_NS: u64 = 500_000_000;
/// Time without persons after which the connection ends, ns: the longest `ingest.authority_timeout_ms`.
const IDLE_NS: u64 = 60_000_000_000;

/// An operator's client of `ingest`. A connection takes up to a second, so a thread makes it.
#[derive(Default)]
pub(super) struct Person {
    socket: PathBuf,
    client: Option<Client>,
    connecting: Option<JoinHandle<Result<Client, DoorError>>>,
    retry: Stamp,
    published: Stamp,
    /// Session of the client at the operator's machine. A new one is a new one here, too.
    session_nonce: u64,
    feedback_sequence: u64,
    pub(super) why: Option<String>,
}

impl Person {
    pub(super) fn new(socket: &Path) -> Self {
        Self { socket: socket.to_owned(), ..Self::default() }
    }

    /// Publishes a person. Before the connection is there, it is lost.
    pub(super) fn publish(&mut self, person: &RawSkeleton, now: Stamp) {
        self.published = now;
        if person.session_nonce != self.session_nonce {
            (self.session_nonce, self.client) = (person.session_nonce, None);
        }
        if let Some(connecting) = self.connecting.take_if(|connecting| connecting.is_finished()) {
            match connecting.join() {
                Ok(Ok(client)) => (self.client, self.why) = (Some(client), None),
                Ok(Err(error)) => (self.why, self.retry) = (Some(error.to_string()), now.plus_ns(RETRY_NS)),
                Err(_) => self.retry = now.plus_ns(RETRY_NS),
            }
        }
        match &mut self.client {
            Some(client) => match client.publish(person) {
                Ok(()) | Err(DoorError::Timeout { .. }) => {}
                Err(error) => {
                    (self.client, self.why, self.retry) = (None, Some(error.to_string()), now.plus_ns(RETRY_NS));
                }
            },
            None if self.connecting.is_none() && now >= self.retry => {
                let socket = self.socket.clone();
                let attach = move || Client::attach_with_feedback(socket);
                self.connecting = std::thread::Builder::new().name("attach".into()).spawn(attach).ok();
            }
            None => {}
        }
    }

    pub(super) fn feedback(&mut self) -> Option<Feedback> {
        let client = self.client.as_mut()?;
        if let Err(error) = client.listen() {
            (self.client, self.why) = (None, Some(error.to_string()));
            return None;
        }
        let feedback = client.feedback().filter(|feedback| feedback.header.sequence != self.feedback_sequence)?;
        self.feedback_sequence = feedback.header.sequence;
        Some(*feedback)
    }

    /// Returns true if another client holds the lease.
    pub(super) fn is_led_by_other(&self) -> bool {
        self.client
            .as_ref()
            .is_some_and(|client| matches!(client.last_reply(), Reply::NotHolder | Reply::GrantedButHeld))
    }

    /// Ends a connection without persons, once its lease is surely over. A person who returns before keeps the lease: a new
    /// connection would be another client, and refused for good.
    pub(super) fn rest(&mut self, now: Stamp) {
        if now.since(self.published) > IDLE_NS {
            self.client = None;
        }
    }
}
