//! The session of zenoh: its settings, what each end may put, and a slot for the newest datagram of each key.

use super::keys::{Keys, Name};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use rt::{Exit, Failure, Shutdown};
use rustix::event::{EventfdFlags, eventfd};
use serde_json::{Value, json};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::{Arc, Mutex, PoisonError};
use zenoh::Wait;

/// Silence after which a connection is given up, ms. The sessions of `link` end sooner. A wire that loses half of its datagrams
/// is silent for a second and more, and a new connection takes ten there: QUIC doubles its wait with each loss.
const LEASE_MS: u32 = 5000;
/// Longest message that is put together from fragments, bytes: many times the longest frame.
const MESSAGE_BYTES_MAX: u32 = 65_536;
/// Time after which the program looks for a signal while it connects, ms.
const CONNECT_MS: u32 = 1000;
/// Time between two attempts to connect, ms.
const RETRY_MS: [u32; 2] = [200, 1000];

/// Returns a key on the wire: `teleop/ROBOT/WHAT/NAME`.
pub fn key(robot: &Name, what: &str, name: &Name) -> String {
    format!("teleop/{robot}/{what}/{name}")
}

pub(super) fn status_key(robot: &Name) -> String {
    format!("teleop/{robot}/status")
}

/// Returns the settings of zenoh. Without certificates nothing listens or connects, and nothing is discovered.
pub fn config(keys: &Keys, listen: &[String], connect: &[String]) -> Value {
    let pem = |text: &str| STANDARD.encode(text);
    // One connection carries both: declarations on a stream, and datagrams as such.
    let mixed = |all: &[String], mixed: &str| -> Vec<String> {
        all.iter().map(|endpoint| format!("{endpoint}?mixed_rel={mixed}")).collect()
    };
    json!({
        // A router passes nothing on between peers.
        "mode": if listen.is_empty() { "client" } else { "peer" },
        "listen": { "endpoints": mixed(listen, "auto") },
        "connect": {
            "endpoints": mixed(connect, "1"),
            "timeout_ms": if listen.is_empty() { CONNECT_MS } else { 0 }, "exit_on_failure": listen.is_empty(),
            "retry": { "period_init_ms": RETRY_MS[0], "period_max_ms": RETRY_MS[1], "period_increase_factor": 2 },
        },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        "transport": { "link": {
            "protocols": ["quic"],
            "tx": { "lease": LEASE_MS, "keep_alive": 4 },
            "rx": { "max_message_size": MESSAGE_BYTES_MAX },
            "tls": {
                "enable_mtls": true,
                "root_ca_certificate_base64": pem(&keys.authority),
                "listen_certificate_base64": pem(&keys.certificate),
                "listen_private_key_base64": pem(&keys.key),
                "connect_certificate_base64": pem(&keys.certificate),
                "connect_private_key_base64": pem(&keys.key),
                // The authority belongs to one robot. Only it and its router have a certificate for a server. zenoh trusts
                // public authorities too. They certify no name of `pair`, and `access` requires one.
                "verify_name_on_connect": false,
            },
        } },
        "qos": { "publication": [{
            "key_exprs": ["teleop/**"],
            "config": {
                "reliability": "best_effort", "congestion_control": "drop", "priority": "real_time", "express": true,
            },
        }] },
        "access_control": access(keys, false),
    })
}

pub fn router_config(keys: &Keys, listen: &[String]) -> Value {
    let mut settings = config(keys, listen, &[]);
    settings["mode"] = json!("router");
    settings["access_control"] = access(keys, true);
    settings
}

