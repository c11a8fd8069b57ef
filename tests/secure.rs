//! Tests the page for other machines: TLS, certificate, token and hosts.

use crate::browser::Browser;
use crate::viewer::{self, Viewer};
use harness::{Rig, SOON, assert_ends};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use sha2::{Digest, Sha256};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;

type Tls = StreamOwned<ClientConnection, TcpStream>;

/// Connects as a browser that knows the authority in `folder`, and calls the server `name`.
fn connect(viewer: &Viewer, folder: &Path, name: &'static str) -> Tls {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(folder.join("ca.pem")).expect("the authority")).expect("a certificate");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().expect("versions");
    let config = Arc::new(config.with_root_certificates(roots).with_no_client_auth());
    let stream = TcpStream::connect(viewer.host()).expect("it listens");
    stream.set_read_timeout(Some(SOON)).expect("a timeout");
    let name = ServerName::try_from(name).expect("a name");
    StreamOwned::new(ClientConnection::new(config, name).expect("TLS"), stream)
}

/// Returns the answer to a request, as far as it comes.
fn ask(mut tls: Tls, request: &str) -> String {
    let mut answer = Vec::new();
    if tls.write_all(request.as_bytes()).is_ok() {
        let _ = tls.read_to_end(&mut answer);
    }
    String::from_utf8_lossy(&answer).into_owned()
}

fn start(rig: &Rig, folder: &Path, names: &str) -> Viewer {
    Viewer::with(rig, &["--https", names, "--tls", folder.to_str().expect("UTF-8")])
}

#[test]
fn f135_page_for_other_machines_needs_tls_its_host_and_the_token() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let folder = folder.path().join("tls");
    let viewer = start(&rig, &folder, "127.0.0.1,localhost");
    assert!(viewer.address.starts_with("https://127.0.0.1:"), "{}", viewer.address);
    let (host, token) = (viewer.host().to_owned(), viewer.token().to_owned());
    let port = host.split(':').next_back().expect("a port").to_owned();
    let get = |path: &str, host: &str| format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n");
    for (name, host) in [("127.0.0.1", host.clone()), ("localhost", format!("localhost:{port}"))] {
        let page = ask(connect(&viewer, &folder, name), &get("/", &host));
        assert!(page.starts_with("HTTP/1.1 200 OK") && page.contains("</html>"), "{name}: {page}");
    }
    // A large file arrives whole.
    let three = ask(connect(&viewer, &folder, "localhost"), &get("/three.core.min.js", &host));
    let length = three.split("Content-Length: ").nth(1).and_then(|rest| rest.split("\r\n").next()?.parse().ok());
    assert_eq!(three.split_once("\r\n\r\n").map(|(_, body)| body.len()), length);
    let foreign = ask(connect(&viewer, &folder, "localhost"), &get("/", "elsewhere.example"));
    assert!(foreign.starts_with("HTTP/1.1 403"), "{foreign}");
    // It tells the fingerprint of the certificate that it shows.
    let mut tls = connect(&viewer, &folder, "localhost");
    tls.write_all(get("/", &host).as_bytes()).expect("it reads");
    let shown = tls.conn.peer_certificates().expect("a certificate")[0].clone();
    let message: Vec<String> = Sha256::digest(&shown).iter().map(|byte| format!("{byte:02X}")).collect();
    assert!(viewer.printed.contains(&format!("  {}\n", message.join(":"))), "{}", viewer.printed);
    // HTTP without TLS gets one sentence, and another name no answer.
    let plain = viewer.get("/");
    assert!(plain.starts_with("HTTP/1.1 400") && plain.contains("this page is served by TLS"), "{plain}");
    assert!(!plain.contains("</html>"), "{plain}");
    assert_eq!(ask(connect(&viewer, &folder, "elsewhere.example"), &get("/", &host)), "");
    let upgrade = |token: &str, origin: &str| {
        let mut request = format!("wss://{host}/live?token={token}").into_client_request().expect("a request");
        request.headers_mut().insert("origin", origin.parse().expect("an origin"));
        tungstenite::client(request, connect(&viewer, &folder, "localhost")).ok()
    };
    let own = format!("https://{host}");
    for (token, origin) in [
        ("0".repeat(token.len()), own.as_str()),
        (String::new(), own.as_str()),
        (token.clone(), "https://elsewhere.example"),
        (token.clone(), &format!("http://{host}")),
    ] {
        assert!(upgrade(&token, origin).is_none(), "{token} {origin}");
    }
    let (mut page, _) = upgrade(&token, &own).expect("our page is let in");
    let scene = page.read().expect("the scene");
    assert!(scene.to_text().expect("text").contains("\"scene\""));
}

