//! The listener, the thread that reads the instance, and one thread per page.

use crate::ViewError;
use crate::calibration::Measuring;
use crate::http::{self, SiteConfig};
use crate::hub::{Hub, StatusWriter};
use crate::live::Live;
use crate::meshes::MeshFolder;
use crate::mixer::KeyPoses;
use crate::page;
use crate::page::PageSource;
use crate::recording_view::{Position, RecordingView};
use crate::robot_view::RobotView;
use crate::secure::{PageStream, Secure};
use crate::vision::VisionFiles;
use bus::DomainConfig;
use instance::Instance;
use robot::Model;
use serde_json::json;
use std::net::{IpAddr, Ipv4Addr, Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Default port of the page. IANA assigns it to no service.
pub const PORT: u16 = 8484;
/// Time between two frames: 60 a second.
const FRAME: Duration = Duration::from_nanos(16_666_667);
/// Silence after which the server opens the services again.
const REATTACH: Duration = Duration::from_secs(1);
/// Polling period for new connections.
const ACCEPT: Duration = Duration::from_millis(10);
/// Time for pages to end when the server ends. Then their connections are closed.
const END_WITHIN: Duration = Duration::from_secs(1);
/// Most connections at a time. A page needs eight files at once and one socket, and there may be several pages.
const CONNECTIONS_MAX: usize = 32;

/// Further abilities of the pages of an instance.
#[derive(Default)]
pub struct LiveOptions {
    /// A page may be the person that the robot follows, by mixing these.
    pub key_poses: Option<KeyPoses>,
    /// A page may be the person that its webcam sees, with the help of these files.
    pub vision: Option<VisionFiles>,
    /// Such a page may also measure its person, with the help of these.
    pub measuring: Option<Measuring>,
    /// The server listens at an address of this machine with TLS, and not on the loopback.
    pub secure: Option<Secure>,
}

/// Serves one admitted connection, which never blocks, until it ends or the server does.
type Serve = Arc<dyn Fn(PageStream, &AtomicBool) + Send + Sync>;

/// A running server. Dropping it stops it.
pub struct Server {
    address: String,
    /// The output for pages. A server of programs has none.
    hub: Option<Arc<Hub>>,
    ended: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Server {
    /// Shows `instance`, whose robot is that of `view`, at `port` of the loopback interface, or of the address of
    /// `options.secure`. Port 0 picks any free one.
    pub fn live(instance: &Instance, view: &RobotView, options: LiveOptions, port: u16) -> Result<Self, ViewError> {
        let LiveOptions { key_poses, vision, measuring, secure } = options;
        let names = key_poses.as_ref().map(|key_poses| &key_poses.names);
        let camera = vision.is_some();
        let about = json!({ "source": "live", "run_dir": instance.run_dir(), "key_poses": names, "camera": camera });
        let measuring = measuring.filter(|_| camera);
        let behind = PageSource::Instance(instance.clone(), key_poses.map(Arc::new), measuring);
        let hub = Arc::new(Hub::new(view, &about));
        let mut server = Self::pages_of(&hub, behind, view, (vision, secure), port)?;
        let (model, domain) = (view.model.clone(), instance.core_domain());
        let (opened, outcome) = channel();
        let thread = server.spawn("view", move |ended| publish_updates(&hub, &model, &domain, &opened, &ended));
        thread.map_err(|source| ViewError::Listen { port, source })?;
        outcome.recv().unwrap_or(Ok(()))?;
        Ok(server)
    }

    /// Shows a recording with this name, of the robot of `view`, like [`Server::live`] shows an instance.
    pub fn recording(recording: RecordingView, name: &str, view: &RobotView, port: u16) -> Result<Self, ViewError> {
        let about = json!({ "source": "recording", "name": name, "duration_s": recording.duration_s() });
        let position = Arc::new(Position::new(recording.duration_s()));
        let hub = Arc::new(Hub::new(view, &about));
        let mut server = Self::pages_of(&hub, PageSource::Recording(position.clone()), view, (None, None), port)?;
        let thread = server.spawn("view", move |ended| play(&hub, &recording, &position, &ended));
        thread.map_err(|source| ViewError::Listen { port, source })?;
        Ok(server)
    }

    /// Serves programs that ask for one of these subprotocols of WebSocket, best first, at `port` of the loopback interface. `serve` has a thread for
    /// each, and returns when its second argument is true. Port 0 picks any free one.
    pub fn programs(
        protocols: &'static [&'static str],
        port: u16,
        serve: impl Fn(PageStream, &AtomicBool) + Send + Sync + 'static,
    ) -> Result<Self, ViewError> {
        Self::listen((None, None, None), protocols, Arc::new(serve), port)
    }

    fn pages_of(
        hub: &Arc<Hub>,
        behind: PageSource,
        view: &RobotView,
        (vision, secure): (Option<VisionFiles>, Option<Secure>),
        port: u16,
    ) -> Result<Self, ViewError> {
        let own = hub.clone();
        let serve = move |stream, ended: &_| drop(page::serve(stream, &own, &behind, ended));
        let mut server = Self::listen((view.folder.clone(), vision, secure), &[], Arc::new(serve), port)?;
        server.hub = Some(hub.clone());
        Ok(server)
    }

    fn listen(
        (meshes, vision, secure): (Option<Arc<MeshFolder>>, Option<VisionFiles>, Option<Secure>),
        protocols: &'static [&'static str],
        serve: Serve,
        port: u16,
    ) -> Result<Self, ViewError> {
        let at = secure.as_ref().map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |secure| secure.address);
        let bind = |source| ViewError::Listen { port, source };
        let listener = TcpListener::bind((at, port)).map_err(bind)?;
        listener.set_nonblocking(true).map_err(bind)?;
        let port = listener.local_addr().map_err(bind)?.port();
        let key = http::Key::new(port, secure.as_ref()).map_err(bind)?;
        let address = if protocols.is_empty() { key.address() } else { key.socket_address() };
        let mut server = Self { address, hub: None, ended: Arc::default(), threads: Vec::new() };
        let (vision, tls) = (vision.map(Arc::new), secure.map(|secure| secure.config));
        let site = SiteConfig { key, meshes, vision, tls, protocols };
        server.spawn("listen", move |ended| accept(&listener, &site, &serve, &ended)).map_err(bind)?;
        Ok(server)
    }

    fn spawn(&mut self, name: &str, work: impl FnOnce(Arc<AtomicBool>) + Send + 'static) -> std::io::Result<()> {
        let ended = self.ended.clone();
        self.threads.push(std::thread::Builder::new().name(name.into()).spawn(move || work(ended))?);
        Ok(())
    }

    /// Returns the address to open in a browser, with its token.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Number of open pages.
    pub fn pages(&self) -> usize {
        self.hub.as_ref().map_or(0, |hub| hub.pages().load(Ordering::Relaxed))
    }

    /// Returns true if a server thread has ended by itself. This does not normally happen.
    pub fn has_ended(&self) -> bool {
        self.threads.iter().any(JoinHandle::is_finished)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Reads the instance and publishes to the hub. Readers must stay in the thread that opened them. `opened`
/// receives the result of the first opening.
fn publish_updates(
    hub: &Hub,
    model: &Model,
    domain: &DomainConfig,
    opened: &Sender<Result<(), ViewError>>,
    ended: &AtomicBool,
) {
    let mut live = match Live::open(domain.clone()) {
        Ok(live) => live,
        Err(error) => {
            let _ = opened.send(Err(error));
            return;
        }
    };
    let _ = opened.send(Ok(()));
    let mut writer = StatusWriter::new(model);
    let (begun, mut heard_at, mut next) = (rt::now(), Instant::now(), Instant::now());
    while !ended.load(Ordering::Relaxed) {
        let now = rt::now();
        let heard = live.look(now);
        if heard.is_anything() {
            heard_at = Instant::now();
        }
        let news = writer.update(heard, now.since(begun) as f64 * 1e-9);
        hub.show(&news.frame, news.status.as_deref());
        hub.happened(news.events);
        if heard_at.elapsed() > REATTACH {
            // A restarted instance has new services.
            heard_at = Instant::now();
            live = Live::open(domain.clone()).unwrap_or(live);
        }
        wait(&mut next);
    }
}

fn play(hub: &Hub, recording: &RecordingView, position: &Position, ended: &AtomicBool) {
    hub.happened(recording.events().to_vec());
    let (mut next, mut before) = (Instant::now(), Instant::now());
    while !ended.load(Ordering::Relaxed) {
        let now = Instant::now();
        // The recording plays only while a page is open, so nobody misses the beginning.
        let seen = hub.pages().load(Ordering::Relaxed) > 0;
        let at_s = position.advance(if seen { (now - before).as_secs_f64() } else { 0.0 });
        before = now;
        recording.show(hub, at_s);
        wait(&mut next);
    }
}

/// Sleeps until the next frame. A server that stood still does not catch up.
fn wait(next: &mut Instant) {
    *next = (*next + FRAME).max(Instant::now());
    std::thread::sleep(next.saturating_duration_since(Instant::now()));
}

struct Connection {
    stream: TcpStream,
    is_page: AtomicBool,
}

/// Accepts connections. Returns after all pages have ended.
fn accept(listener: &TcpListener, site: &SiteConfig, serve: &Serve, ended: &Arc<AtomicBool>) {
    let mut open: Vec<Arc<Connection>> = Vec::new();
    while !ended.load(Ordering::Relaxed) {
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(ACCEPT);
            continue;
        };
        open.retain(|one| !has_ended(one));
        if open.len() >= CONNECTIONS_MAX {
            // The oldest connection that is not yet a page is closed to make room. Silent connections therefore
            // keep nobody out.
            let Some(oldest) = open.iter().position(|one| !one.is_page.load(Ordering::Relaxed)) else { continue };
            let _ = open.remove(oldest).stream.shutdown(Shutdown::Both);
        }
        let (site, serve, ended) = (site.clone(), serve.clone(), ended.clone());
        let Ok(twin) = stream.try_clone() else { continue };
        let connection = Arc::new(Connection { stream: twin, is_page: AtomicBool::new(false) });
        let own = connection.clone();
        let work = move || {
            answer(stream, &site, &serve, &own.is_page, &ended);
            // Closes the connection now, not when the next one arrives.
            let _ = own.stream.shutdown(Shutdown::Both);
        };
        // Without a thread the connection is closed.
        if std::thread::Builder::new().name("page".into()).spawn(work).is_ok() {
            open.push(connection);
        }
    }
    let give_up = Instant::now() + END_WITHIN;
    while open.iter().any(|one| !has_ended(one)) {
        if Instant::now() > give_up {
            open.iter().for_each(|one| drop(one.stream.shutdown(Shutdown::Both)));
        }
        std::thread::sleep(ACCEPT);
    }
}

fn has_ended(connection: &Arc<Connection>) -> bool {
    Arc::strong_count(connection) == 1
}

fn answer(stream: TcpStream, site: &SiteConfig, serve: &Serve, is_page: &AtomicBool, ended: &AtomicBool) {
    // A connection that breaks off needs no handling.
    let Ok(stream) = PageStream::new(stream, site.tls.as_ref()) else { return };
    if let Ok(Some(mut stream)) = http::answer(stream, site)
        && stream.socket().set_nonblocking(true).and_then(|()| stream.socket().set_nodelay(true)).is_ok()
    {
        is_page.store(true, Ordering::Relaxed);
        serve(stream, ended);
    }
}
