//! Topics, readers and writers of DDS.

use crate::ros::{ControllerState, Float64MultiArray, JointTrajectory, RosType, topic};
use crate::unitree::{LowCmd, MotorCmd};
use crate::wire::LossTolerantUdp;
use config::Ros2Settings;
use dust_dds::configuration::DustDdsConfigurationBuilder;
use dust_dds::dds_async::domain_participant_factory::DomainParticipantFactoryAsync;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{DataReaderQos, DataWriterQos, QosKind};
use dust_dds::infrastructure::qos_policy::{
    DeadlineQosPolicy, DurabilityQosPolicy, DurabilityQosPolicyKind, HistoryQosPolicy, HistoryQosPolicyKind,
    LivelinessQosPolicy, LivelinessQosPolicyKind, ReliabilityQosPolicy, ReliabilityQosPolicyKind,
};
use dust_dds::infrastructure::sample_info::{ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::infrastructure::time::{Duration, DurationKind};
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::publisher::Publisher;
use dust_dds::rtps_udp_transport::udp_transport::RtpsUdpTransportParticipantFactory;
use dust_dds::std_runtime::StdRuntime;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber;
use dust_dds::xtypes::type_support::TypeSupport;
use messages::Stamp;
use robot::{Model, SetpointKind};
use std::fmt;

/// Period of this participant's announcements. A robot that starts later discovers it within this time.
const ANNOUNCE: std::time::Duration = std::time::Duration::from_millis(500);
/// Size of the socket's receive buffer, bytes. A large /robot_description arrives in one burst, and dust_dds fails to request
/// lost parts of it. Linux grants at most net.core.rmem_max.
const RECEIVED_BYTES: usize = 4 << 20;
/// Largest number of messages taken at once.
pub(crate) const TAKEN_MAX: i32 = 16;

#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    Trajectory(JointTrajectory),
    /// For a controller that takes positions.
    Positions(Float64MultiArray),
    ArmSdk(Box<LowCmd>),
}

/// One line for each point or motor, in the message's own units.
impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Trajectory(JointTrajectory { header, joint_names, points }) => {
                writeln!(
                    f,
                    "  stamp {}.{:09} s, joints {}",
                    header.stamp.sec,
                    header.stamp.nanosec,
                    joint_names.join(" ")
                )?;
                points.iter().try_for_each(|point| {
                    let time_s = point.time_from_start.ns() as f64 * 1e-9;
                    writeln!(f, "  {time_s:.4} s: at {:.4?}, speed {:.4?}", point.positions, point.velocities)
                })
            }
            Self::Positions(positions) => writeln!(f, "  {:.4?}", positions.data),
            Self::ArmSdk(low) => {
                low.motor_cmd.iter().enumerate().filter(|(_, motor)| motor.kp > 0.0 || motor.q != 0.0).try_for_each(
                    |(number, motor)| {
                        let MotorCmd { q, dq, tau, kp, kd, .. } = motor;
                        writeln!(f, "  motor {number}: q {q:.4}, dq {dq:.4}, tau {tau:.4}, kp {kp}, kd {kd}")
                    },
                )
            }
        }
    }
}

pub(crate) enum Writer {
    Trajectory(DataWriter<JointTrajectory>),
    Positions(DataWriter<Float64MultiArray>),
    ArmSdk(DataWriter<LowCmd>),
}

impl Writer {
    /// Sends a message of this writer's kind. An error counts as a lost message, which the robot's reference shows.
    pub(crate) fn write(&self, message: Message) {
        let _ = match (self, message) {
            (Self::Trajectory(writer), Message::Trajectory(message)) => writer.write(message, None),
            (Self::Positions(writer), Message::Positions(message)) => writer.write(message, None),
            (Self::ArmSdk(writer), Message::ArmSdk(message)) => writer.write(*message, None),
            _ => Ok(()),
        };
    }

    /// Returns the instance handle, which identifies this writer among all publishers.
    pub(crate) fn key(&self) -> [u8; 16] {
        match self {
            Self::Trajectory(writer) => writer.get_instance_handle().into(),
            Self::Positions(writer) => writer.get_instance_handle().into(),
            Self::ArmSdk(writer) => writer.get_instance_handle().into(),
        }
    }
}

#[derive(Default)]
pub(crate) struct Controller {
    pub(crate) name: String,
    pub(crate) joints: u32,
    /// Indices of its joints, in the controller's order.
    pub(crate) order: Vec<usize>,
    pub(crate) joint_names: Vec<String>,
    pub(crate) topic: String,
    /// None for a preflight, which sends nothing.
    pub(crate) writer: Option<Writer>,
    /// One reader of its state per member. None for a controller that publishes no state.
    pub(crate) states: Option<[DataReader<ControllerState>; 2]>,
    pub(crate) last_message: Option<Stamp>,
    pub(crate) other_joints: bool,
    pub(crate) readers: usize,
    pub(crate) publishers: usize,
}

