//! The session of a page that is a client of `ingest`.

use doors::{Client, DoorError, Reply};
use instance::Instance;
use messages::{RawSkeleton, Stamp};

/// A page's session on the skeleton socket. It survives a pause, like that of any client that returns to its lease.
pub(crate) struct Session {
    instance: Instance,
    client: Option<Client>,
    /// Number of frames so far.
    pub(crate) sequence: u64,
    incarnation: u32,
    /// Text for a page whose person cannot move the robot.
    held: &'static str,
}

impl Session {
    pub(crate) fn new(instance: Instance, held: &'static str) -> Self {
        Self { instance, client: None, sequence: 0, incarnation: rt::incarnation(), held }
    }

    /// Makes sure that there is a session that may move the robot. The error says why there is none. A session
    /// that lost its lease to another client never gets it back.
    pub(crate) fn connect(&mut self) -> Result<(), String> {
        let usable = |client: &mut Client| client.listen().is_ok() && client.last_reply() != Reply::NotHolder;
        self.client = self.client.take().and_then(|mut client| usable(&mut client).then_some(client));
        if self.client.is_none() {
            let client = Client::attach(self.instance.skeleton_socket()).map_err(|error| error.to_string())?;
            if client.last_reply() == Reply::GrantedButHeld {
                return Err(self.held.to_owned());
            }
            self.client = Some(client);
        }
        Ok(())
    }

    /// Gives the lease back. The next join begins a new session.
    pub(crate) fn leave(&mut self) {
        self.client = None;
    }

    /// Publishes a frame that was captured at `origin`. The error says why the session has ended.
    pub(crate) fn publish(&mut self, mut frame: RawSkeleton, origin: Stamp) -> Result<(), String> {
        let Some(client) = &mut self.client else { return Err(self.held.to_owned()) };
        self.sequence += 1;
        frame.header.sequence = self.sequence;
        (frame.header.stamp, frame.header.origin) = (rt::now(), origin);
        frame.header.incarnation = self.incarnation;
        let ended = match client.publish(&frame).map(|_| client.last_reply()) {
            Ok(Reply::NotHolder) => self.held.to_owned(),
            // A frame that `ingest` did not read in time is lost. `ingest` judges if there were too many.
            Ok(_) | Err(DoorError::Timeout { .. }) => return Ok(()),
            Err(error) => format!("The connection to ingest is lost: {error}"),
        };
        self.client = None;
        Err(ended)
    }
}
