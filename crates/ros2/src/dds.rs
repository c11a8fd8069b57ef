//! Topics, readers and writers of DDS.

use crate::ros::{ControllerState, Float64MultiArray, JointTrajectory, RosType, topic};
use crate::unitree::{LowCmd, MotorCmd};
use crate::wire::Lossy;
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

/// How often this participant announces itself. A robot that starts later finds it within this time.
const ANNOUNCE: std::time::Duration = std::time::Duration::from_millis(500);
/// Bytes that may wait in the socket: a large /robot_description arrives at once, and DDS asks for what is lost in a way that
/// fails. Linux gives no more than net.core.rmem_max.
const RECEIVED_BYTES: usize = 4 << 20;
/// Largest number of messages taken at once.
pub(crate) const TAKEN_MAX: i32 = 16;

/// A message for a controller.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// For a trajectory controller.
    Trajectory(JointTrajectory),
    /// For a controller that takes positions.
    Positions(Float64MultiArray),
    /// For `rt/arm_sdk`.
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

/// Writer of a controller's messages.
pub(crate) enum Writer {
    Trajectory(DataWriter<JointTrajectory>),
    Positions(DataWriter<Float64MultiArray>),
    ArmSdk(DataWriter<LowCmd>),
}

impl Writer {
    /// Sends a message of its own kind. One that could not be sent is a lost one: the robot will show it.
    pub(crate) fn write(&self, message: Message) {
        let _ = match (self, message) {
            (Self::Trajectory(writer), Message::Trajectory(message)) => writer.write(message, None),
            (Self::Positions(writer), Message::Positions(message)) => writer.write(message, None),
            (Self::ArmSdk(writer), Message::ArmSdk(message)) => writer.write(*message, None),
            _ => Ok(()),
        };
    }

    /// Its name among all publishers.
    pub(crate) fn key(&self) -> [u8; 16] {
        match self {
            Self::Trajectory(writer) => writer.get_instance_handle().into(),
            Self::Positions(writer) => writer.get_instance_handle().into(),
            Self::ArmSdk(writer) => writer.get_instance_handle().into(),
        }
    }
}

/// One controller of the robot.
pub(crate) struct Controller {
    pub(crate) name: String,
    pub(crate) joints: u32,
    /// Its joints in its own order.
    pub(crate) order: Vec<usize>,
    pub(crate) joint_names: Vec<String>,
    pub(crate) topic: String,
    /// None for a preflight, which sends nothing.
    pub(crate) writer: Option<Writer>,
    /// None for a controller that says nothing of itself.
    pub(crate) states: Option<[DataReader<ControllerState>; 2]>,
    pub(crate) heard: Option<Stamp>,
    pub(crate) other_joints: bool,
    pub(crate) readers: usize,
    pub(crate) publishers: usize,
}

pub(crate) fn failed(what: &str) -> impl Fn(DdsError) -> String {
    let what = what.to_owned();
    move |error| format!("DDS: {what}: {error:?}")
}

/// Messages that may wait for their acknowledgement: 0.34 s of trajectories, 0.13 s of positions. So many acknowledgements may
/// be lost in a row.
const UNACKNOWLEDGED: u32 = 64;
/// Longest time that a message waits for an acknowledgement if so many are missing, ns. Then it is lost.
const BLOCKING_NS: u32 = 1_000_000;

pub(crate) fn reliability(kind: ReliabilityQosPolicyKind) -> ReliabilityQosPolicy {
    ReliabilityQosPolicy { kind, max_blocking_time: DurationKind::Finite(Duration::new(0, BLOCKING_NS)) }
}

/// An infinite time as dust_dds 0.16 reads it from others. It takes it for less than its own infinite time, and does not match
/// who says it aloud, as Fast DDS does. So our readers say this time, and [`crate::wire`] makes it infinite again.
const INFINITE: Duration = Duration::new(i32::MAX, 999_999_999);
/// Longest time between two messages that our writers promise, s. A reader's infinite time would be less than our own.
/// Nobody watches it. Assumption.
const PROMISED_S: i32 = 86_400;

/// Quality of service of a reader of any publisher.
pub(crate) fn any() -> DataReaderQos {
    let lease_duration = DurationKind::Finite(INFINITE);
    let liveliness = LivelinessQosPolicy { kind: LivelinessQosPolicyKind::Automatic, lease_duration };
    DataReaderQos { liveliness, ..DataReaderQos::default() }
}

/// Quality of service of a reader that asks again for what it missed.
pub(crate) fn each() -> DataReaderQos {
    DataReaderQos { reliability: reliability(ReliabilityQosPolicyKind::Reliable), ..any() }
}

