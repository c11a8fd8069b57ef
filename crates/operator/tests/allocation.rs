//! No poll allocates once the server has started.

use messages::{Layout as _, OPERATOR_VERSION, OperatorRequest, Stamp, Status};
use operator::Server;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketType};

fn allocated() -> u64 {
    rt::allocations().0.allocated
}

#[test]
fn server_allocates_nothing_for_client_lifecycle() {
    rt::watch_allocations();
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("control.sock");
    let mut server = Server::bind(&path).unwrap();
    let address = SocketAddrUnix::new(&path).unwrap();
    let before = allocated();
    let mut requests = 0;
    for round in 1..=100 {
        let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::SEQPACKET, None).unwrap();
        rustix::net::connect(&socket, &address).unwrap();
        for sequence in 1..=10 {
            let request = OperatorRequest { version: OPERATOR_VERSION, sequence, ..OperatorRequest::ZERO };
            rustix::net::send(&socket, &operator::encode_request(&request), SendFlags::empty()).unwrap();
            server.poll(Stamp(round), &Status::ZERO);
            let mut reply = [0; operator::STATUS_BYTES];
            requests += u64::from(rustix::net::recv(&socket, &mut reply[..], RecvFlags::DONTWAIT).is_ok());
        }
        drop(socket);
        assert_eq!(server.poll(Stamp(round), &Status::ZERO).connections, 0);
    }
    assert_eq!(allocated(), before);
    assert_eq!(requests, 1000);
}
