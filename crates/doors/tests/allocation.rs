//! No poll allocates once the server has started.

use doors::{ANSWER_BYTES, Hello, LeaseState, ReplyPacket, Server, encode_frame};
use messages::{Layout as _, RawSkeleton, Stamp};
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketType};

#[test]
fn f023_server_allocates_nothing_during_floods_and_reconnects() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("skeleton.sock");
    let mut server = Server::bind(&path, None).unwrap();
    let address = SocketAddrUnix::new(&path).unwrap();
    let ((), deliberate) = rt::count_allocations(|| drop(std::hint::black_box(Box::new(1))));
    assert_eq!(deliberate.allocated, 1, "the count sees what is allocated");
    rt::watch_allocations();
    let (mut used, mut now) = (0, Stamp(1));
    for _ in 0..100 {
        let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        rustix::net::connect(&socket, &address).unwrap();
        rustix::net::send(&socket, &Hello::OURS.encode(), SendFlags::empty()).unwrap();
        server.poll(now, false, |_, _| LeaseState::Holder);
        server.poll(now, false, |_, _| LeaseState::Holder);
        let mut bytes = [0; ANSWER_BYTES];
        rustix::net::recv(&socket, &mut bytes[..], RecvFlags::DONTWAIT).unwrap();
        let session_nonce = ReplyPacket::decode(&bytes).unwrap().session_nonce;
        let frame = encode_frame(&RawSkeleton { session_nonce, ..RawSkeleton::ZERO });
        for round in 0..40 {
            now = now.plus_ns(1_000_000);
            let _ = rustix::net::send(&socket, &frame, SendFlags::DONTWAIT);
            server.poll(now, round % 2 == 0, |_, _| {
                used += 1;
                if round % 3 == 0 { LeaseState::Holder } else { LeaseState::NotHolder }
            });
            server.descriptors(now);
            server.drain_events(|_| {});
        }
        rustix::net::send(&socket, b"no frame", SendFlags::DONTWAIT).unwrap();
        now = now.plus_ns(1_000_000_000);
        server.poll(now, true, |_, _| LeaseState::Holder);
        assert_eq!(server.connections(), 0);
    }
    assert_eq!(rt::allocations().0.allocated, 0);
    assert!(used > 1000 && server.over_quota() > 1000, "{used} {}", server.over_quota());
}
