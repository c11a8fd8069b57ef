//! A page for other machines: the stream of a connection with or without TLS, and the certificate. Only TLS leaves the
//! loopback. A headset needs it, too, because browsers offer WebXR to secure pages alone.

use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair, KeyUsagePurpose, date_time_ymd};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use std::fs::{DirBuilder, OpenOptions};
use std::io::{Error, ErrorKind, Read, Write};
use std::net::{IpAddr, TcpStream};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Files of the certificate below its folder. The authority signs once, and its key is never written.
const AUTHORITY: &str = "ca.pem";
const PAGE: &str = "page.pem";
const KEY: &str = "page-key.pem";
const NAMES: &str = "names";
/// First year of a certificate, and the year after its last one.
const YEARS: [i32; 2] = [2026, 2046];

/// Errors that prevent a page for other machines.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum SecureError {
    /// A name or an address cannot be used.
    #[error("--https: {value}: {why}")]
    Name { value: String, why: &'static str },
    /// A file of the certificate cannot be read, written or used.
    #[error("{}: {why}", file.display())]
    File { file: PathBuf, why: String },
}

/// Where a page for other machines listens, and what it shows them.
#[derive(Clone, Debug)]
pub struct Secure {
    /// Address to listen at.
    pub address: IpAddr,
    pub(crate) names: Vec<String>,
    pub(crate) config: Arc<ServerConfig>,
    /// File of the certificate of the authority, for browsers.
    pub authority: PathBuf,
}

impl Secure {
    /// Takes the certificate in `folder` for these names, and makes one if there is none or if it has other names. The first
    /// name is the IP address to listen at.
    ///
    /// # Errors
    /// Returns an error if a name cannot be used, or if a file cannot be read, written or used.
    pub fn open(names: &[String], folder: &Path) -> Result<Self, SecureError> {
        let refused = |value: &str, why| SecureError::Name { value: value.to_owned(), why };
        let first = names.first().map_or("", String::as_str);
        let address: IpAddr =
            first.parse().map_err(|_| refused(first, "the first name must be an IP address of this machine"))?;
        if address.is_unspecified() || address.is_multicast() {
            return Err(refused(first, "give one address of this machine, by which others reach it"));
        }
        let is_plain = |name: &&String| name.bytes().all(|c| c.is_ascii_alphanumeric() || b".-:".contains(&c));
        if let Some(name) = names.iter().find(|name| name.is_empty() || !is_plain(name)) {
            return Err(refused(name, "a name has letters, digits, dots and hyphens only"));
        }
        let failed = |name: &str, why: String| SecureError::File { file: folder.join(name), why };
        if std::fs::read_to_string(folder.join(NAMES)).ok() != Some(names.join("\n")) {
            make(names, folder)?;
        }
        let mode = folder.join(KEY).metadata().map_err(|error| failed(KEY, error.to_string()))?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(failed(KEY, format!("others may read this key (mode {:o}); it must be 600", mode & 0o777)));
        }
        let key = PrivateKeyDer::from_pem_file(folder.join(KEY)).map_err(|error| failed(KEY, error.to_string()))?;
        let chain = CertificateDer::pem_file_iter(folder.join(PAGE)).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let chain = chain.map_err(|error| failed(PAGE, error.to_string()))?;
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, key));
        let config = Arc::new(config.map_err(|error| failed(PAGE, error.to_string()))?);
        Ok(Self { address, names: names.to_vec(), config, authority: folder.join(AUTHORITY) })
    }
}

/// Makes an authority and the certificate of a page, and writes them. The names go first and come last, so that a part of a
/// certificate is made again.
fn make(names: &[String], folder: &Path) -> Result<(), SecureError> {
    let failed = |name: &str, why: String| SecureError::File { file: folder.join(name), why };
    let made = signed(names).map_err(|error| failed(PAGE, error.to_string()))?;
    DirBuilder::new().recursive(true).mode(0o700).create(folder).map_err(|error| failed("", error.to_string()))?;
    remove(&folder.join(NAMES)).map_err(|error| failed(NAMES, error.to_string()))?;
    let files = [(AUTHORITY, made.authority, 0o644), (PAGE, made.page, 0o644), (KEY, made.key, 0o600)];
    for (name, text, mode) in files.into_iter().chain([(NAMES, names.join("\n"), 0o644)]) {
        let file = folder.join(name);
        let written = remove(&file).and_then(|()| {
            OpenOptions::new().write(true).create_new(true).mode(mode).open(&file)?.write_all(text.as_bytes())
        });
        written.map_err(|error| failed(name, error.to_string()))?;
    }
    Ok(())
}

