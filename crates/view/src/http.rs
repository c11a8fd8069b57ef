//! The few requests that a page makes: for its own files, for the user's meshes and model, and for the WebSocket. A viewer
//! that is another program only opens a WebSocket.

use crate::assets::ASSETS;
use crate::meshes::{MeshFile, MeshFolder};
use crate::secure::{PageStream, Secure};
use crate::vision::VisionFiles;
use rustix::rand::{GetRandomFlags, getrandom};
use rustls::ServerConfig;
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::handshake::server::{Request, create_response, write_response};
use tungstenite::http;

/// Longest request, bytes, and most headers in it. Browsers send less than a tenth.
const REQUEST_BYTES: usize = 16 << 10;
const HEADERS_MAX: usize = 64;
/// Time limit of a request.
const PATIENCE: Duration = Duration::from_secs(2);

const WRONG_TOKEN: &str = "the token is missing or wrong; open the address that the server printed";
/// Header with the subprotocols of a WebSocket.
const PROTOCOL: http::HeaderName = http::header::SEC_WEBSOCKET_PROTOCOL;

/// Content policy for the browser: the page loads nothing from elsewhere, and no other page may frame it. The
/// hash is that of the page's import map. The loaders of three.js find three.js by this map. Textures inside a
/// mesh are blobs of the page.
pub const POLICY: &str = "Content-Security-Policy: default-src 'none'; \
                      script-src 'self' 'sha256-nW+1Z6nHBWz1iz2Ot2Bj8RgL3F+cXOInaXkhyR7xus0='; style-src 'self'; \
                      connect-src 'self' blob:; img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
                      X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCache-Control: no-store\r\n";

/// Returns the policy of a server with a camera. WebAssembly may run, and the page may use the camera. Everything else
/// stays forbidden, so neither an image nor a count of them leaves this machine.
pub fn camera_policy() -> String {
    let policy = POLICY.replacen("script-src 'self'", "script-src 'self' 'wasm-unsafe-eval'", 1);
    format!("{policy}Permissions-Policy: camera=(self), microphone=(), display-capture=()\r\n")
}

/// Access check. Everyone who has the address with its token may view the page and send requests.
#[derive(Clone, Debug)]
pub struct Key {
    token: String,
    port: u16,
    scheme: &'static str,
    /// Names and addresses of this machine.
    names: Vec<String>,
}

