//! Topics, readers and writers of DDS.

use crate::ros::{ControllerState, JointTrajectory, RosType, topic};
use config::Ros2Settings;
use dust_dds::configuration::DustDdsConfigurationBuilder;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{DataReaderQos, DataWriterQos, QosKind};
use dust_dds::infrastructure::qos_policy::{ReliabilityQosPolicy, ReliabilityQosPolicyKind};
use dust_dds::infrastructure::sample_info::{ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::infrastructure::time::{Duration, DurationKind};
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::publisher::Publisher;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber;
use dust_dds::xtypes::type_support::TypeSupport;
use messages::Stamp;
use robot::Model;

/// How often this participant announces itself. A robot that starts later finds it within this time.
const ANNOUNCE: std::time::Duration = std::time::Duration::from_millis(500);
/// Largest number of messages taken at once.
pub(crate) const TAKEN_MAX: i32 = 16;

/// One controller of the robot.
pub(crate) struct Controller {
    pub(crate) name: String,
    pub(crate) joints: u32,
    pub(crate) joint_names: Vec<String>,
    pub(crate) topic: String,
    /// None for a preflight, which sends nothing.
    pub(crate) writer: Option<DataWriter<JointTrajectory>>,
    pub(crate) state: DataReader<ControllerState>,
    pub(crate) heard: Option<Stamp>,
    pub(crate) other_joints: bool,
    pub(crate) readers: usize,
    pub(crate) publishers: usize,
}

pub(crate) fn failed(what: &str) -> impl Fn(DdsError) -> String {
    let what = what.to_owned();
    move |error| format!("DDS: {what}: {error:?}")
}

/// Longest time that a message waits until the one before is acknowledged, ns. Then it is lost.
const BLOCKING_NS: u32 = 1_000_000;

pub(crate) fn reliability(kind: ReliabilityQosPolicyKind) -> ReliabilityQosPolicy {
    ReliabilityQosPolicy { kind, max_blocking_time: DurationKind::Finite(Duration::new(0, BLOCKING_NS)) }
}

pub(crate) fn reader<T: TypeSupport + RosType>(
    participant: &DomainParticipant,
    subscriber: &Subscriber,
    ros: &str,
    qos: QosKind<DataReaderQos>,
) -> Result<DataReader<T>, String> {
    let topic = participant
        .create_topic::<T>(&topic(ros), T::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
        .map_err(failed(ros))?;
    subscriber.create_datareader::<T>(&topic, qos, NO_LISTENER, NO_STATUS).map_err(failed(ros))
}

pub(crate) fn take<T>(reader: &DataReader<T>) -> Vec<T>
where
    T: TypeSupport,
{
    // An error is an empty reader.
    let samples = reader.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default();
    samples.into_iter().filter_map(|sample| sample.data).collect()
}

/// Joins a DDS domain.
pub(crate) fn join(settings: &Ros2Settings) -> Result<DomainParticipant, String> {
    let factory = DomainParticipantFactory::get_instance();
    if !settings.interface.is_empty() {
        factory.get_mut_transport().set_interface_name(Some(settings.interface.clone()));
    }
    let configuration = DustDdsConfigurationBuilder::new()
        .enable_type_information(false)
        .participant_announcement_interval(ANNOUNCE)
        .build()
        .map_err(failed("configuration"))?;
    *factory.get_mut_configuration() = configuration;
    let domain = settings.domain_id as i32;
    factory.create_participant(domain, QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed("participant"))
}

impl Controller {
    /// Opens its topics. Without a publisher nothing can be sent.
    pub(crate) fn open(
        model: &Model,
        controller: &robot::Controller,
        (participant, subscriber): (&DomainParticipant, &Subscriber),
        publisher: Option<(&Publisher, ReliabilityQosPolicyKind)>,
    ) -> Result<Self, String> {
        let name = controller.name.clone();
        let (commands, state) = (format!("/{name}/joint_trajectory"), format!("/{name}/controller_state"));
        let joints = (0..model.count).filter(|j| controller.joints & 1 << j != 0);
        let dds = topic(&commands);
        let topic = participant
            .create_topic::<JointTrajectory>(&dds, JointTrajectory::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
            .map_err(failed(&commands))?;
        let writer = publisher.map(|(publisher, kind)| {
            let qos = DataWriterQos { reliability: reliability(kind), ..DataWriterQos::default() };
            publisher
                .create_datawriter::<JointTrajectory>(&topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS)
                .map_err(failed(&commands))
        });
        let writer = writer.transpose()?;
        Ok(Self {
            name,
            joints: controller.joints,
            joint_names: joints.map(|j| model.joint_names[j].clone()).collect(),
            topic: commands,
            writer,
            state: reader(participant, subscriber, &state, QosKind::Default)?,
            heard: None,
            other_joints: false,
            readers: 0,
            publishers: 0,
        })
    }
}
