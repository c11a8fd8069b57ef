//! The packets on the skeleton socket besides the frames themselves.

use messages::{Feedback, Layout, Message, RATE_MAX_HZ, RawSkeleton};

/// First 32-bit field of every hello and reply: "TPSK" in memory order.
const MAGIC: u32 = u32::from_le_bytes(*b"TPSK");
/// Version of this protocol.
const PROTOCOL: u32 = 1;

/// Length of a hello.
pub const HELLO_BYTES: usize = 32;
/// Length of a reply.
pub const ANSWER_BYTES: usize = 24;

/// Length of a packet of feedback.
pub const FEEDBACK_BYTES: usize = size_of::<Feedback>();

/// A client's first packet: the layout of the frames that it is going to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hello {
    /// `MAGIC`.
    pub magic: u32,
    /// `PROTOCOL`.
    pub protocol: u32,
    /// Version of `RawSkeleton`.
    pub version: u32,
    /// Length of a frame.
    pub bytes: u32,
    /// Hash over names, types, offsets and sizes of the fields of `RawSkeleton`.
    pub layout: u64,
    /// Zero, or [`REQUESTS_FEEDBACK`].
    pub requests: u64,
}

/// The client requests a packet with each `Feedback`.
pub const REQUESTS_FEEDBACK: u64 = 1;

impl Hello {
    /// The hello of this build.
    pub const OURS: Self = Self {
        magic: MAGIC,
        protocol: PROTOCOL,
        version: RawSkeleton::VERSION,
        bytes: size_of::<RawSkeleton>() as u32,
        layout: RawSkeleton::HASH,
        requests: 0,
    };

    /// Returns its bytes: the fields in their order, little-endian.
    pub fn encode(self) -> [u8; HELLO_BYTES] {
        let mut bytes = [0; HELLO_BYTES];
        [self.magic, self.protocol, self.version, self.bytes].write_to(&mut bytes);
        [self.layout, self.requests].write_to(&mut bytes[16..]);
        bytes
    }

    /// Returns the reason for refusing a client whose first packet is `bytes`, or `None` if it is valid.
    pub fn refusal(bytes: &[u8]) -> Option<Reply> {
        if bytes.len() != HELLO_BYTES || u32::get(bytes) != MAGIC {
            Some(Reply::NoHello)
        } else {
            let known = [0, REQUESTS_FEEDBACK].map(|requests| Self { requests, ..Self::OURS }.encode());
            (!known.iter().any(|known| bytes == known)).then_some(Reply::OtherLayout)
        }
    }

    /// Returns true if the client of this valid hello requests feedback.
    pub(crate) fn requests_feedback(bytes: &[u8]) -> bool {
        bytes == Self { requests: REQUESTS_FEEDBACK, ..Self::OURS }.encode()
    }
}

messages::named! {
    /// A reply of the daemon.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u32)]
    pub enum Reply {
        /// The reply carries the session number. No session holds the lease at the moment.
        Granted = 1 => "granted": "frames are accepted",
        GrantedButHeld = 2 => "granted_but_held": "frames are accepted, but another client holds the lease",
        Holder = 3 => "holder": "this client holds the lease",
        /// This client's frames are ignored.
        NotHolder = 4 => "not_holder":
            "another client holds the lease, or held it when this session began; connect again after it has left",
        OverQuota = 5 => "over_quota": "more than 250 frames a second; only the newest are used",
        Full = 16 => "full": "all connections are in use",
        Forbidden = 17 => "forbidden":
            "not allowed; only the daemon's user and members of the socket's group may connect",
        NoHello = 18 => "no_hello": "the first packet is not a hello of this protocol",
        Late = 19 => "late": "no hello arrived within 1 s",
        OtherLayout = 20 => "other_layout": "the frame's layout differs: client and daemon have different versions",
        WrongSize = 21 => "wrong_size": "a packet does not have a frame's length",
        ForgedSession = 22 => "forged_session": "a frame has a session number that this connection was not given",
        Idle = 23 => "idle": "this connection was idle for long, and another client needed it",
    }
}

impl Reply {
    /// Returns true if the connection ends with this reply.
    pub fn is_refusal(self) -> bool {
        self as u32 >= Self::Full as u32
    }
}

/// A reply packet of the daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyPacket {
    /// The reply.
    pub word: Reply,
    /// The session number that every frame of this connection must carry. It is 0 in a refusal.
    pub session_nonce: u64,
    /// Frames per second that the daemon uses.
    pub rate_max_hz: u32,
}

impl ReplyPacket {
    /// Creates the packet with `word` for the session `session_nonce`.
    pub fn new(word: Reply, session_nonce: u64) -> Self {
        Self { word, session_nonce, rate_max_hz: RATE_MAX_HZ as u32 }
    }

    /// Returns its bytes: the fields in their order, little-endian.
    pub fn encode(self) -> [u8; ANSWER_BYTES] {
        let mut bytes = [0; ANSWER_BYTES];
        [MAGIC, self.word as u32, self.rate_max_hz, 0].write_to(&mut bytes);
        self.session_nonce.write_to(&mut bytes[16..]);
        bytes
    }

    /// Returns the reply in `bytes`, or `None` if they are not a reply.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        if bytes.len() != ANSWER_BYTES {
            return None;
        }
        let [magic, word, rate_max_hz, _] = <[u32; 4]>::get(bytes);
        let word = Reply::ALL.into_iter().find(|known| *known as u32 == word)?;
        (magic == MAGIC).then_some(Self { word, session_nonce: u64::get(&bytes[16..]), rate_max_hz })
    }
}