/// Quality of service of a reader that also wants the last message of before it came.
pub(crate) fn kept() -> DataReaderQos {
    DataReaderQos { durability: DurabilityQosPolicy { kind: DurabilityQosPolicyKind::TransientLocal }, ..each() }
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

/// Opens a reader for each of the members. They get the same messages, each over the network by itself.
pub(crate) fn twice<T: TypeSupport + RosType>(members: &[Member; 2], ros: &str) -> Result<[DataReader<T>; 2], String> {
    let [a, b] = members;
    let open = |member| readers(member, ros, [any()]).map(|[reader]| reader);
    Ok([open(a)?, open(b)?])
}

pub(crate) fn take<T>(reader: &DataReader<T>) -> Vec<T>
where
    T: TypeSupport,
{
    // An error is an empty reader.
    let samples = reader.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default();
    samples.into_iter().filter_map(|sample| sample.data).collect()
}

/// A participant, with what reads and writes for it.
pub(crate) struct Member {
    pub(crate) participant: DomainParticipant,
    pub(crate) subscriber: Subscriber,
}

/// Joins a DDS domain as two participants. The robot sends to each of them, so every state comes twice. The first one
/// does everything else.
pub(crate) fn join(settings: &Ros2Settings) -> Result<[Member; 2], String> {
    let mut udp = RtpsUdpTransportParticipantFactory::default();
    if !settings.interface.is_empty() {
        known(&settings.interface)?;
        udp.set_interface_name(Some(settings.interface.clone()));
    }
    udp.set_udp_receive_buffer_size(Some(RECEIVED_BYTES));
    let configuration = DustDdsConfigurationBuilder::new()
        .enable_type_information(false)
        .participant_announcement_interval(ANNOUNCE)
        .build()
        .map_err(failed("configuration"))?;
    // Process and time make a name that no other participant has.
    let (process, started) = (std::process::id().to_ne_bytes(), (rt::now().0 as u32).to_ne_bytes());
    let factory =
        DomainParticipantFactoryAsync::new(StdRuntime::default(), process, started, Lossy(udp), configuration);
    // DDS wants a factory that lives as long as the process.
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
fn known(interface: &str) -> Result<(), String> {
    let entries = std::fs::read_dir("/sys/class/net").into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    // Without the folder nothing is known.
    if names.is_empty() || names.iter().any(|name| name == interface) {
        return Ok(());
    }
    Err(format!(
        "ros2.interface = \"{interface}\": this machine has no such network interface, only {}",
        names.join(", ")
    ))
}

/// Opens a command topic, and a writer if there is a publisher.
fn writer<T: TypeSupport + RosType>(
    member: &Member,
    publisher: Option<&Publisher>,
    ros: &str,
) -> Result<Option<DataWriter<T>>, String> {
    let dds = topic(ros);
    let topic = member
        .participant
        .create_topic::<T>(&dds, T::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
        .map_err(failed(ros))?;
    let open = |publisher: &Publisher| {
        // A reader that wants best effort takes a reliable writer too, but not the other way round.
        let reliability = reliability(ReliabilityQosPolicyKind::Reliable);
        let history = HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(UNACKNOWLEDGED) };
        let deadline = DeadlineQosPolicy { period: DurationKind::Finite(Duration::new(PROMISED_S, 0)) };
        let qos = DataWriterQos { reliability, history, deadline, ..DataWriterQos::default() };
        let qos = QosKind::Specific(qos);
        publisher.create_datawriter::<T>(&topic, qos, NO_LISTENER, NO_STATUS).map_err(failed(ros))
    };
    publisher.map(open).transpose()
}

impl Controller {
    /// Opens the topics of a hand's trajectory controller. Its joints are none of the arms'.
    pub(crate) fn of_fingers(
        name: &str,
        joint_names: Vec<String>,
        members: &[Member; 2],
        publisher: Option<&Publisher>,
    ) -> Result<Self, String> {
        let (name, topic) = (name.to_owned(), format!("/{name}/joint_trajectory"));
        let writer = writer(&members[0], publisher, &topic)?.map(Writer::Trajectory);
        let states = Some(twice(members, &format!("/{name}/controller_state"))?);
        let (joints, order, heard, other_joints, readers, publishers) = (0, Vec::new(), None, false, 0, 0);
        Ok(Self { name, joints, order, joint_names, topic, writer, states, heard, other_joints, readers, publishers })
    }

    /// Opens its topics. Without a publisher nothing can be sent.
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
            .then(|| twice(members, &format!("/{name}/controller_state")))
            .transpose()?;
        let own = (0..model.count).filter(|j| joints & 1 << j != 0);
        let joint_names = own.map(|j| model.joint_names[j].clone()).collect();
        let (heard, other_joints, readers, publishers) = (None, false, 0, 0);
        Ok(Self { name, joints, order, joint_names, topic, writer, states, heard, other_joints, readers, publishers })
    }
}