/// Removes a file, if there is one.
fn remove(file: &Path) -> std::io::Result<()> {
    std::fs::remove_file(file).or_else(|error| if error.kind() == ErrorKind::NotFound { Ok(()) } else { Err(error) })
}

/// Texts of a new certificate.
struct Made {
    authority: String,
    page: String,
    key: String,
}

fn signed(names: &[String]) -> Result<Made, rcgen::Error> {
    let valid = |mut params: CertificateParams, name: &str| {
        let [from, to] = YEARS.map(|year| date_time_ymd(year, 1, 1));
        (params.not_before, params.not_after) = (from, to);
        params.distinguished_name.push(DnType::CommonName, name);
        params
    };
    let mut authority = valid(CertificateParams::new(Vec::new())?, "teleopd page of this machine");
    authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    authority.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    let signer = KeyPair::generate()?;
    let root = authority.self_signed(&signer)?;
    let key = KeyPair::generate()?;
    let page = valid(CertificateParams::new(names.to_vec())?, &names[0]);
    let page = page.signed_by(&key, &Issuer::new(authority, signer))?;
    Ok(Made { authority: root.pem(), page: page.pem() + &root.pem(), key: key.serialize_pem() })
}

/// A socket that gives up at a time. A peer that sends a byte now and then holds no thread for longer.
struct TimedSocket {
    socket: TcpStream,
    give_up: Option<Instant>,
}

impl TimedSocket {
    fn left(&self) -> Result<Option<Duration>, Error> {
        let left = self.give_up.map(|give_up| give_up.saturating_duration_since(Instant::now()));
        if left.is_some_and(|left| left.is_zero()) { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }
}

impl Read for TimedSocket {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        if let Some(left) = self.left()? {
            self.socket.set_read_timeout(Some(left))?;
        }
        self.socket.read(bytes)
    }
}

impl Write for TimedSocket {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.socket.write(bytes)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.socket.flush()
    }
}

/// A connection with or without TLS.
pub struct PageStream(Kind);

enum Kind {
    Plain(TimedSocket),
    Tls(Box<StreamOwned<ServerConnection, TimedSocket>>),
}

impl PageStream {
    /// Takes an accepted connection. Nothing is sent or received yet.
    ///
    /// # Errors
    /// Returns an error if TLS cannot begin.
    pub(crate) fn new(socket: TcpStream, config: Option<&Arc<ServerConfig>>) -> Result<Self, Error> {
        let socket = TimedSocket { socket, give_up: None };
        Ok(Self(match config {
            None => Kind::Plain(socket),
            Some(config) => {
                let tls = ServerConnection::new(config.clone()).map_err(Error::other)?;
                Kind::Tls(Box::new(StreamOwned::new(tls, socket)))
            }
        }))
    }

    fn timed(&mut self) -> &mut TimedSocket {
        match &mut self.0 {
            Kind::Plain(socket) => socket,
            Kind::Tls(stream) => &mut stream.sock,
        }
    }

    /// Sets the time at which reading gives up. `None` waits for ever.
    pub(crate) fn give_up_at(&mut self, at: Option<Instant>) {
        self.timed().give_up = at;
    }

    /// Returns the socket, for its options.
    pub(crate) fn socket(&mut self) -> &TcpStream {
        &self.timed().socket
    }
}

/// Reads without waiting for what is still to be written, as the stream of rustls would. So a page that does not read can
/// still send a stop.
fn read(stream: &mut StreamOwned<ServerConnection, TimedSocket>, bytes: &mut [u8]) -> Result<usize, Error> {
    if stream.conn.is_handshaking() {
        return stream.read(bytes);
    }
    loop {
        match stream.conn.reader().read(bytes) {
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            read => return read,
        }
        if stream.conn.read_tls(&mut stream.sock)? == 0 {
            return Ok(0);
        }
        stream.conn.process_new_packets().map_err(|error| Error::new(ErrorKind::InvalidData, error))?;
    }
}

impl Read for PageStream {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        match &mut self.0 {
            Kind::Plain(socket) => socket.read(bytes),
            Kind::Tls(stream) => read(stream, bytes),
        }
    }
}

impl Write for PageStream {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        match &mut self.0 {
            Kind::Plain(socket) => socket.write(bytes),
            Kind::Tls(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> Result<(), Error> {
        match &mut self.0 {
            Kind::Plain(socket) => socket.flush(),
            Kind::Tls(stream) => stream.flush(),
        }
    }
}
