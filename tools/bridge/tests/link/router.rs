//! Robot and operators that reach only a router.

use super::relay::engage;
use super::*;

#[test]
fn router_carries_what_the_robot_admits_and_its_end_is_a_release() {
    harness::in_real_time(|| {
        let keys = keys("tiago", &[]);
        for words in [&["router"][..], &["operator", "--name", "anna"], &["operator", "--name", "bob"]] {
            let made = bridge(&[&["pair"], words, &["--keys", text(keys.path())]].concat());
            assert!(made.status.success(), "{made:?}");
        }
        // The router has not been text of Bob.
        let admitted = tempfile::tempdir().expect("a folder");
        std::fs::copy(keys.path().join("operators/anna.pem"), admitted.path().join("anna.pem")).expect("a copy");
        let port = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).expect("a port").port();
        let address = format!("quic/127.0.0.1:{port}");
        let bundle = keys.path().join("router.bundle");
        let route = || {
            let end = End::start(&[
                "router",
                "--bundle",
                text(&bundle),
                "--operators",
                text(admitted.path()),
                "--listen",
                &address,
            ]);
            end.wait_line("admits anna");
            end
        };
        let daemon = Daemon::start();
        let robot = robot_end(&keys, "--connect", &address, &daemon);
        let router = route();
        let world = World { daemon, keys, address: address.clone(), robot };
        let folders = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
        let _anna = world.operator(&world.bundle("anna"), folders[0].path());
        let bob = world.operator(&world.bundle("bob"), folders[1].path());
        world.robot.wait_line("anna: ready");
        let _client = publisher(folders[0].path());
        let _hand = engage(&world, folders[0].path());
        follows(&world, "persons come", 50);
        bob.wait_line("no answer");
        assert!(OperatorSession::connect(&folders[1].path().join("operator.sock")).is_err());

        drop(router);
        wait_until("released", || !world.daemon.is_held());
        let (edges, before) = (world.daemon.counts().enable_edges, world.daemon.persons());
        let _router = route();
        wait_until("persons come again", || world.daemon.persons() > before + 50);
        assert!(world.daemon.is_released(edges), "by itself");
        assert_none_was_old(&world);
    });
}
