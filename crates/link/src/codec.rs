//! Datagrams as bytes: fixed fields in their order, little-endian.

use crate::{Refusal, Unsendable};
use messages::{
    Feedback, HOLDS_CLUTCH, HOLDS_ENABLE, HOLDS_RECOVERY, Header, HingeCalibration, LEAVES_OUT, Layout, Message,
    OPERATOR_VERSION, OperatorRequest, RAW_JOINTS_MAX, RawSkeleton, Stamp, Status, raw_flag,
};

/// First 32-bit field of every datagram: "TPLK" in memory order.
const MAGIC: u32 = u32::from_le_bytes(*b"TPLK");
/// Version of this protocol.
pub const PROTOCOL: u32 = 1;

/// Length of the head.
pub const HEAD_BYTES: usize = 72;
/// Length of a person without joints and without hinges.
pub const PERSON_BYTES: usize = 56;
/// Length of an answer.
pub const ANSWER_BYTES: usize = 40;
const CALIBRATION_BYTES: usize = size_of::<HingeCalibration>();
/// Length of a position and a confidence, and of a rotation.
const POINT_BYTES: usize = 16;
const ROTATION_BYTES: usize = 16;
/// Length of the longest datagram: 96 joints with rotations and hinges. 28 joints with rotations and hinges fit into 1,080
/// bytes, and so into one datagram of any network that carries QUIC. A longer one travels in two or three. If one of them is
/// lost, so is the frame.
pub const FRAME_BYTES_MAX: usize =
    HEAD_BYTES + PERSON_BYTES + CALIBRATION_BYTES + RAW_JOINTS_MAX * (POINT_BYTES + ROTATION_BYTES);

/// Bit of a person's `extras`: the hinges follow.
const HAS_CALIBRATION: u32 = 1;
/// The bits that a person's flags may have.
const RAW_FLAGS: u32 =
    raw_flag::MIRRORED | raw_flag::ROTATIONS | raw_flag::LOCAL | raw_flag::CLUTCH | raw_flag::CLOSURE;

messages::named! {
    /// Kind of a datagram.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u32)]
    pub enum Kind {
        /// Up: an `OperatorRequest`. With the session number zero it asks for a session.
        Operator = 1 => "operator",
        /// Up: a person.
        Person = 2 => "person",
        /// Down: an `Answer`.
        Answer = 3 => "answer",
        /// Down: a `Status`.
        Status = 4 => "status",
        /// Down: a `Feedback`.
        Feedback = 5 => "feedback",
    }
}

messages::named! {
    /// State of an operator's connection, as the robot's end sees it.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(u32)]
    pub enum Verdict {
        /// There is a session, and it may engage.
        Ready = 1 => "ready",
        /// There is a session, but the clocks are not synchronised. It engages nothing.
        Unsynchronised = 2 => "synchronising the clocks",
        /// There is a session, but the clocks are too uncertain. It engages nothing.
        Uncertain = 3 => "clocks too uncertain to engage",
        /// There is no session.
        NoSession = 4 => "no session",
        /// Another program of this operator has the session.
        Busy = 5 => "another program of this operator has the session",
        /// There is nothing to operate.
        NoDaemon = 6 => "teleopd does not run at the robot",
    }
}

/// The newest datagram of the other end, for the exchange of clocks. Zero if there is none yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Echo {
    /// Its number.
    pub sequence: u64,
    /// Its `sent`.
    pub sent: Stamp,
    /// Time at which it arrived, on the clock of this sender.
    pub received: Stamp,
}

/// Beginning of every datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Its kind.
    pub kind: Kind,
    /// Number of the session, drawn by the robot's end. Zero without a session.
    pub session: u64,
    /// Number of the operator's end, drawn at its start. It is never zero.
    pub client: u64,
    /// Emergency stops of the operator's end that the robot's end has heard. The operator's end sends it back.
    pub stops_heard: u32,
    /// Counts the datagrams of this sender from 1.
    pub sequence: u64,
    /// Time of sending, on the sender's CLOCK_MONOTONIC.
    pub sent: Stamp,
    /// The newest datagram of the other end.
    pub echo: Echo,
}

/// The robot's end to the operator's: state of the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// State.
    pub verdict: Verdict,
    /// Another client holds the lease of `ingest`. The robot does not see this operator's person.
    pub led_by_other: bool,
    /// Uncertainty of the clocks, ns. The largest number while they are not synchronised.
    pub uncertainty_ns: u64,
    /// Datagrams of this operator's end that arrived.
    pub received: u64,
    /// Datagrams that did not arrive.
    pub lost: u64,
    /// Datagrams of this operator that were refused.
    pub refused: u64,
}

