//! A domain: the processes that share one root path and one prefix see each other, and no other process.

use crate::carried::{Carried, ReadPort, WritePort};
use crate::error::BusError;
use crate::payload::Payload;
use crate::presence::Presence;
use crate::reader::{IpcReader, IpcWakeListener, Reader, WakeListener, WakingReader};
use crate::shared_memory;
use crate::writer::{IpcWriter, Writer};
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::{
    BackpressureStrategy, Config, FileName, Node, NodeBuilder, NodeName, Path, SemanticString, ServiceName,
    SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError as CreateError, PublishSubscribeOpenError as OpenError,
    PublishSubscribeOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use messages::{Message, Service};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// Longest time for opening a domain. Cleaning up after dead processes took at most 51 ms (measured, 0.10.0).
const START_DEADLINE: Duration = Duration::from_secs(5);
/// Attempts to open a service that another process is creating or cleaning up. The pauses add up to 0.6 s.
const ATTEMPTS: u32 = 10;
/// Pause before the second attempt. It doubles up to `PAUSE_LONGEST`.
const PAUSE_FIRST: Duration = Duration::from_millis(2);
/// Longest pause between attempts.
const PAUSE_LONGEST: Duration = Duration::from_millis(100);
/// Attempts to get a writer's place. A dead writer loses its place at the first cleaning, a living one keeps it.
const WRITER_ATTEMPTS: u32 = 4;
/// Longest wait of one cleaning for another process that cleans at the same time.
const CLEANING: Duration = Duration::from_millis(500);
/// Readers of one service: five processes, the recorder, views and tools, and their successors.
const READERS_MAX: usize = 16;
/// Most readers of a service whose messages wait. A robot alone reads its setpoints, and each place costs the whole queue.
const WAITING_READERS_MAX: usize = 3;
/// Processes (one node each) that may hold one service.
const NODES_MAX: usize = 32;
/// Room in a Unix socket address (sun_path, unix(7)), without the closing zero.
const SOCKET_PATH_MAX: usize = 107;
/// Digits of the largest port number (128 bit, decimal), which names the sockets below the root.
const PORT_DIGITS: usize = 39;

type Ipc = ipc::Service;
pub(crate) type DataService<M> = publish_subscribe::PortFactory<Ipc, Payload<M>, ()>;
pub(crate) type EventService = event::PortFactory<Ipc>;

/// The place of a domain. Every running instance needs its own pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DomainConfig {
    /// Folder of sockets and service descriptions, absolute. It is created (0700) if it is missing.
    pub root: PathBuf,
    /// Beginning of the names in /dev/shm: lower-case letters, digits, `_`, `-`.
    pub prefix: String,
}

impl DomainConfig {
    /// Checks that the transport can use this place. Creates nothing.
    pub fn check(&self) -> Result<(), BusError> {
        transport_config(self).map(drop)
    }
}

/// A process's membership in a domain. It is `Send`, but its ports are not.
pub struct Domain {
    node: Box<dyn AsNode + Send>,
    config: DomainConfig,
    // Declared last, so that the node is dropped before it.
    presence: Arc<Presence>,
}

/// Exists only so that programs do not compile the code of [`Node`] again. See `carried`.
trait AsNode {
    fn node(&self) -> &Node<Ipc>;
}

impl AsNode for Node<Ipc> {
    fn node(&self) -> &Node<Ipc> {
        self
    }
}

impl std::fmt::Debug for Domain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Domain").field("config", &self.config).finish_non_exhaustive()
    }
}

impl Domain {
    /// Enters the domain as `node_name` and cleans up after dead processes. It ends within 5 s, in success or not. The
    /// first process that enters removes everything of killed processes. The last one that leaves leaves nothing in
    /// shared memory. Start child processes before, because descriptors opened here are not closed on exec.
    pub fn open(config: DomainConfig, node_name: &str) -> Result<Self, BusError> {
        let transport = transport_config(&config)?;
        let name = NodeName::new(node_name)
            .map_err(|error| BusError::NodeName { name: node_name.to_owned(), reason: format!("{error:?}") })?;
        shared_memory::check_room()?;
        create_root(&config)?;
        refuse_foreign(&config)?;
        set_log_level(iceoryx2::prelude::LogLevel::Error);
        let own = config.clone();
        let create = move || {
            let presence = Presence::enter(&own, &transport);
            let builder = NodeBuilder::new().name(&name).config(&transport);
            let node = builder.signal_handling_mode(SignalHandlingMode::Disabled).create::<Ipc>();
            node.map(|node| (node, presence))
        };
        match within(START_DEADLINE, create) {
            None => Err(BusError::Hangs {
                root: config.root,
                prefix: config.prefix,
                waited_ms: START_DEADLINE.as_millis() as u64,
            }),
            Some(Err(error)) => {
                Err(BusError::Node { root: config.root, prefix: config.prefix, cause: node_failure(error) })
            }
            Some(Ok((node, presence))) => {
                shared_memory::close_to_others(&config.prefix);
                Ok(Self { node: Box::new(node), config, presence: Arc::new(presence) })
            }
        }
    }

