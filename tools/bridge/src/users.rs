//! Finds the users of the sockets that send from this machine. Any program that can send to the port moves the
//! person, and a loopback address keeps out only other machines.

use messages::Stamp;
use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;
use std::net::{IpAddr, SocketAddr, UdpSocket};

/// Time for which an answer is cached, ns. So not every packet needs a lookup.
const HOLDS_NS: u64 = 1_000_000_000;
/// Number of cached answers.
const KEPT_MAX: usize = 64;
const TABLES: [&str; 2] = ["/proc/net/udp", "/proc/net/udp6"];
/// Size of the longest table that is read, bytes. A socket takes 128 bytes, and there are at most as many
/// sockets as ports.
const TABLE_BYTES_MAX: u64 = 16 << 20;

#[derive(Clone, Debug)]
pub struct Users {
    /// This user and root may send. Without a value every user may.
    own: Option<u32>,
    kept: VecDeque<(SocketAddr, Stamp, bool)>,
}

impl Users {
    /// Creates the state. `own` and root may send, or every user.
    pub fn new(own: Option<u32>) -> Self {
        Self { own, kept: VecDeque::new() }
    }

    /// Returns true if the packet that came from `sender` at `now` belongs to a user who may send. Packets of
    /// other machines are allowed, because their users are not known here.
    pub fn may(&mut self, sender: SocketAddr, now: Stamp) -> bool {
        let Some(own) = self.own else { return true };
        self.answer(sender, now, || !is_here(sender) || owned(&TABLES.map(table), sender, own))
    }

    fn answer(&mut self, sender: SocketAddr, now: Stamp, ask: impl FnOnce() -> bool) -> bool {
        self.kept.retain(|(_, asked, _)| now.since(*asked) < HOLDS_NS);
        if let Some((.., may)) = self.kept.iter().find(|(known, ..)| *known == sender) {
            return *may;
        }
        let may = ask();
        if self.kept.len() == KEPT_MAX {
            self.kept.pop_front();
        }
        self.kept.push_back((sender, now, may));
        may
    }
}

/// Returns true if an address belongs to this machine. Other addresses cannot be bound. With
/// net.ipv4.ip_nonlocal_bind they can, and other machines are then rejected like senders whose socket is gone.
fn is_here(mut sender: SocketAddr) -> bool {
    sender.set_port(0);
    sender.ip().is_loopback() || UdpSocket::bind(sender).is_ok()
}

/// Reads a table. A table that cannot be read has no sockets.
fn table(path: &str) -> String {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(TABLE_BYTES_MAX).read_to_string(&mut text));
    read.map_or_else(|_| String::new(), |_| text)
}

/// Returns true if the sender's socket is in a table and every socket of its port belongs to `own` or root. A socket
/// that is bound to another address of this machine can send as if it were bound to this one (IP_PKTINFO, ip(7)).
fn owned(tables: &[String], sender: SocketAddr, own: u32) -> bool {
    let mut found = false;
    for (ip, port, uid) in tables.iter().flat_map(|table| table.lines()).filter_map(socket) {
        if port != sender.port() {
            continue;
        }
        if uid != own && uid != 0 {
            return false;
        }
        // A socket that is bound to no address sends from any address. An IPv6 socket also sends from IPv4 addresses.
        found |= ip == sender.ip() || ip.is_unspecified() && (ip.is_ipv6() || sender.is_ipv4());
    }
    found
}