#[test]
fn browser_takes_page_by_tls_as_secure_and_connects() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let viewer = start(&rig, folder.path(), "127.0.0.1");
    // As if the user had accepted the certificate.
    let Some(mut browser) = Browser::with(&viewer.address, &["--ignore-certificate-errors"]) else { return };
    browser.wait_text("link", "connected");
    assert_eq!(browser.evaluate("isSecureContext && location.protocol"), "https:");
}

/// A peer that begins TLS and goes on slowly, or not at all, keeps no thread and nobody out.
#[test]
fn f136_silent_and_slow_peers_are_closed_and_keep_nobody_out() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let viewer = start(&rig, folder.path(), "127.0.0.1");
    let host = viewer.host().to_owned();
    let silent: Vec<_> = (0..40).map(|_| TcpStream::connect(&host).expect("it listens")).collect();
    let mut slow = TcpStream::connect(&host).expect("it listens");
    slow.set_read_timeout(Some(Duration::from_millis(100))).expect("a timeout");
    // The beginning of a long record of a handshake, a byte at a time.
    let (begun, mut bytes) = (Instant::now(), [22, 3, 1, 1, 0].into_iter().chain(std::iter::repeat(0)));
    loop {
        if slow.write_all(&[bytes.next().expect("endless")]).is_err() {
            break;
        }
        match slow.read(&mut [0; 64]) {
            Ok(0) => break,
            Err(error) if !matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {
                break;
            }
            _ => assert!(begun.elapsed() < SOON, "it is never closed"),
        }
    }
    let page = ask(connect(&viewer, folder.path(), "127.0.0.1"), &format!("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n"));
    assert!(page.starts_with("HTTP/1.1 200 OK"), "{page}");
    drop(silent);
}

/// A certificate is made once for its names. One for other names is signed by the authority that browsers already know.
#[test]
fn certificate_is_kept_for_its_names_and_its_key_is_private() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("a file");
    let printed = |names: &str| {
        let viewer = start(&rig, folder.path(), names);
        let get = format!("GET / HTTP/1.1\r\nHost: {}\r\n\r\n", viewer.host());
        let page = ask(connect(&viewer, folder.path(), "127.0.0.1"), &get);
        assert!(page.starts_with("HTTP/1.1 200 OK"), "the known authority signed it: {page}");
        viewer.printed.clone()
    };
    let news = "new certificate, because the names changed: ";
    assert!(!printed("127.0.0.1").contains(news));
    let mode = |name: &str| folder.path().join(name).metadata().expect("a file").permissions().mode() & 0o777;
    let (first, authority) = (read("page.pem"), read("ca.pem"));
    assert_eq!((mode("page-key.pem"), mode("ca-key.pem")), (0o600, 0o600));
    assert_eq!(first.matches("BEGIN CERTIFICATE").count(), 2);
    assert!(!printed("127.0.0.1").contains(news));
    assert_eq!(read("page.pem"), first);
    let words = printed("127.0.0.1,robot.local");
    let expected = format!("{news}127.0.0.1 became 127.0.0.1, robot.local; the authority stays\n");
    assert!(words.contains(&expected), "{words}");
    assert_ne!(read("page.pem"), first);
    assert_eq!(read("ca.pem"), authority, "a browser has taken it");
    let before = read("page.pem");
    let key = folder.path().join("page-key.pem");
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o644)).expect("it is ours");
    let refuses = |names: &str, code: i32, expected: &str| {
        let tls = folder.path().to_str().expect("UTF-8");
        assert_ends(&mut viewer::command(&rig, &["--https", names, "--tls", tls]), code, &[expected]);
    };
    refuses("127.0.0.1,robot.local", 73, "others may read this key (mode 644); it must be 600");
    refuses("192.0.2.1", 69, "--https: 192.0.2.1: no interface of this machine has it");
    refuses("0.0.0.0", 64, "--https: 0.0.0.0: give one address of this machine");
    refuses("robot.local", 64, "--https: robot.local: the first name must be an IP address");
    refuses("127.0.0.1,a b", 64, "--https: a b: a name has letters");
    assert_eq!(read("page.pem"), before, "an address that cannot be used changes no certificate");
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).expect("it is ours");
    // A folder of an older teleopd has no key of the authority.
    std::fs::remove_file(folder.path().join("ca-key.pem")).expect("a file");
    assert!(!printed("127.0.0.1,robot.local").contains(news));
    let words = printed("127.0.0.1");
    assert!(words.contains("browsers must take ca.pem again"), "{words}");
    // Nor does a foreign key sign anything.
    std::fs::copy(key, folder.path().join("ca-key.pem")).expect("a key");
    refuses("127.0.0.1,a", 73, "it is not the key of ca.pem");
}