/// Content of a datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "no allocation in a tick")]
pub enum Payload {
    /// See [`Kind::Operator`].
    Operator(OperatorRequest),
    /// See [`Kind::Person`].
    Person(RawSkeleton),
    /// See [`Kind::Answer`].
    Answer(Answer),
    /// See [`Kind::Status`].
    Status(Status),
    /// See [`Kind::Feedback`].
    Feedback(Feedback),
}

/// A datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its head. The kind is that of the payload.
    pub head: Head,
    /// Its payload.
    pub payload: Payload,
}

fn tail(bytes: &[u8], from: usize) -> &[u8] {
    bytes.get(from..).unwrap_or_default()
}

fn tail_mut(bytes: &mut [u8], from: usize) -> &mut [u8] {
    bytes.get_mut(from..).unwrap_or_default()
}

impl Head {
    fn write_to(&self, out: &mut [u8]) {
        [MAGIC, PROTOCOL, self.kind as u32, self.stops_heard].write_to(out);
        let Echo { sequence, sent, received } = self.echo;
        [self.session, self.client, self.sequence, self.sent.0, sequence, sent.0, received.0]
            .write_to(tail_mut(out, 16));
    }

    /// Returns the head of a datagram, before its payload is looked at.
    ///
    /// # Errors
    /// Returns the reason why these bytes are no datagram.
    pub fn get(bytes: &[u8]) -> Result<Self, Refusal> {
        if bytes.len() < HEAD_BYTES || bytes.len() > FRAME_BYTES_MAX {
            return Err(Refusal::Length);
        }
        let [magic, protocol, kind, stops_heard] = <[u32; 4]>::get(bytes);
        let [session, client, sequence, sent, echo, echo_sent, received] = <[u64; 7]>::get(tail(bytes, 16));
        if magic != MAGIC {
            return Err(Refusal::Magic);
        }
        if protocol != PROTOCOL {
            return Err(Refusal::Version);
        }
        let kind = Kind::ALL.into_iter().find(|known| *known as u32 == kind).ok_or(Refusal::Kind)?;
        if client == 0 || sequence == 0 {
            return Err(Refusal::Value);
        }
        let echo = Echo { sequence: echo, sent: Stamp(echo_sent), received: Stamp(received) };
        Ok(Self { kind, session, client, stops_heard, sequence, sent: Stamp(sent), echo })
    }
}

impl Payload {
    /// Returns the kind of the datagram that carries it.
    pub fn kind(&self) -> Kind {
        match self {
            Self::Operator(_) => Kind::Operator,
            Self::Person(_) => Kind::Person,
            Self::Answer(_) => Kind::Answer,
            Self::Status(_) => Kind::Status,
            Self::Feedback(_) => Kind::Feedback,
        }
    }
}

impl Frame {
    /// Writes the datagram and returns its length.
    ///
    /// # Errors
    /// Returns the reason why a person cannot be sent.
    pub fn encode(&self, out: &mut [u8; FRAME_BYTES_MAX]) -> Result<usize, Unsendable> {
        Head { kind: self.payload.kind(), ..self.head }.write_to(out);
        let body = tail_mut(out, HEAD_BYTES);
        let length = match &self.payload {
            Payload::Operator(request) => put_whole(request, body),
            Payload::Person(person) => put_person(person, body)?,
            Payload::Answer(answer) => {
                [answer.verdict as u32, u32::from(answer.led_by_other)].write_to(body);
                [answer.uncertainty_ns, answer.received, answer.lost, answer.refused].write_to(tail_mut(body, 8));
                ANSWER_BYTES
            }
            Payload::Status(status) => put_whole(status, body),
            Payload::Feedback(feedback) => put_whole(feedback, body),
        };
        Ok(HEAD_BYTES + length)
    }

    /// Returns the datagram in `bytes`. Whether the numbers of a person are finite and plausible is judged by `ingest`.
    ///
    /// # Errors
    /// Returns the reason why these bytes are no datagram.
    pub fn get(bytes: &[u8]) -> Result<Self, Refusal> {
        let head = Head::get(bytes)?;
        let body = tail(bytes, HEAD_BYTES);
        let payload = match head.kind {
            Kind::Operator => Payload::Operator(get_request(body)?),
            Kind::Person => Payload::Person(get_person(body)?),
            Kind::Answer => Payload::Answer(get_answer(body)?),
            Kind::Status => Payload::Status(Status::from_le_bytes(body).ok_or(Refusal::Length)?),
            Kind::Feedback => Payload::Feedback(Feedback::from_le_bytes(body).ok_or(Refusal::Length)?),
        };
        Ok(Self { head, payload })
    }
}

fn put_whole<T: Layout>(value: &T, out: &mut [u8]) -> usize {
    value.write_to(out);
    size_of::<T>()
}