pub(crate) fn failed(what: &str) -> impl Fn(DdsError) -> String {
    let what = what.to_owned();
    move |error| format!("DDS: {what}: {error:?}")
}

/// Depth of a writer's history, messages: 0.34 s of trajectories, 0.13 s of positions. As many acknowledgements in a row may
/// be lost.
const UNACKNOWLEDGED: u32 = 64;
/// Longest time for which a write blocks on a full history, ns. The message is lost then.
const BLOCKING_NS: u32 = 1_000_000;

pub(crate) fn reliability(kind: ReliabilityQosPolicyKind) -> ReliabilityQosPolicy {
    ReliabilityQosPolicy { kind, max_blocking_time: DurationKind::Finite(Duration::new(0, BLOCKING_NS)) }
}

/// Lease duration that our readers request: the longest finite duration of DDS. dust_dds 0.16 reads a peer's explicit infinite
/// duration as this one, which is shorter than its own infinite duration. So it refuses the match, for example with Fast DDS.
/// With this request it matches, and [`crate::wire`] announces the request as infinite.
const INFINITE: Duration = Duration::new(i32::MAX, 999_999_999);
/// Deadline that our writers offer, s. dust_dds would read a reader's infinite deadline as one shorter than our infinite offer.
/// No reader monitors it. Assumption: a day is longer than any time between two messages.
const PROMISED_S: i32 = 86_400;

/// Quality of service of a reader that matches every publisher.
pub(crate) fn best_effort_qos() -> DataReaderQos {
    let lease_duration = DurationKind::Finite(INFINITE);
    let liveliness = LivelinessQosPolicy { kind: LivelinessQosPolicyKind::Automatic, lease_duration };
    DataReaderQos { liveliness, ..DataReaderQos::default() }
}

/// Quality of service of a reader that requests lost messages again.
pub(crate) fn reliable_qos() -> DataReaderQos {
    DataReaderQos { reliability: reliability(ReliabilityQosPolicyKind::Reliable), ..best_effort_qos() }
}

/// Quality of service of a reader that also receives the last message published before it joined.
pub(crate) fn transient_local_qos() -> DataReaderQos {
    DataReaderQos {
        durability: DurabilityQosPolicy { kind: DurabilityQosPolicyKind::TransientLocal },
        ..reliable_qos()
    }
}

/// Opens readers of one topic, one for each quality of service.
pub(crate) fn readers<T: TypeSupport + RosType, const COUNT: usize>(
    member: &Member,
    ros: &str,
    qos: [DataReaderQos; COUNT],
) -> Result<[DataReader<T>; COUNT], String> {
    let topic = member
        .participant
        .create_topic::<T>(&topic(ros), T::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
        .map_err(failed(ros))?;
    let reader = |qos| member.subscriber.create_datareader::<T>(&topic, qos, NO_LISTENER, NO_STATUS);
    let readers = qos.map(|qos| reader(QosKind::Specific(qos)).map_err(failed(ros)));
    let readers = readers.into_iter().collect::<Result<Vec<_>, _>>()?;
    readers.try_into().map_err(|_| format!("DDS: {ros}: another number of readers"))
}

/// Opens one reader per member. Both receive the same messages, each in datagrams of its own.
pub(crate) fn reader_pair<T: TypeSupport + RosType>(
    members: &[Member; 2],
    ros: &str,
) -> Result<[DataReader<T>; 2], String> {
    let [a, b] = members;
    let open = |member| readers(member, ros, [best_effort_qos()]).map(|[reader]| reader);
    Ok([open(a)?, open(b)?])
}

pub(crate) fn take_messages<T>(reader: &DataReader<T>) -> Vec<T>
where
    T: TypeSupport,
{
    // A reader in error counts as empty.
    let samples = reader.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default();
    samples.into_iter().filter_map(|sample| sample.data).collect()
}

pub(crate) struct Member {
    pub(crate) participant: DomainParticipant,
    pub(crate) subscriber: Subscriber,
}

/// Joins a DDS domain as two participants. The robot sends every state to both, so one lost datagram loses no state. The first
/// participant also reads all other topics, and writes.
pub(crate) fn join_domain(settings: &Ros2Settings) -> Result<[Member; 2], String> {
    let mut udp = RtpsUdpTransportParticipantFactory::default();
    if !settings.interface.is_empty() {
        check_network_interface(&settings.interface)?;
        udp.set_interface_name(Some(settings.interface.clone()));
    }
    udp.set_udp_receive_buffer_size(Some(RECEIVED_BYTES));
    let configuration = DustDdsConfigurationBuilder::new()
        .enable_type_information(false)
        .participant_announcement_interval(ANNOUNCE)
        .build()
        .map_err(failed("configuration"))?;
    // Process id and time make a unique GUID prefix.
    let (process, started) = (std::process::id().to_ne_bytes(), (rt::now().0 as u32).to_ne_bytes());
    let factory = DomainParticipantFactoryAsync::new(
        StdRuntime::default(),
        process,
        started,
        LossTolerantUdp(udp),
        configuration,
    );
    // dust_dds requires a factory that lives as long as the process.
    let factory = DomainParticipantFactory::new(Box::leak(Box::new(factory)));
    let domain = settings.domain_id as i32;
    let member = || -> Result<Member, String> {
        let participant = factory
            .create_participant(domain, QosKind::Default, NO_LISTENER, NO_STATUS)
            .map_err(failed("participant"))?;
        let subscriber =
            participant.create_subscriber(QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed("subscriber"))?;
        Ok(Member { participant, subscriber })
    };
    Ok([member()?, member()?])
}

/// Refuses a network interface that this machine does not have.
fn check_network_interface(interface: &str) -> Result<(), String> {
    let entries = std::fs::read_dir("/sys/class/net").into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    // Without this folder the interface cannot be checked.
    if names.is_empty() || names.iter().any(|name| name == interface) {
        return Ok(());
    }
    Err(format!(
        "ros2.interface = \"{interface}\": this machine has no such network interface, only {}",
        names.join(", ")
    ))
}

/// Quality of service of a writer that every reader matches. A reliable reader matches no best-effort writer.
pub(crate) fn writer_qos() -> DataWriterQos {
    let reliability = reliability(ReliabilityQosPolicyKind::Reliable);
    let history = HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(UNACKNOWLEDGED) };
    let deadline = DeadlineQosPolicy { period: DurationKind::Finite(Duration::new(PROMISED_S, 0)) };
    DataWriterQos { reliability, history, deadline, ..DataWriterQos::default() }
}

