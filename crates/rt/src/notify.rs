//! The service manager's protocol (systemd, sd_notify(3)): one datagram per state.

use crate::error::RtError;
use std::ffi::{OsStr, OsString};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

/// The channel to the service manager. Without NOTIFY_SOCKET every call does nothing.
#[derive(Debug)]
pub struct ServiceManager {
    channel: Option<(UnixDatagram, SocketAddr)>,
    watchdog: Option<Duration>,
}

impl ServiceManager {
    /// Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID.
    pub fn from_environment() -> Result<Self, RtError> {
        let watchdog = watchdog(
            std::env::var("WATCHDOG_USEC").ok().as_deref(),
            std::env::var("WATCHDOG_PID").ok().as_deref(),
            std::process::id(),
        );
        Self::connect(std::env::var_os("NOTIFY_SOCKET"), watchdog)
    }

    /// Connects to a path, or to `@name` in the abstract namespace. `None` means no service manager.
    fn connect(socket: Option<OsString>, watchdog: Option<Duration>) -> Result<Self, RtError> {
        let Some(socket) = socket.filter(|socket| !socket.is_empty()) else {
            return Ok(Self { channel: None, watchdog });
        };
        let channel = open(&socket)
            .map_err(|source| RtError::NotifySocket { socket: socket.to_string_lossy().into_owned(), source })?;
        Ok(Self { channel: Some(channel), watchdog })
    }

    /// Returns the longest silence of `watchdog` that the manager tolerates. Call `watchdog` at half of this interval.
    pub fn watchdog_timeout(&self) -> Option<Duration> {
        self.watchdog
    }

    /// Sends READY=1: start-up is complete.
    pub fn ready(&self) -> std::io::Result<()> {
        self.send("READY=1")
    }

    /// Sends WATCHDOG=1: still alive. Only a thread that saw the tick counter move may send it.
    pub fn watchdog(&self) -> std::io::Result<()> {
        self.send("WATCHDOG=1")
    }

    /// Sends STOPPING=1: shutdown has begun.
    pub fn stopping(&self) -> std::io::Result<()> {
        self.send("STOPPING=1")
    }

    /// Sends STATUS=: one line for people.
    pub fn status(&self, text: &str) -> std::io::Result<()> {
        self.send(&format!("STATUS={}", text.replace('\n', " ")))
    }

    fn send(&self, state: &str) -> std::io::Result<()> {
        match &self.channel {
            None => Ok(()),
            Some((socket, address)) => socket.send_to_addr(state.as_bytes(), address).map(drop),
        }
    }
}

fn open(socket: &OsStr) -> std::io::Result<(UnixDatagram, SocketAddr)> {
    let address = match socket.as_bytes() {
        [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
        [b'/', ..] => SocketAddr::from_pathname(socket)?,
        _ => {
            let text = "it must be an absolute path or an abstract name (@...)";
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, text));
        }
    };
    Ok((UnixDatagram::unbound()?, address))
}

/// Returns the watchdog interval. A watchdog for another process is ignored.
fn watchdog(usec: Option<&str>, pid: Option<&str>, own_pid: u32) -> Option<Duration> {
    if pid.is_some_and(|pid| pid.parse() != Ok(own_pid)) {
        return None;
    }
    usec?.parse().ok().filter(|&usec| usec > 0).map(Duration::from_micros)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(socket: &UnixDatagram) -> String {
        let mut buffer = [0; 256];
        let length = socket.recv(&mut buffer).expect("a datagram");
        String::from_utf8_lossy(&buffer[..length]).into_owned()
    }

    fn talk(manager: &ServiceManager, socket: &UnixDatagram) {
        assert!(manager.channel.is_some());
        manager.ready().expect("READY");
        manager.status("all\nwell").expect("STATUS");
        manager.watchdog().expect("WATCHDOG");
        manager.stopping().expect("STOPPING");
        let heard: Vec<String> = (0..4).map(|_| received(socket)).collect();
        assert_eq!(heard, ["READY=1", "STATUS=all well", "WATCHDOG=1", "STOPPING=1"]);
    }

    #[test]
    fn states_reach_socket_file_and_abstract_socket() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let socket = UnixDatagram::bind(&path).expect("a socket");
        talk(&ServiceManager::connect(Some(path.into()), None).expect("a manager"), &socket);

        let name = format!("teleop-notify-{}", crate::incarnation());
        let address = SocketAddr::from_abstract_name(&name).expect("an address");
        let socket = UnixDatagram::bind_addr(&address).expect("a socket");
        talk(&ServiceManager::connect(Some(format!("@{name}").into()), None).expect("a manager"), &socket);
    }

    #[test]
    fn notify_without_manager_does_nothing_and_bad_name_is_an_error() {
        let manager = ServiceManager::connect(None, None).expect("none is fine");
        assert!(manager.channel.is_none());
        manager.ready().expect("nothing to do");
        let error = ServiceManager::connect(Some("relative/path".into()), None).expect_err("refused");
        assert!(error.to_string().contains("relative/path"), "{error}");
        let folder = tempfile::tempdir().expect("a folder");
        let gone = ServiceManager::connect(Some(folder.path().join("gone").into()), None).expect("a name is a name");
        assert!(gone.ready().is_err(), "nobody listens");
    }

    #[test]
    fn watchdog_of_another_process_is_ignored() {
        assert_eq!(watchdog(Some("2000000"), Some("7"), 7), Some(Duration::from_secs(2)));
        assert_eq!(watchdog(Some("2000000"), None, 7), Some(Duration::from_secs(2)));
        assert_eq!(watchdog(Some("2000000"), Some("8"), 7), None);
        assert_eq!(watchdog(Some("0"), None, 7), None);
        assert_eq!(watchdog(Some("soon"), None, 7), None);
        assert_eq!(watchdog(None, None, 7), None);
    }
}