/// Returns who may do what, by the common name of the certificate at the other end. Nobody may do anything else.
fn access(keys: &Keys, is_router: bool) -> Value {
    let (robot, status) = (&keys.robot, status_key(&keys.robot));
    let rule = |id: &str, messages: &[&str], flow: &str, key_exprs: &[String]| {
        let flows = [flow];
        json!({ "id": id, "messages": messages, "flows": flows, "permission": "allow", "key_exprs": key_exprs })
    };
    let (mut rules, mut subjects, mut policies) = (Vec::new(), Vec::new(), Vec::new());
    let mut admit = |subject: Value, of_subject: Vec<Value>| {
        let ids: Vec<_> = of_subject.iter().map(|rule| rule["id"].clone()).collect();
        policies.push(json!({ "rules": ids, "subjects": [subject["id"]] }));
        subjects.push(subject);
        rules.extend(of_subject);
    };
    if let Some(own) = &keys.operator {
        // The other end is the robot, or a router.
        let up = [key(robot, "person", own), key(robot, "operator", own), key(robot, "stop", own)];
        let down = [key(robot, "answer", own), key(robot, "stopped", own), status.clone()];
        let of_robot = vec![
            rule("put-up", &["put"], "egress", &up),
            rule("want-up", &["declare_subscriber"], "ingress", &up),
            rule("put-down", &["put"], "ingress", &down),
            rule("want-down", &["declare_subscriber"], "egress", &down),
        ];
        // Nobody else with a certificate of this authority may stand in for it.
        let names: Vec<_> = [Some(robot.as_str()), keys.router.as_deref()].into_iter().flatten().collect();
        admit(json!({ "id": "robot", "cert_common_names": names }), of_robot);
    }
    for (name, common_name) in &keys.operators {
        let up = [key(robot, "person", name), key(robot, "operator", name), key(robot, "stop", name)];
        let answer = [key(robot, "answer", name), key(robot, "stopped", name)];
        let of_operator = vec![
            rule(&format!("operator-{name}-put-up"), &["put"], "ingress", &up),
            rule(&format!("operator-{name}-want-up"), &["declare_subscriber"], "egress", &up),
            rule(&format!("operator-{name}-put-down"), &["put"], "egress", &answer),
            rule(&format!("operator-{name}-want-down"), &["declare_subscriber"], "ingress", &answer),
        ];
        let id = format!("operator-{name}");
        // What comes by a router was admitted there.
        let names: Vec<_> = [Some(common_name), keys.router.as_ref()].into_iter().flatten().collect();
        admit(json!({ "id": id, "cert_common_names": names }), of_operator);
    }
    if is_router {
        let all = |what: &str| keys.operators.iter().map(|(name, _)| key(robot, what, name)).collect::<Vec<_>>();
        let up = [all("person"), all("operator"), all("stop")].concat();
        let down = [all("answer"), all("stopped"), vec![status.clone()]].concat();
        let of_robot = vec![
            rule("robot-put-down", &["put"], "ingress", &down),
            rule("robot-want-down", &["declare_subscriber"], "egress", &down),
            rule("robot-put-up", &["put"], "egress", &up),
            rule("robot-want-up", &["declare_subscriber"], "ingress", &up),
        ];
        admit(json!({ "id": "robot", "cert_common_names": [robot.as_str()] }), of_robot);
    }
    let readers: Vec<_> = keys.operators.iter().map(|(_, name)| name).chain(&keys.router).collect();
    if keys.operator.is_none() && !readers.is_empty() {
        let of_status = vec![
            rule("put-status", &["put"], "egress", std::slice::from_ref(&status)),
            rule("want-status", &["declare_subscriber"], "ingress", std::slice::from_ref(&status)),
        ];
        admit(json!({ "id": "readers", "cert_common_names": readers }), of_status);
    }
    json!({
        "enabled": true, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// Kinds of datagrams that have a place of their own before they are decoded.
pub(super) const KINDS: usize = 8;
/// Place of a datagram's kind: the third number.
const KIND_AT: usize = 8;

/// The newest datagram of each kind of a key. There is no queue: a newer one replaces it.
#[derive(Debug, Default)]
pub struct Slot(Mutex<[Option<Vec<u8>>; KINDS]>);

impl Slot {
    /// Takes a datagram that arrived since the last calls.
    pub fn take(&self) -> Option<Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter_mut().find_map(Option::take)
    }

    fn store(&self, bytes: Vec<u8>) {
        let place = kind(&bytes) % KINDS;
        self.0.lock().unwrap_or_else(PoisonError::into_inner)[place] = Some(bytes);
    }
}

/// Returns the number of a datagram's kind, before it is decoded.
pub(super) fn kind(bytes: &[u8]) -> usize {
    bytes.get(KIND_AT).copied().unwrap_or_default().into()
}

/// A session, and the event that wakes the loop when a datagram arrives.
pub struct Wire {
    session: zenoh::Session,
    event: Arc<OwnedFd>,
}

/// A key on which this end puts.
pub type Publisher = zenoh::pubsub::Publisher<'static>;

impl Wire {
    /// Opens a session. Where the other end does not answer, it tries again and again, and calls `waits` each time. `None`
    /// after a signal.
    pub fn open(settings: &Value, shutdown: &Shutdown, mut waits: impl FnMut()) -> Result<Option<Self>, Failure> {
        let event = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).map_err(Failure::with(Exit::OsErr))?;
        while !shutdown.requested() {
            let config = zenoh::Config::from_json5(&settings.to_string()).map_err(Failure::with(Exit::Usage))?;
            // The texts of zenoh name its own sources.
            match zenoh::open(config).wait().map_err(|error| error.to_string()) {
                Ok(session) => return Ok(Some(Self { session, event: Arc::new(event) })),
                Err(text) if text.contains("Unable to connect") => waits(),
                Err(text) if text.contains("Address already in use") => {
                    let text = format!("{}: another program listens there", settings["listen"]["endpoints"]);
                    return Err(Failure::new(Exit::Unavailable, text));
                }
                Err(text) => return Err(Failure::new(Exit::Unavailable, text)),
            }
        }
        Ok(None)
    }

    /// Keeps the newest datagram of `key` in the slot that is returned, unless `takes` has taken it at once, in the thread of
    /// zenoh. `takes` may not wait, and may not put.
    pub fn receive(
        &self,
        key: String,
        takes: impl Fn(&[u8]) -> bool + Send + Sync + 'static,
    ) -> Result<Arc<Slot>, Failure> {
        let slot = Arc::new(Slot::default());
        let (callback_slot, event) = (Arc::clone(&slot), Arc::clone(&self.event));
        let take = move |sample: zenoh::sample::Sample| {
            let bytes = sample.payload().to_bytes();
            // One byte more than a datagram, so that a longer one is counted as such.
            let bytes = &bytes[..bytes.len().min(link::FRAME_BYTES_MAX + 1)];
            if !takes(bytes) {
                callback_slot.store(bytes.to_vec());
                let _ = rustix::io::write(&*event, &1_u64.to_ne_bytes());
            }
        };
        self.session
            .declare_subscriber(key)
            .callback(take)
            .background()
            .wait()
            .map_err(Failure::with(Exit::Software))?;
        Ok(slot)
    }

    pub fn publisher(&self, key: String) -> Result<Publisher, Failure> {
        self.session.declare_publisher(key).wait().map_err(Failure::with(Exit::Software))
    }

    /// The event: readable after a datagram, until [`Wire::calm`].
    pub(super) fn event(&self) -> BorrowedFd<'_> {
        self.event.as_fd()
    }

    /// Makes the event wait for the next datagram.
    pub(super) fn calm(&self) {
        let _ = rustix::io::read(&*self.event, &mut [0_u8; 8]);
    }
}

/// Sends a datagram. One that cannot be sent at once is lost.
pub fn send(publisher: &Publisher, bytes: &[u8]) {
    let _ = publisher.put(bytes).wait();
}