fn get_request(body: &[u8]) -> Result<OperatorRequest, Refusal> {
    let request = OperatorRequest::from_le_bytes(body).ok_or(Refusal::Length)?;
    let [left, right] = LEAVES_OUT;
    let level = request.enable_level & !HOLDS_CLUTCH;
    let known = level <= HOLDS_RECOVERY || level == HOLDS_ENABLE | left || level == HOLDS_ENABLE | right;
    if request.version == OPERATOR_VERSION && known { Ok(request) } else { Err(Refusal::Value) }
}

fn get_answer(body: &[u8]) -> Result<Answer, Refusal> {
    if body.len() != ANSWER_BYTES {
        return Err(Refusal::Length);
    }
    let [verdict, led_by_other] = <[u32; 2]>::get(body);
    let [uncertainty_ns, received, lost, refused] = <[u64; 4]>::get(tail(body, 8));
    let verdict = Verdict::ALL.into_iter().find(|known| *known as u32 == verdict).ok_or(Refusal::Value)?;
    if led_by_other > 1 {
        return Err(Refusal::Value);
    }
    Ok(Answer { verdict, led_by_other: led_by_other == 1, uncertainty_ns, received, lost, refused })
}

/// Returns the length of a person with `joints` joints.
pub const fn person_bytes(joints: usize, flags: u32, has_calibration: bool) -> usize {
    let rotation = if flags & raw_flag::ROTATIONS != 0 { ROTATION_BYTES } else { 0 };
    let hinges = if has_calibration { CALIBRATION_BYTES } else { 0 };
    PERSON_BYTES + hinges + joints * (POINT_BYTES + rotation)
}

/// Writes a person: 56 bytes, its hinges if there are any, and its joints. Not sent is what a client's frame has to leave
/// zero, and what a flag says is not filled.
fn put_person(person: &RawSkeleton, out: &mut [u8]) -> Result<usize, Unsendable> {
    let joints = person.joint_count as usize;
    if joints > RAW_JOINTS_MAX {
        return Err(Unsendable::Joints(person.joint_count));
    }
    if person.flags & !RAW_FLAGS != 0 {
        return Err(Unsendable::Flags(person.flags));
    }
    let header = &person.header;
    let has_calibration = person.calibration != HingeCalibration::ZERO;
    let extras = if has_calibration { HAS_CALIBRATION } else { 0 };
    [header.sequence, header.stamp.0, header.origin.0, person.session_nonce].write_to(out);
    [person.layout, person.operator_id, person.flags, person.joint_count, header.incarnation, extras]
        .write_to(tail_mut(out, 32));
    let mut at = PERSON_BYTES;
    if has_calibration {
        person.calibration.write_to(tail_mut(out, at));
        at += CALIBRATION_BYTES;
    }
    let joint = person.positions.iter().zip(&person.rotations).zip(&person.confidence);
    for ((position, rotation), confidence) in joint.take(joints) {
        let [x, y, z] = *position;
        [x, y, z, *confidence].write_to(tail_mut(out, at));
        at += POINT_BYTES;
        if person.flags & raw_flag::ROTATIONS != 0 {
            rotation.write_to(tail_mut(out, at));
            at += ROTATION_BYTES;
        }
    }
    Ok(at)
}

fn get_person(body: &[u8]) -> Result<RawSkeleton, Refusal> {
    if body.len() < PERSON_BYTES {
        return Err(Refusal::Length);
    }
    let [sequence, stamp, origin, session_nonce] = <[u64; 4]>::get(body);
    let [layout, operator_id, flags, joint_count, incarnation, extras] = <[u32; 6]>::get(tail(body, 32));
    let joints = joint_count as usize;
    if joints > RAW_JOINTS_MAX || flags & !RAW_FLAGS != 0 || extras & !HAS_CALIBRATION != 0 {
        return Err(Refusal::Value);
    }
    let has_calibration = extras & HAS_CALIBRATION != 0;
    if body.len() != person_bytes(joints, flags, has_calibration) {
        return Err(Refusal::Length);
    }
    let header = Header { sequence, stamp: Stamp(stamp), origin: Stamp(origin), incarnation, ..Header::ZERO };
    let mut person =
        RawSkeleton { header, session_nonce, layout, operator_id, flags, joint_count, ..RawSkeleton::ZERO };
    let mut at = PERSON_BYTES;
    if has_calibration {
        person.calibration = HingeCalibration::get(tail(body, at));
        if person.calibration == HingeCalibration::ZERO {
            return Err(Refusal::Value);
        }
        at += CALIBRATION_BYTES;
    }
    let joint = person.positions.iter_mut().zip(&mut person.rotations).zip(&mut person.confidence);
    for ((position, rotation), confidence) in joint.take(joints) {
        let [x, y, z, sure] = <[f32; 4]>::get(tail(body, at));
        (*position, *confidence) = ([x, y, z], sure);
        at += POINT_BYTES;
        if flags & raw_flag::ROTATIONS != 0 {
            *rotation = Layout::get(tail(body, at));
            at += ROTATION_BYTES;
        }
    }
    Ok(person)
}