    /// Creates the writer of `service`. Fails while another process holds its place.
    pub fn writer<M: Carried>(&self, service: Service) -> Result<Writer<M>, BusError> {
        Ok(Writer::new(M::write_port(self, service)?))
    }

    /// Creates a reader of `service` that is polled.
    pub fn reader<M: Carried>(&self, service: Service) -> Result<Reader<M>, BusError> {
        let row = service.row();
        Ok(Reader::new(M::read_port(self, service)?, row.writers_max * row.kept))
    }

    /// Creates a reader of `service` that can wait for `Writer::notify`. It costs the writer a system call per wake-up.
    pub fn waking_reader<M: Carried>(&self, service: Service) -> Result<WakingReader<M>, BusError> {
        Ok(WakingReader::new(self.reader(service)?, self.wake_listener(service)?))
    }

    fn wake_listener(&self, service: Service) -> Result<Box<dyn WakeListener>, BusError> {
        let listener = self.event_service(service)?.listener_builder().create();
        let listener = listener.map_err(|error| self.service_error(service, format!("listener: {error:?}"), 1))?;
        Ok(Box::new(IpcWakeListener { listener, _presence: self.presence.clone() }))
    }

    #[doc(hidden)]
    pub fn make_write_port<M: Message>(&self, service: Service) -> Result<Box<dyn WritePort<M>>, BusError> {
        let (data, events) = (self.data_service::<M>(service)?, self.event_service(service)?);
        let row = service.row();
        let mut attempt = 1;
        let publisher = loop {
            let builder = data.publisher_builder().max_loaned_samples(2);
            match builder.backpressure_strategy(BackpressureStrategy::DiscardData).create() {
                Ok(publisher) => break publisher,
                Err(PublisherCreateError::ExceedsMaxSupportedPublishers) if attempt < WRITER_ATTEMPTS => {
                    self.node.node().blocking_cleanup_dead_nodes(CLEANING);
                    std::thread::sleep(PAUSE_FIRST * attempt);
                    attempt += 1;
                }
                Err(PublisherCreateError::ExceedsMaxSupportedPublishers) => {
                    return Err(BusError::WriterExists {
                        service: row.name,
                        root: self.config.root.clone(),
                        writer: row.writer,
                        writers_max: row.writers_max,
                    });
                }
                Err(error) => return Err(self.service_error(service, format!("writer: {error:?}"), attempt)),
            }
        };
        let notifier = events.notifier_builder().create();
        let notifier = notifier.map_err(|error| self.service_error(service, format!("wake-up: {error:?}"), 1))?;
        Ok(Box::new(IpcWriter::new(publisher, notifier, self.presence.clone())))
    }

    #[doc(hidden)]
    pub fn make_read_port<M: Message>(&self, service: Service) -> Result<Box<dyn ReadPort<M>>, BusError> {
        let data = self.data_service::<M>(service)?;
        match data.subscriber_builder().create() {
            Ok(subscriber) => Ok(Box::new(IpcReader { subscriber, _presence: self.presence.clone() })),
            Err(SubscriberCreateError::ExceedsMaxSupportedSubscribers) => Err(BusError::ReadersExhausted {
                service: service.row().name,
                root: self.config.root.clone(),
                readers_max: READERS_MAX,
            }),
            Err(error) => Err(self.service_error(service, format!("reader: {error:?}"), 1)),
        }
    }

    /// Returns the place of this domain.
    pub fn config(&self) -> &DomainConfig {
        &self.config
    }