/// The same for a writer whose last message also those get who join later.
pub(crate) fn latched_qos() -> DataWriterQos {
    let history = HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(1) };
    DataWriterQos { durability: transient_local_qos().durability, history, ..writer_qos() }
}

/// Opens a topic, and a writer of it.
pub(crate) fn open_writer<T: TypeSupport + RosType>(
    member: &Member,
    publisher: &Publisher,
    ros: &str,
    qos: DataWriterQos,
) -> Result<DataWriter<T>, String> {
    let topic = member
        .participant
        .create_topic::<T>(&topic(ros), T::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
        .map_err(failed(ros))?;
    publisher.create_datawriter::<T>(&topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS).map_err(failed(ros))
}

/// Opens a command topic, if there is a publisher.
fn writer<T: TypeSupport + RosType>(
    member: &Member,
    publisher: Option<&Publisher>,
    ros: &str,
) -> Result<Option<DataWriter<T>>, String> {
    publisher.map(|publisher| open_writer(member, publisher, ros, writer_qos())).transpose()
}

impl Controller {
    /// Opens the topics of a hand's trajectory controller. It has none of the arms' joints.
    pub(crate) fn of_fingers(
        name: &str,
        joint_names: Vec<String>,
        members: &[Member; 2],
        publisher: Option<&Publisher>,
    ) -> Result<Self, String> {
        let (name, topic) = (name.to_owned(), format!("/{name}/joint_trajectory"));
        let writer = writer(&members[0], publisher, &topic)?.map(Writer::Trajectory);
        let states = Some(reader_pair(members, &format!("/{name}/controller_state"))?);
        Ok(Self { name, joint_names, topic, writer, states, ..Self::default() })
    }

    /// Opens the controller's topics. Without a publisher it has no writer.
    pub(crate) fn open(
        model: &Model,
        controller: &robot::Controller,
        interface: SetpointKind,
        members: &[Member; 2],
        publisher: Option<&Publisher>,
    ) -> Result<Self, String> {
        let (member, name, joints, order) =
            (&members[0], controller.name.clone(), controller.joints, controller.order.clone());
        let topic = match interface {
            SetpointKind::Trajectories => format!("/{name}/joint_trajectory"),
            SetpointKind::Positions => format!("/{name}/commands"),
            SetpointKind::ArmSdk => format!("/{name}"),
        };
        let writer = match interface {
            SetpointKind::Trajectories => writer(member, publisher, &topic)?.map(Writer::Trajectory),
            SetpointKind::Positions => writer(member, publisher, &topic)?.map(Writer::Positions),
            SetpointKind::ArmSdk => writer(member, publisher, &topic)?.map(Writer::ArmSdk),
        };
        let states = (interface == SetpointKind::Trajectories)
            .then(|| reader_pair(members, &format!("/{name}/controller_state")))
            .transpose()?;
        let own = (0..model.count).filter(|j| joints & 1 << j != 0);
        let joint_names = own.map(|j| model.joint_names[j].clone()).collect();
        Ok(Self { name, joints, order, joint_names, topic, writer, states, ..Self::default() })
    }
}
