//! A page for other machines: the stream of a connection with or without TLS, and the certificate. Only TLS leaves the
//! loopback. A headset needs it, too, because browsers offer WebXR to secure pages alone.

use rcgen::{
    BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair, KeyUsagePurpose, PublicKeyData, date_time_ymd,
};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use sha2::{Digest, Sha256};
use std::fs::{DirBuilder, OpenOptions};
use std::io::{Error, ErrorKind, Read, Write};
use std::net::{IpAddr, TcpListener, TcpStream};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Files of the certificate below its folder. The authority outlives the names, so a browser that took it stays content.
const AUTHORITY: &str = "ca.pem";
const AUTHORITY_KEY: &str = "ca-key.pem";
const PAGE: &str = "page.pem";
const KEY: &str = "page-key.pem";
const NAMES: &str = "names";
/// First year of a certificate, and the year after its last one.
const YEARS: [i32; 2] = [2026, 2046];

/// Errors that prevent a page for other machines.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum SecureError {
    #[error("--https: {value}: {why}")]
    Name { value: String, why: &'static str },
    #[error("{address}: {source}")]
    Address { address: IpAddr, source: Error },
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
    /// Sentence about what was made again, and why. `None` if the certificate was kept, or is the first one.
    pub made: Option<String>,
    /// The certificate's SHA-256 fingerprint, as browsers show it: AA:BB:...
    pub fingerprint: String,
}

impl Secure {
    /// Takes the certificate in `folder` for these names, and makes one if there is none or if it has other names. The first
    /// name is the IP address to listen at. Writes nothing if nothing can listen at its `port`.
    pub fn open(names: &[String], folder: &Path, port: u16) -> Result<Self, SecureError> {
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
        TcpListener::bind((address, port)).map_err(|source| SecureError::Address { address, source })?;
        let failed = |name: &str, why: String| SecureError::File { file: folder.join(name), why };
        let made = renewed(names, folder)?;
        check_private(folder, KEY)?;
        let key = PrivateKeyDer::from_pem_file(folder.join(KEY)).map_err(|error| failed(KEY, error.to_string()))?;
        let chain = CertificateDer::pem_file_iter(folder.join(PAGE)).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let chain = chain.map_err(|error| failed(PAGE, error.to_string()))?;
        let fingerprint = fingerprint(chain.first().ok_or_else(|| failed(PAGE, "it holds no certificate".into()))?);
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, key));
        let config = Arc::new(config.map_err(|error| failed(PAGE, error.to_string()))?);
        Ok(Self { address, names: names.to_vec(), config, authority: folder.join(AUTHORITY), made, fingerprint })
    }
}

fn fingerprint(certificate: &[u8]) -> String {
    Sha256::digest(certificate).iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(":")
}

/// Makes the certificate of a page, if there is none for these names, and returns what to say about it. The names go first
/// and come last, so that a part of a certificate is made again.
fn renewed(names: &[String], folder: &Path) -> Result<Option<String>, SecureError> {
    let failed = |name: &str, why: String| SecureError::File { file: folder.join(name), why };
    let before = std::fs::read_to_string(folder.join(NAMES)).ok();
    if before.as_deref() == Some(&names.join("\n")) {
        return Ok(None);
    }
    DirBuilder::new().recursive(true).mode(0o700).create(folder).map_err(|error| failed("", error.to_string()))?;
    let (authority, is_kept) = Signer::in_folder(folder)?;
    let (page, key) = authority.page(names).map_err(|error| failed(PAGE, error.to_string()))?;
    remove(&folder.join(NAMES)).map_err(|error| failed(NAMES, error.to_string()))?;
    for (name, text, mode) in [(PAGE, page, 0o644), (KEY, key, 0o600), (NAMES, names.join("\n"), 0o644)] {
        write(folder, name, &text, mode)?;
    }
    let authority = if is_kept {
        "the authority stays".to_owned()
    } else {
        format!("the authority is new, because {AUTHORITY_KEY} is missing, so browsers must take {AUTHORITY} again")
    };
    let [before, now] = [before.map(|before| before.replace('\n', ", ")), Some(names.join(", "))];
    let changed = before.zip(now).map(|(before, now)| format!("the names changed: {before} became {now}; {authority}"));
    Ok(changed.map(|why| format!("new certificate, because {why}")))
}

/// Refuses a key that others may read.
fn check_private(folder: &Path, name: &str) -> Result<(), SecureError> {
    let file = folder.join(name);
    let why = match file.metadata().map(|data| data.permissions().mode()) {
        Ok(mode) if mode & 0o077 == 0 => return Ok(()),
        Ok(mode) => format!("others may read this key (mode {:o}); it must be 600", mode & 0o777),
        Err(error) => error.to_string(),
    };
    Err(SecureError::File { file, why })
}