/// Parses local address, port and user of a line: `sl local rem st queues timer retransmits uid ...`. Addresses
/// are 32-bit numbers in machine byte order that hold bytes in network order (proc(5)).
fn socket(line: &str) -> Option<(IpAddr, u16, u32)> {
    let mut words = line.split_whitespace();
    let (address, port) = words.nth(1)?.split_once(':')?;
    let word = |n: usize| Some(u32::from_str_radix(address.get(8 * n..8 * n + 8)?, 16).ok()?.to_ne_bytes());
    let ip = match address.len() {
        8 => IpAddr::from(word(0)?),
        32 => {
            let words = [word(0)?, word(1)?, word(2)?, word(3)?];
            IpAddr::from(<[u8; 16]>::try_from(words.as_flattened()).ok()?).to_canonical()
        }
        _ => return None,
    };
    Some((ip, u16::from_str_radix(port, 16).ok()?, words.nth(5)?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(ip: &str, port: u16, uid: u32) -> String {
        let words = |bytes: &[u8]| -> String {
            bytes.chunks(4).map(|b| format!("{:08X}", u32::from_ne_bytes([b[0], b[1], b[2], b[3]]))).collect()
        };
        let (address, other) = match ip.parse().expect("an address") {
            IpAddr::V4(ip) => (words(&ip.octets()), "00000000"),
            IpAddr::V6(ip) => (words(&ip.octets()), "00000000000000000000000000000000"),
        };
        format!(
            "  12: {address}:{port:04X} {other}:0000 07 00000000:00000000 00:00000000 00000000 {uid:5}        0 99 2 0 0"
        )
    }

    #[test]
    fn sender_belongs_to_user_only_if_all_its_port_sockets_do() {
        let head = "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode";
        for (sockets, sender, may) in [
            (&[("127.0.0.1", 5000, 1000)][..], "127.0.0.1:5000", true),
            (&[("0.0.0.0", 5000, 1000)], "127.0.0.1:5000", true),
            (&[("::", 5000, 1000)], "127.0.0.1:5000", true),
            (&[("::ffff:127.0.0.1", 5000, 1000)], "127.0.0.1:5000", true),
            (&[("::1", 5000, 1000)], "[::1]:5000", true),
            (&[("127.0.0.1", 5000, 0)], "127.0.0.1:5000", true),
            (&[("127.0.0.1", 5000, 1001)], "127.0.0.1:5000", false),
            (&[("0.0.0.0", 5000, 1000)], "[::1]:5000", false),
            (&[("127.0.0.1", 5001, 1000)], "127.0.0.1:5000", false),
            (&[("127.0.0.2", 5000, 1000)], "127.0.0.1:5000", false),
            (&[("127.0.0.1", 5000, 1000), ("0.0.0.0", 5000, 1001)], "127.0.0.1:5000", false),
            (&[("127.0.0.1", 5000, 1000), ("10.0.0.1", 5000, 1001)], "127.0.0.1:5000", false),
            (&[], "127.0.0.1:5000", false),
        ] {
            let mut text = head.to_owned();
            sockets.iter().for_each(|(ip, port, uid)| text += &format!("\n{}", line(ip, *port, *uid)));
            assert_eq!(owned(&[text], sender.parse().expect("an address"), 1000), may, "{sender} {sockets:?}");
        }
    }

    #[test]
    fn open_udp_socket_is_found_in_the_kernel_tables() {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let (sender, tables) = (socket.local_addr().expect("its address"), TABLES.map(table));
        let uid = |line: &str| super::socket(line).filter(|(ip, port, _)| SocketAddr::new(*ip, *port) == sender);
        let found = tables[0].lines().find_map(uid).expect("a line").2;
        assert!(owned(&tables, sender, found));
        assert!(found == 0 || !owned(&tables, sender, found + 1));
        assert!(is_here(sender) && !is_here("203.0.113.1:9".parse().expect("an address of nobody")));
    }

    #[test]
    fn user_answer_is_cached_for_one_second_in_a_bounded_cache() {
        let sender = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let mut users = Users::new(Some(1000));
        let mut asked = 0;
        for (port, ms, count) in [(1, 0, 1), (1, 10, 1), (1, 999, 1), (2, 999, 2), (1, 1000, 3), (1, 1500, 3)] {
            let may = users.answer(sender(port), Stamp(1 + ms * 1_000_000), || {
                asked += 1;
                port == 1
            });
            assert_eq!((may, asked), (port == 1, count), "port {port} at {ms} ms");
        }
        (100..1000).for_each(|port| _ = users.answer(sender(port), Stamp(2_000_000_000), || true));
        assert_eq!(users.kept.len(), KEPT_MAX);
        assert!(Users::new(None).may(sender(9), Stamp(1)), "every user");
    }
}
