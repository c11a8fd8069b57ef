//! Starting and ending a child process: its report that it is READY, and its end within a time.

use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

/// Longest wait for one report, so that the end of a child is seen soon.
const LISTEN: Duration = Duration::from_millis(50);

/// Socket on which a child reports that it is READY. It is removed at the end.
pub struct ReadySocket {
    socket: UnixDatagram,
    pub path: PathBuf,
}

impl ReadySocket {
    pub fn bind(path: PathBuf) -> std::io::Result<Self> {
        let _ = std::fs::remove_file(&path);
        let socket = UnixDatagram::bind(&path)?;
        socket.set_read_timeout(Some(LISTEN))?;
        Ok(Self { socket, path })
    }

    /// Waits for a report, 50 ms at most. Returns true if it says READY.
    pub fn hears_ready(&self) -> bool {
        let mut text = [0_u8; 512];
        let length = self.socket.recv(&mut text).unwrap_or(0);
        text[..length].split(|&byte| byte == b'\n').any(|line| line == b"READY=1")
    }
}

impl Drop for ReadySocket {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Sends SIGTERM and waits for the end of a process. If it has not ended `within` this time, it is killed, and the
/// result is `None`.
pub fn ended_within(child: &mut Child, within: Duration) -> Option<ExitStatus> {
    rt::terminate(child.id());
    let give_up = Instant::now() + within;
    while Instant::now() < give_up {
        if let Ok(Some(status)) = child.try_wait() {
            return Some(status);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let _ = child.kill();
    let _ = child.wait();
    None
}
