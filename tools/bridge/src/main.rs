//! See the library.

use bridge::cli::{Cli, Program, To};
use bridge::{Mvn, PACKET_MAX, Protocol, Refused, Senders, Turn, Vmc};
use clap::Parser;
use messages::{Header, Layout, RawSkeleton, Stamp};
use pipeline::{Instance, Port, Way};
use rt::Shutdown;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::process::ExitCode;
use std::time::Duration;

/// Exit codes of sysexits(3).
const EX_UNAVAILABLE: u8 = 69;
const EX_SOFTWARE: u8 = 70;

/// How long silence is waited for before the signals are looked at.
const LOOK: Duration = Duration::from_millis(100);

fn main() -> ExitCode {
    let outcome = match Cli::parse().program {
        Program::Mvn { bind, character, to } => run(bind, &to, &mut Mvn::new(character)),
        Program::Vmc { bind, to } => run(bind, &to, &mut Vmc::new()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err((code, text)) => {
            eprintln!("bridge: {text}");
            ExitCode::from(code)
        }
    }
}

fn run(bind: SocketAddr, to: &To, protocol: &mut dyn Protocol) -> Result<(), (u8, String)> {
    let unavailable = |what: String| (EX_UNAVAILABLE, what);
    let shutdown = Shutdown::on_signals().map_err(|error| (EX_SOFTWARE, error.to_string()))?;
    let socket = UdpSocket::bind(bind).map_err(|error| unavailable(format!("{bind}: {error}")))?;
    socket.set_read_timeout(Some(LOOK)).map_err(|error| (EX_SOFTWARE, error.to_string()))?;
    let way = match &to.socket {
        Some(path) => Way::Socket(path.clone()),
        None if to.run_dir.is_dir() => Way::Domain(Instance::unmade(&to.run_dir).input_domain()),
        None => return Err(unavailable(format!("{}: no instance of teleopd runs there", to.run_dir.display()))),
    };
    let port = Port::open(way, "bridge").map_err(|error| unavailable(error.to_string()))?;
    let at = socket.local_addr().unwrap_or(bind);
    println!("bridge: listening at {at}");
    if !at.ip().is_loopback() && to.from.is_none() {
        println!("bridge: whoever reaches {at} can be followed by the robot; --from IP listens to one machine alone");
    }
    let mut listener = Listener::new(port, to);
    let mut packet = [0; PACKET_MAX + 1];
    while !shutdown.requested() {
        match socket.recv_from(&mut packet) {
            Ok((length, sender)) => listener.take(protocol, sender, &packet[..length]),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Err(unavailable(format!("{at}: {error}"))),
        }
    }
    println!("{}", listener.summary());
    Ok(())
}

/// What comes in, and what became of it.
struct Listener {
    port: Port,
    senders: Senders,
    incarnation: u32,
    /// Counts the sessions: every sender, and every start of one, is another.
    session: u32,
    restarts: u64,
    published: u64,
    failed: u64,
    refused: [u64; Refused::ALL.len()],
}

impl Listener {
    fn new(port: Port, to: &To) -> Self {
        let (senders, incarnation) = (Senders::new(to.from), rt::incarnation());
        Self {
            port,
            senders,
            incarnation,
            session: 0,
            restarts: 0,
            published: 0,
            failed: 0,
            refused: Default::default(),
        }
    }

    fn take(&mut self, protocol: &mut dyn Protocol, sender: SocketAddr, packet: &[u8]) {
        let now = rt::now();
        let length = if packet.len() > PACKET_MAX { Err(Refused::Length) } else { Ok(()) };
        let outcome = length.and_then(|()| self.senders.admit(sender, now)).and_then(|turn| {
            if turn == Turn::New {
                self.session += 1;
                println!("bridge: listening to {sender}");
            }
            protocol.take(packet, &mut |frame| self.publish(frame, now))
        });
        if protocol.restarts() != self.restarts {
            self.restarts = protocol.restarts();
            self.session += 1;
            println!("bridge: {sender} was started anew");
        }
        if let Err(refused) = outcome {
            let count = &mut self.refused[refused as usize];
            *count += 1;
            if *count == 1 {
                println!("bridge: refused a packet of {sender}: {refused}; others like it are counted");
            }
        }
    }

    /// The program's clock is not ours: a person was seen when the packet came.
    fn publish(&mut self, frame: &RawSkeleton, now: Stamp) {
        self.published += 1;
        let header =
            Header { sequence: self.published, stamp: now, origin: now, incarnation: self.incarnation, ..Header::ZERO };
        let session_nonce = u64::from(self.incarnation) << 32 | u64::from(self.session);
        if let Err(error) = self.port.publish(&RawSkeleton { header, session_nonce, ..*frame }) {
            self.failed += 1;
            if self.failed == 1 {
                println!("bridge: a frame was not taken: {error}");
            }
        }
    }

    fn summary(&self) -> String {
        let mut text = format!("bridge: {} frames, {} not taken", self.published, self.failed);
        for refused in Refused::ALL {
            let count = self.refused[refused as usize];
            if count > 0 {
                text += &format!("; {count} packets {refused}");
            }
        }
        text
    }
}