    pub(crate) fn data_service<M: Message>(&self, service: Service) -> Result<DataService<M>, BusError> {
        let expected = format!("{:?}", service.namesake());
        if expected != M::NAME {
            return Err(BusError::WrongMessage { service: service.row().name, expected, offered: M::NAME });
        }
        let name = self.service_name(service, service.row().name)?;
        let open = || {
            let builder = self.node.node().service_builder(&name).publish_subscribe::<Payload<M>>();
            let readers = if service.row().kept > 1 { WAITING_READERS_MAX } else { READERS_MAX };
            let builder = builder.max_publishers(service.row().writers_max).max_subscribers(readers);
            let builder = builder.max_nodes(NODES_MAX).history_size(0).enable_safe_overflow(true);
            builder.subscriber_max_buffer_size(service.row().kept).subscriber_max_borrowed_samples(1).open_or_create()
        };
        self.retried(service, open, data_is_passing, |error| match error {
            OpenOrCreateError::PublishSubscribeOpenError(OpenError::IncompatibleTypes) => {
                Some(BusError::IncompatibleTypes {
                    service: service.row().name,
                    root: self.config.root.clone(),
                    ours: M::TYPE_NAME.as_str().to_owned(),
                })
            }
            _ => None,
        })
    }

    fn event_service(&self, service: Service) -> Result<EventService, BusError> {
        let name = self.service_name(service, &format!("{}/event", service.row().name))?;
        let open = || {
            let builder = self.node.node().service_builder(&name).event().event_id_max_value(0).disable_deadline();
            // The place of a dead notifier may be freed a moment after its publisher's place.
            let builder = builder.max_notifiers(2 * service.row().writers_max).max_listeners(READERS_MAX);
            builder.max_nodes(NODES_MAX).open_or_create()
        };
        self.retried(service, open, event_is_passing, |_| None)
    }

    fn service_name(&self, service: Service, name: &str) -> Result<ServiceName, BusError> {
        ServiceName::new(name).map_err(|error| self.service_error(service, format!("name: {error:?}"), 1))
    }

    /// Tries an operation again, with growing pauses, if it failed only because another process starts or ends at
    /// this moment.
    fn retried<T, E: std::fmt::Debug>(
        &self,
        service: Service,
        open: impl Fn() -> Result<T, E>,
        is_passing: impl Fn(&E) -> bool,
        special: impl Fn(&E) -> Option<BusError>,
    ) -> Result<T, BusError> {
        let mut pause = PAUSE_FIRST;
        let mut attempt = 1;
        loop {
            match open() {
                Ok(opened) => return Ok(opened),
                Err(error) if is_passing(&error) && attempt < ATTEMPTS => {
                    self.node.node().blocking_cleanup_dead_nodes(CLEANING);
                    std::thread::sleep(pause);
                    pause = (2 * pause).min(PAUSE_LONGEST);
                    attempt += 1;
                }
                Err(error) => {
                    return Err(
                        special(&error).unwrap_or_else(|| self.service_error(service, format!("{error:?}"), attempt))
                    );
                }
            }
        }
    }

    fn service_error(&self, service: Service, cause: String, attempts: u32) -> BusError {
        BusError::Service { service: service.row().name, root: self.config.root.clone(), cause, attempts }
    }
}

/// Runs `work` on a thread of its own. Returns `None` if it is not done in time. The thread is then left behind,
/// because it may wait for anything that another process did to the shared files.
fn within<T: Send + 'static>(limit: Duration, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    let (sender, receiver) = mpsc::channel();
    std::thread::Builder::new()
        .name(String::from("bus-open"))
        .spawn(move || {
            let _ = sender.send(work());
        })
        .ok()?;
    receiver.recv_timeout(limit).ok()
}

fn transport_config(config: &DomainConfig) -> Result<Config, BusError> {
    let root_error = |reason: String| BusError::Root { path: config.root.clone(), reason };
    let prefix_error = |reason: &str| BusError::Prefix { prefix: config.prefix.clone(), reason: reason.to_owned() };
    if config.prefix.is_empty() {
        return Err(prefix_error("empty; two instances would share one domain"));
    }
    if !config.prefix.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_' | b'-')) {
        return Err(prefix_error("only lower-case letters, digits, `_` and `-` are allowed"));
    }
    if !config.root.is_absolute() {
        return Err(root_error(String::from("not an absolute path")));
    }
    let mut transport = Config::default();
    let root = config.root.to_str().ok_or_else(|| root_error(String::from("not valid UTF-8")))?;
    let socket_name = 1 + config.prefix.len() + PORT_DIGITS + transport.global.service.event_connection_suffix.len();
    if root.len() + socket_name > SOCKET_PATH_MAX {
        let (length, limit) = (root.len(), SOCKET_PATH_MAX.saturating_sub(socket_name));
        return Err(root_error(format!("{length} bytes long; with this prefix {limit} are allowed")));
    }
    let path = Path::new(root.as_bytes()).map_err(|error| root_error(format!("{error:?}")))?;
    transport.global.set_root_path(&path);
    transport.global.prefix =
        FileName::new(config.prefix.as_bytes()).map_err(|error| prefix_error(&format!("{error:?}")))?;
    transport.global.node.cleanup_dead_nodes_on_creation = true;
    Ok(transport)
}

