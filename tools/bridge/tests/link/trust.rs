//! A server whose certificate another trusted authority signed. zenoh trusts the public authorities too.

use super::*;

/// Long enough for a hundred puts.
const WAIT: Duration = Duration::from_secs(2);

/// Hazard f130.
#[test]
fn server_of_another_trusted_authority_gets_status_only_by_name() {
    let folders = [keys("tiago", &["anna"]), keys("stranger", &[])];
    let mut both = folders.each_ref().map(|folder| Keys::read_robot(folder.path()).expect("keys"));
    let authorities = both.each_ref().map(|keys| keys.authority.as_str()).join("\n");
    both.iter_mut().for_each(|keys| keys.authority.clone_from(&authorities));
    let [robot, stranger] = both;
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).expect("a port").port();
    let address = [format!("quic/127.0.0.1:{port}")];
    let mut listening = config(&stranger, &address, &[]);
    listening["access_control"] = serde_json::json!({ "enabled": false });
    let server = opened(&listening);
    let received = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&received);
    let count_message = move |_: &[u8]| count.fetch_add(1, Ordering::Relaxed) < u64::MAX;
    server.receive("teleop/tiago/status".into(), count_message).expect("a session");
    for (router, is_admitted) in [(None, false), (Some("stranger".to_owned()), true)] {
        let wire = opened(&config(&Keys { router, ..robot.clone() }, &[], &address));
        let status = wire.publisher("teleop/tiago/status".into()).expect("a publisher");
        let is_received = within(WAIT, || {
            bridge::link::send(&status, b"status");
            received.load(Ordering::Relaxed) > 0
        });
        assert_eq!(is_received, is_admitted);
    }
}
