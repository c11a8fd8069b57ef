//! The command line program of the library.

use bridge::cli::{Cli, Program, To};
use bridge::{Mvn, PACKET_MAX, Protocol, Refused, SenderChange, Senders, Taken, Users, Vmc, canonical};
use clap::Parser;
use client::{Port, Transport};
use instance::Instance;
use messages::{Header, Layout, RawSkeleton, Stamp};
use rt::{Exit, Failure, Peer, Shutdown, out};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::process::ExitCode;
use std::time::Duration;

/// Time to wait for a packet before signals are checked.
const LOOK: Duration = Duration::from_millis(100);
/// Time between two reports of rejected packets, ns, while the number grows.
const REPORT_EVERY_NS: u64 = 60_000_000_000;

fn main() -> ExitCode {
    rt::abort_on_panic();
    let outcome = match Cli::parse().program {
        Program::Mvn { bind, character, to } => run(bind, &to, Mvn::new(character)),
        Program::Vmc { bind, to } => run(bind, &to, Vmc::default()),
        Program::Link(command) => bridge::link::run(&command),
    };
    rt::finish("bridge", outcome)
}

fn run<P: Protocol>(bind: SocketAddr, to: &To, protocol: P) -> Result<(), Failure> {
    let unavailable = Failure::with(Exit::Unavailable);
    let shutdown = Shutdown::on_signals().map_err(Failure::with(Exit::Software))?;
    let socket = UdpSocket::bind(bind).map_err(|error| unavailable(format!("{bind}: {error}")))?;
    socket.set_read_timeout(Some(LOOK)).map_err(Failure::with(Exit::Software))?;
    let way = match &to.socket {
        Some(path) => Transport::Socket(path.clone()),
        None if to.run_dir.is_dir() => Transport::Domain(Instance::unmade(&to.run_dir).input_domain()),
        None => {
            let folder = to.run_dir.display();
            let text = format!("no instance of teleopd runs in {folder}; start one: `teleopd up --run-dir {folder}`");
            return Err(unavailable(text));
        }
    };
    let port = Port::open(way, "bridge").map_err(Failure::with(Exit::Unavailable))?;
    let at = socket.local_addr().unwrap_or(bind);
    let users = users(to).map_err(Failure::with(Exit::Software))?;
    out!("bridge: listening at {at}");
    match users {
        Some(own) => out!("bridge: on this machine only users {own} and 0 may send; --any-user admits all users"),
        None => out!("bridge: every user of this machine may move the robot"),
    }
    if !at.ip().is_loopback() && to.from.is_none() {
        out!("bridge: everyone who reaches {at} may move the robot; --from IP admits only one machine");
    }
    let mut listener = Listener {
        port,
        protocol,
        senders: Senders::new(to.from),
        users: Users::new(users),
        incarnation: rt::incarnation(),
        session: 0,
        restarts: 0,
        published: 0,
        failed: 0,
        refused: BTreeMap::new(),
        reported: (rt::now(), 0),
    };
    let mut packet = [0; PACKET_MAX + 1];
    while !shutdown.requested() {
        match socket.recv_from(&mut packet) {
            Ok((length, sender)) => listener.receive(canonical(sender), &packet[..length]),
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Err(unavailable(format!("{at}: {error}"))),
        }
        listener.print_refused(rt::now());
    }
    out!("{}", listener.summary());
    Ok(())
}

/// Returns the user that runs this program, as the kernel reports it. None if every user may send.
fn users(to: &To) -> std::io::Result<Option<u32>> {
    if to.any_user {
        return Ok(None);
    }
    let (own, _) = UnixStream::pair()?;
    Ok(Some(Peer::from_socket(own.as_fd())?.uid))
}

struct Listener<P> {
    port: Port,
    protocol: P,
    senders: Senders,
    users: Users,
    incarnation: u32,
    /// Number of the session. Every sender, and every restart of one, begins a new session.
    session: u32,
    restarts: u64,
    published: u64,
    failed: u64,
    refused: BTreeMap<Refused, u64>,
    /// Time of the last report of rejected packets, and their number in it.
    reported: (Stamp, u64),
}

impl<P: Protocol> Listener<P> {
    fn receive(&mut self, sender: SocketAddr, packet: &[u8]) {
        let outcome = self.listen(sender, packet, rt::now());
        let restarts = self.protocol.counts().restarts;
        if restarts != self.restarts {
            self.restarts = restarts;
            self.session += 1;
            if self.restarts == 1 {
                out!("bridge: {sender} restarted; further restarts are only counted");
            }
        }
        if let Err(refused) = outcome {
            let count = self.refused.entry(refused).or_default();
            *count += 1;
            if *count == 1 {
                out!("bridge: refused a packet of {sender}: {refused}; further ones are only counted");
            }
        }
    }

    fn listen(&mut self, sender: SocketAddr, packet: &[u8], now: Stamp) -> Result<(), Refused> {
        if packet.len() > PACKET_MAX {
            return Err(Refused::Length);
        }
        let turn = self.senders.whose(sender, now)?;
        if !self.users.may(sender, now) {
            return Err(Refused::User);
        }
        if turn == SenderChange::New {
            // A rejected packet gives no sender the turn. It also does not change the state of the previous sender.
            if self.protocol.for_new_sender().decode(packet, &mut |_| {})? == Taken::Aside {
                return Ok(());
            }
            self.protocol = self.protocol.for_new_sender();
            self.session += 1;
            out!("bridge: listening to {sender}");
        }
        let mut frames = Vec::new();
        let taken = self.protocol.decode(packet, &mut |frame| frames.push(*frame))?;
        if taken == Taken::Person {
            self.senders.heard(sender, now);
        }
        frames.iter().for_each(|frame| self.publish(frame, now));
        Ok(())
    }

    /// The program's clock is not ours. So the origin of a person is the arrival of the packet.
    fn publish(&mut self, frame: &RawSkeleton, now: Stamp) {
        self.published += 1;
        let header =
            Header { sequence: self.published, stamp: now, origin: now, incarnation: self.incarnation, ..Header::ZERO };
        let session_nonce = u64::from(self.incarnation) << 32 | u64::from(self.session);
        if let Err(error) = self.port.publish(&RawSkeleton { header, session_nonce, ..*frame }) {
            self.failed += 1;
            if self.failed == 1 {
                out!("bridge: a frame was not accepted: {error}");
            }
        }
    }

    /// Reports the number of rejected packets if it grew since the last report.
    fn print_refused(&mut self, now: Stamp) {
        let refused = self.refused.values().sum();
        if now.since(self.reported.0) >= REPORT_EVERY_NS {
            if refused != self.reported.1 {
                out!("{}", self.summary());
            }
            self.reported = (now, refused);
        }
    }

    fn summary(&self) -> String {
        let mut text = format!("bridge: {} frames, {} not accepted", self.published, self.failed);
        let unfinished = self.protocol.counts().unfinished;
        if unfinished > 0 {
            text += &format!("; {unfinished} without hips, arms, tracking or a packet");
        }
        if self.restarts > 0 {
            text += &format!("; senders restarted {} times", self.restarts);
        }
        for (refused, count) in &self.refused {
            text += &format!("; {count} packets {refused}");
        }
        text
    }
}