fn write(folder: &Path, name: &str, text: &str, mode: u32) -> Result<(), SecureError> {
    let file = folder.join(name);
    let written = remove(&file).and_then(|()| {
        OpenOptions::new().write(true).create_new(true).mode(mode).open(&file)?.write_all(text.as_bytes())
    });
    written.map_err(|error| SecureError::File { file, why: error.to_string() })
}

fn remove(file: &Path) -> std::io::Result<()> {
    std::fs::remove_file(file).or_else(|error| if error.kind() == ErrorKind::NotFound { Ok(()) } else { Err(error) })
}

fn valid(mut params: CertificateParams, name: &str) -> CertificateParams {
    let [from, to] = YEARS.map(|year| date_time_ymd(year, 1, 1));
    (params.not_before, params.not_after) = (from, to);
    params.distinguished_name.push(DnType::CommonName, name);
    params
}

/// The authority with its key.
struct Signer {
    params: CertificateParams,
    key: KeyPair,
    pem: String,
}

impl Signer {
    /// Takes the authority in `folder`, or makes one there. Returns true beside it if it was there.
    fn in_folder(folder: &Path) -> Result<(Self, bool), SecureError> {
        let failed = |name: &str, why: String| SecureError::File { file: folder.join(name), why };
        let unusable = |error: rcgen::Error| failed(AUTHORITY_KEY, error.to_string());
        let mut params = valid(CertificateParams::new(Vec::new()).map_err(unusable)?, "teleopd page of this machine");
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        if [AUTHORITY, AUTHORITY_KEY].iter().all(|name| folder.join(name).exists()) {
            check_private(folder, AUTHORITY_KEY)?;
            let read = |name: &str| {
                std::fs::read_to_string(folder.join(name)).map_err(|error| failed(name, error.to_string()))
            };
            let (pem, key) = (read(AUTHORITY)?, KeyPair::from_pem(&read(AUTHORITY_KEY)?).map_err(unusable)?);
            let root = CertificateDer::from_pem_slice(pem.as_bytes());
            let root = root.map_err(|error| failed(AUTHORITY, error.to_string()))?;
            let public = key.der_bytes();
            if !root.windows(public.len()).any(|bytes| bytes == public) {
                return Err(failed(
                    AUTHORITY_KEY,
                    format!("it is not the key of {AUTHORITY}; remove both for new ones"),
                ));
            }
            return Ok((Self { params, key, pem }, true));
        }
        let key = KeyPair::generate().map_err(unusable)?;
        let pem = params.self_signed(&key).map_err(unusable)?.pem();
        // Without its certificate, a key that was written alone is made again.
        remove(&folder.join(AUTHORITY)).map_err(|error| failed(AUTHORITY, error.to_string()))?;
        write(folder, AUTHORITY_KEY, &key.serialize_pem(), 0o600)?;
        write(folder, AUTHORITY, &pem, 0o644)?;
        Ok((Self { params, key, pem }, false))
    }

    /// Signs a new certificate of the page. Returns its chain and its key.
    fn page(&self, names: &[String]) -> Result<(String, String), rcgen::Error> {
        let key = KeyPair::generate()?;
        let page = valid(CertificateParams::new(names.to_vec())?, &names[0]);
        let page = page.signed_by(&key, &Issuer::from_params(&self.params, &self.key))?;
        Ok((page.pem() + &self.pem, key.serialize_pem()))
    }
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

    fn limit(&self) -> Result<(), Error> {
        self.left()?.map_or(Ok(()), |left| self.socket.set_read_timeout(Some(left)))
    }
}

impl Read for TimedSocket {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        self.limit()?;
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

    /// Returns true if TLS is expected, and the peer begins with a letter, as HTTP does. Waits for its first byte.
    pub(crate) fn lacks_tls(&mut self) -> Result<bool, Error> {
        let Kind::Tls(stream) = &self.0 else { return Ok(false) };
        let mut first = [0];
        stream.sock.limit()?;
        Ok(stream.sock.socket.peek(&mut first)? == 1 && first[0].is_ascii_alphabetic())
    }

    /// Returns the same connection without TLS, of which nothing may have been sent.
    pub(crate) fn without_tls(self) -> Self {
        match self.0 {
            Kind::Tls(stream) => Self(Kind::Plain(stream.into_parts().1)),
            plain @ Kind::Plain(_) => Self(plain),
        }
    }

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