fn create_root(config: &DomainConfig) -> Result<(), BusError> {
    let created = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&config.root);
    created.map_err(|error| BusError::Root { path: config.root.clone(), reason: error.to_string() })
}

/// Refuses the domain of another user with a clear error: the transport's own error names no user. Root may enter
/// every domain.
fn refuse_foreign(config: &DomainConfig) -> Result<(), BusError> {
    let own = rustix::process::geteuid().as_raw();
    let owner = std::fs::metadata(&config.root).map_or(own, |found| found.uid());
    if own != 0 && owner != own {
        return Err(BusError::Foreign { root: config.root.clone(), owner, own });
    }
    Ok(())
}

fn node_failure(error: NodeCreationFailure) -> String {
    match error {
        NodeCreationFailure::InsufficientPermissions => String::from("insufficient permissions"),
        // The transport returns this error without a hint if the files belong to another user.
        NodeCreationFailure::InternalError => String::from("internal failure, most often missing permissions"),
        NodeCreationFailure::SystemCorrupted => String::from("its files were removed while they were in use"),
        NodeCreationFailure::UnableToGenerateUniqueNodeId => String::from("no node number could be generated"),
    }
}

fn data_is_passing(error: &OpenOrCreateError) -> bool {
    match error {
        OpenOrCreateError::SystemInFlux => true,
        OpenOrCreateError::PublishSubscribeOpenError(error) => matches!(
            error,
            OpenError::ServiceInCorruptedState
                | OpenError::IsMarkedForDestruction
                | OpenError::DoesNotExist
                | OpenError::Interrupt
                | OpenError::ExceedsMaxNumberOfNodes
        ),
        OpenOrCreateError::PublishSubscribeCreateError(error) => matches!(
            error,
            CreateError::ServiceInCorruptedState
                | CreateError::AlreadyExists
                | CreateError::IsBeingCreatedByAnotherInstance
                | CreateError::Interrupt
        ),
    }
}

fn event_is_passing(error: &EventOpenOrCreateError) -> bool {
    match error {
        EventOpenOrCreateError::SystemInFlux => true,
        EventOpenOrCreateError::EventOpenError(error) => matches!(
            error,
            EventOpenError::ServiceInCorruptedState
                | EventOpenError::IsMarkedForDestruction
                | EventOpenError::DoesNotExist
                | EventOpenError::Interrupt
                | EventOpenError::ExceedsMaxNumberOfNodes
        ),
        EventOpenOrCreateError::EventCreateError(error) => matches!(
            error,
            EventCreateError::ServiceInCorruptedState
                | EventCreateError::AlreadyExists
                | EventCreateError::IsBeingCreatedByAnotherInstance
                | EventCreateError::Interrupt
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(root: &str, prefix: &str) -> String {
        let config = DomainConfig { root: root.into(), prefix: prefix.to_owned() };
        let checked = config.check().err().map(|error| error.to_string());
        let refused = Domain::open(config, "test").expect_err("it must be refused").to_string();
        // Some errors show only when the domain is opened, not in the path itself.
        assert!(checked.is_none_or(|checked| checked == refused), "{refused}");
        refused
    }

    #[test]
    fn domain_with_invalid_root_or_prefix_is_refused() {
        assert!(refused("relative", "p_").contains("bus root path \"relative\": not an absolute path"));
        assert!(refused("/tmp/x", "").contains("bus prefix \"\": empty"));
        assert!(refused("/tmp/x", "a/b").contains("bus prefix \"a/b\": only lower-case"));
        let long = format!("/tmp/{}", "x".repeat(100));
        let text = refused(&long, "p_");
        assert!(text.contains("105 bytes long") && text.contains("are allowed"), "{text}");
        assert!(!std::path::Path::new(&long).exists());
        assert!(DomainConfig { root: "relative".into(), prefix: "p_".into() }.check().is_err());
        assert!(refused("/proc/nowhere", "p_").contains("bus root path \"/proc/nowhere\": "));
    }

    #[test]
    fn call_that_hangs_is_abandoned_after_its_timeout() {
        assert_eq!(within(Duration::from_secs(60), || 7), Some(7));
        let (_keep, never) = mpsc::channel::<()>();
        assert_eq!(within(Duration::from_millis(20), move || never.recv().is_ok()), None);
    }
}
