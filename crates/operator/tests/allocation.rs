//! No poll allocates once the server has started.
#![allow(unsafe_code, reason = "a counting allocator has to implement GlobalAlloc")]

use messages::{Layout as _, OPERATOR_VERSION, OperatorRequest, Stamp, Status};
use operator::Server;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrUnix, SocketType};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: forwards to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's contract is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn connecting_talking_and_leaving_allocate_nothing() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("control.sock");
    let mut server = Server::bind(&path).unwrap();
    let address = SocketAddrUnix::new(&path).unwrap();
    let before = COUNT.with(Cell::get);
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
    assert_eq!(COUNT.with(Cell::get), before);
    assert_eq!(requests, 1000);
}