impl Key {
    /// Creates a new token of 128 bits, for a server at `port` of the loopback interface, or of the names of `secure`. Nobody
    /// guesses it: at a million tries a second, half of them take 5e24 years.
    pub fn new(port: u16, secure: Option<&Secure>) -> std::io::Result<Self> {
        let mut bytes = [0_u8; 16];
        let length = getrandom(&mut bytes[..], GetRandomFlags::empty())?;
        if length != bytes.len() {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let (scheme, names) = match secure {
            None => ("http", ["127.0.0.1", "localhost"].map(str::to_owned).to_vec()),
            Some(secure) => ("https", secure.names.clone()),
        };
        // An IPv6 address stands in brackets.
        let names = names.into_iter().map(|name| if name.contains(':') { format!("[{name}]") } else { name }).collect();
        Ok(Self { token, port, scheme, names })
    }

    /// Returns the address to open. The token stands after the #. Browsers do not send that part.
    pub fn address(&self) -> String {
        format!("{}://{}:{}/#{}", self.scheme, self.names.first().map_or("", String::as_str), self.port, self.token)
    }

    /// Returns the address that a program opens. A program sends all of it, and to this server alone.
    pub fn socket_address(&self) -> String {
        format!("ws://{}:{}/?token={}", self.names.first().map_or("", String::as_str), self.port, self.token)
    }

    /// Returns true for a valid host name of this server. Another name in `Host` belongs to a foreign page whose name
    /// resolves to this server.
    fn is_host(&self, given: &str) -> bool {
        // Browsers leave out the port of the scheme.
        let usual = if self.scheme == "https" { 443 } else { 80 };
        let is_port = |rest: &str| rest == format!(":{}", self.port) || rest.is_empty() && self.port == usual;
        self.names.iter().any(|name| given.strip_prefix(name.as_str()).is_some_and(is_port))
    }

    /// Accepts a WebSocket request with our token that comes from our page, or asks for one of these subprotocols, which it
    /// returns. Otherwise the error gives the reason. A viewer may be a page from elsewhere: its user gave it the token.
    fn admits(&self, request: &Request, protocols: &[&'static str]) -> Result<Option<&'static str>, String> {
        let header = |name: &str| request.headers().get(name).and_then(|value| value.to_str().ok());
        let host = header("origin").and_then(|origin| origin.strip_prefix(self.scheme)?.strip_prefix("://"));
        let offers = request.headers().get_all(PROTOCOL).iter().filter_map(|offer| offer.to_str().ok());
        let offers: Vec<_> = offers.flat_map(|offer| offer.split(',')).map(str::trim).collect();
        let protocol = protocols.iter().copied().find(|protocol| offers.contains(protocol));
        if protocols.is_empty() && !host.is_some_and(|host| self.is_host(host)) {
            return Err("only this server's own page may send requests".to_owned());
        } else if !protocols.is_empty() && protocol.is_none() {
            return Err(format!("the WebSocket's subprotocol must be {}", protocols.join(" or ")));
        }
        let token = request.uri().query().and_then(|query| query.strip_prefix("token="));
        if !token.is_some_and(|given| self.is_token(given)) {
            return Err(WRONG_TOKEN.to_owned());
        }
        Ok(protocol)
    }

    /// Compares every byte, so that the duration reveals nothing about the token.
    fn is_token(&self, given: &str) -> bool {
        let same = given.bytes().zip(self.token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0;
        given.len() == self.token.len() && same
    }
}

/// Content that a server serves besides its own files, and the access check.
#[derive(Clone, Debug)]
pub struct SiteConfig {
    pub key: Key,
    pub meshes: Option<Arc<MeshFolder>>,
    pub vision: Option<Arc<VisionFiles>>,
    /// TLS. Without it the server listens on the loopback.
    pub tls: Option<Arc<ServerConfig>>,
    /// Subprotocols of a server of programs, which serves nothing else, best first.
    pub protocols: &'static [&'static str],
}

impl SiteConfig {
    fn head(&self, status: &str, kind: &str, length: u64) -> String {
        let policy = if self.vision.is_some() { camera_policy() } else { POLICY.to_owned() };
        format!(
            "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{policy}Connection: close\r\n\r\n"
        )
    }
}

/// Answers one connection. Returns the stream if it is now a page's WebSocket.
pub fn answer(mut stream: PageStream, site: &SiteConfig) -> std::io::Result<Option<PageStream>> {
    stream.socket().set_write_timeout(Some(PATIENCE))?;
    stream.give_up_at(Some(Instant::now() + PATIENCE));
    if stream.lacks_tls()? {
        let mut stream = stream.without_tls();
        read(&mut stream)?;
        let why =
            "this page is served by TLS: open the whole address that the view printed, with https at its beginning";
        return refuse(stream, site, "400 Bad Request", why);
    }
    let (request, key) = (read(&mut stream)?, &site.key);
    let host = request.headers().get("host").and_then(|host| host.to_str().ok());
    if !host.is_some_and(|host| key.is_host(host)) {
        let why = format!("the host must be {}, with this server's port", key.names.join(" or "));
        return refuse(stream, site, "403 Forbidden", &why);
    }
    if request.method() != http::Method::GET {
        return refuse(stream, site, "405 Method Not Allowed", "only GET is supported");
    }
    if !site.protocols.is_empty() || request.uri().path() == "/live" {
        let protocol = match key.admits(&request, site.protocols) {
            Ok(protocol) => protocol.map(http::HeaderValue::from_static),
            Err(why) => return refuse(stream, site, "403 Forbidden", &why),
        };
        return match create_response(&request) {
            Ok(mut response) => {
                response.headers_mut().extend(protocol.map(|protocol| (Some(PROTOCOL), protocol)));
                write_response(&mut stream, &response).map_err(std::io::Error::other)?;
                Ok(Some(stream))
            }
            Err(error) => refuse(stream, site, "400 Bad Request", &error.to_string()),
        };
    }
    for folder in [Folder::Meshes, Folder::Vision] {
        if let Some(path) = request.uri().path().strip_prefix(folder.prefix()) {
            return user_file(stream, site, folder, path);
        }
    }
    match ASSETS.iter().find(|asset| asset.path == request.uri().path()) {
        Some(asset) => send(stream, site, "200 OK", asset.kind, asset.bytes),
        None => refuse(stream, site, "404 Not Found", "no such page"),
    }
}

/// Files that the user named.
#[derive(Clone, Copy, Debug)]
enum Folder {
    Meshes,
    Vision,
}

impl Folder {
    /// Beginning of the paths in addresses.
    const fn prefix(self) -> &'static str {
        match self {
            Self::Meshes => "/meshes/",
            Self::Vision => "/vision/",
        }
    }

    fn read(self, site: &SiteConfig, path: &str) -> Result<MeshFile, &'static str> {
        match self {
            Self::Meshes => site.meshes.as_ref().ok_or("there is no folder of meshes")?.read(path),
            Self::Vision => site.vision.as_ref().ok_or("there is no camera")?.read(path),
        }
    }
}

/// Serves a file that the user named. `path` is the token, then the file's path below the folder. The token stands in
/// the path because such files refer to others by relative paths.
fn user_file(
    mut stream: PageStream,
    site: &SiteConfig,
    folder: Folder,
    path: &str,
) -> std::io::Result<Option<PageStream>> {
    let Some((token, path)) = path.split_once('/') else {
        return refuse(stream, site, "404 Not Found", "no such file");
    };
    if !site.key.is_token(token) {
        return refuse(stream, site, "403 Forbidden", WRONG_TOKEN);
    }
    let Some(path) = percent_decoded(path) else {
        return refuse(stream, site, "400 Bad Request", "the path is not UTF-8");
    };
    match folder.read(site, &path) {
        Ok(found) => {
            stream.write_all(site.head("200 OK", found.kind, found.bytes).as_bytes())?;
            // A file may grow while it is read. Send no byte more than announced.
            std::io::copy(&mut found.file.take(found.bytes), &mut stream)?;
            stream.flush()?;
            Ok(None)
        }
        Err(why) => refuse(stream, site, "404 Not Found", why),
    }
}

fn percent_decoded(path: &str) -> Option<String> {
    let (mut bytes, mut rest) = (Vec::with_capacity(path.len()), path.as_bytes());
    while let Some((&first, after)) = rest.split_first() {
        let escaped = (first == b'%').then(|| after.get(..2)).flatten();
        let code = escaped.and_then(|two| u8::from_str_radix(std::str::from_utf8(two).ok()?, 16).ok());
        if first == b'%' && code.is_none() {
            return None;
        }
        bytes.push(code.unwrap_or(first));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    String::from_utf8(bytes).ok()
}

fn refuse(stream: PageStream, site: &SiteConfig, status: &str, why: &str) -> std::io::Result<Option<PageStream>> {
    send(stream, site, status, "text/plain; charset=utf-8", format!("{why}\n").as_bytes())
}

fn send(
    mut stream: PageStream,
    site: &SiteConfig,
    status: &str,
    kind: &str,
    body: &[u8],
) -> std::io::Result<Option<PageStream>> {
    stream.write_all(site.head(status, kind, body.len() as u64).as_bytes())?;
    stream.write_all(body)?;
    stream.flush()?;
    Ok(None)
}

/// Reads up to the empty line, and ends the time limit, which includes the beginning of TLS.
fn read(stream: &mut PageStream) -> std::io::Result<Request> {
    let mut head = Vec::with_capacity(1024);
    loop {
        if head.len() >= REQUEST_BYTES {
            return Err(ErrorKind::TimedOut.into());
        }
        let mut part = [0; 1024];
        match stream.read(&mut part)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            length => head.extend_from_slice(&part[..length]),
        }
        if head.windows(4).any(|end| end == b"\r\n\r\n") {
            stream.give_up_at(None);
            return parse(&head).ok_or_else(|| ErrorKind::InvalidData.into());
        }
    }
}

fn parse(head: &[u8]) -> Option<Request> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
    let mut parsed = httparse::Request::new(&mut headers);
    if !parsed.parse(head).ok()?.is_complete() {
        return None;
    }
    let mut request = http::Request::builder().method(parsed.method?).uri(parsed.path?).version(http::Version::HTTP_11);
    for header in parsed.headers.iter() {
        request = request.header(header.name, header.value);
    }
    request.body(()).ok()
}
