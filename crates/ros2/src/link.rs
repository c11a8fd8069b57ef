//! The connection to the robot over DDS. Everything here may block and allocate. It runs in a thread beside the driver's
//! loop.

use crate::clock::RobotClock;
use crate::estimate::Sample;
use crate::ros::{
    Bool, ControllerState, Header, JointState, JointTrajectory, JointTrajectoryPoint, RosType, Text, Time, topic,
};
use crate::smooth::Smooth;
use crate::trajectory::{Command, Past, points};
use config::Ros2Settings;
use dust_dds::builtin_topics::{PublicationBuiltinTopicData, SubscriptionBuiltinTopicData};
use dust_dds::configuration::DustDdsConfigurationBuilder;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::error::DdsError;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::{DataReaderQos, DataWriterQos, QosKind};
use dust_dds::infrastructure::qos_policy::{
    DurabilityQosPolicy, DurabilityQosPolicyKind, ReliabilityQosPolicy, ReliabilityQosPolicyKind,
};
use dust_dds::infrastructure::sample_info::{ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::infrastructure::time::{Duration, DurationKind};
use dust_dds::publication::data_writer::DataWriter;
use dust_dds::publication::publisher::Publisher;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber;
use dust_dds::xtypes::type_support::TypeSupport;
use messages::{JOINTS_MAX, Stamp, tick_at};
use robot::Model;

/// Longest time for which a controller may be silent, ns. An active one publishes its state 50 times a second.
const CONTROLLER_SILENT_NS: u64 = 100_000_000;
/// Time between two looks at who else is on the command topics, ns.
const LOOK_NS: u64 = 250_000_000;
/// How often this participant announces itself. A robot that starts later finds it within this time.
const ANNOUNCE: std::time::Duration = std::time::Duration::from_millis(500);
/// Largest number of messages taken at once.
const TAKEN_MAX: i32 = 16;

/// One controller of the robot.
struct Controller {
    name: String,
    joints: u32,
    joint_names: Vec<String>,
    topic: String,
    writer: DataWriter<JointTrajectory>,
    state: DataReader<ControllerState>,
    heard: Option<Stamp>,
    other_joints: bool,
    readers: usize,
    publishers: usize,
}

/// A controller as it shows itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Its name.
    pub name: String,
    /// Its command topic, as ROS names it.
    pub topic: String,
    /// It published its state within the last 0.1 s, as only an active one does.
    pub active: bool,
    /// It has other joints than the robot file.
    pub other_joints: bool,
    /// Number of readers of its command topic.
    pub readers: usize,
    /// Number of other publishers on its command topic.
    pub publishers: usize,
}

/// The newest state of all joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// The sample, by this machine's clock.
    pub sample: Sample,
    /// Stamp of the robot's clock, ns.
    pub stamp_ns: i64,
    /// Number of complete states so far.
    pub count: u64,
}

/// The connection.
pub struct Link {
    joint_names: Vec<String>,
    prefer_difference: bool,
    delay_ns: u64,
    controllers: Vec<Controller>,
    states: DataReader<JointState>,
    emergency: Option<DataReader<Bool>>,
    description: DataReader<Text>,
    builtin: Subscriber,
    /// The robot's clock.
    pub clock: RobotClock,
    /// The newest state of all joints.
    pub heard: Option<Heard>,
    /// Sentence on the last joint state that was not complete.
    pub incomplete: Option<String>,
    /// Number of stamps that were not believed.
    pub disbelieved: u64,
    /// The emergency stop is pressed. None before the first message.
    pub pressed: Option<bool>,
    /// The robot's own description.
    pub urdf: Option<String>,
    past: Past,
    smooth: Smooth,
    looked: Stamp,
}

fn failed(what: &str) -> impl Fn(DdsError) -> String {
    let what = what.to_owned();
    move |error| format!("DDS: {what}: {error:?}")
}

fn reliable() -> ReliabilityQosPolicy {
    let max_blocking_time = DurationKind::Finite(Duration::new(0, 10_000_000));
    ReliabilityQosPolicy { kind: ReliabilityQosPolicyKind::Reliable, max_blocking_time }
}

fn reader<T: TypeSupport + RosType>(
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

fn take<T>(reader: &DataReader<T>) -> Vec<T>
where
    T: TypeSupport,
{
    // An error is an empty reader.
    let samples = reader.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default();
    samples.into_iter().filter_map(|sample| sample.data).collect()
}

/// Joins a DDS domain.
fn join(settings: &Ros2Settings) -> Result<DomainParticipant, String> {
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
    fn open(
        model: &Model,
        controller: &robot::Controller,
        (participant, subscriber, publisher): (&DomainParticipant, &Subscriber, &Publisher),
    ) -> Result<Self, String> {
        let name = controller.name.clone();
        let (commands, state) = (format!("/{name}/joint_trajectory"), format!("/{name}/controller_state"));
        let joints = (0..model.count).filter(|j| controller.joints & 1 << j != 0);
        let dds = topic(&commands);
        let topic = participant
            .create_topic::<JointTrajectory>(&dds, JointTrajectory::NAME, QosKind::Default, NO_LISTENER, NO_STATUS)
            .map_err(failed(&commands))?;
        let qos = DataWriterQos { reliability: reliable(), ..DataWriterQos::default() };
        let writer = publisher
            .create_datawriter::<JointTrajectory>(&topic, QosKind::Specific(qos), NO_LISTENER, NO_STATUS)
            .map_err(failed(&commands))?;
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

impl Link {
    /// Joins the robot's domain.
    pub fn open(model: &Model, settings: &Ros2Settings) -> Result<Self, String> {
        let participant = join(settings)?;
        let subscriber =
            participant.create_subscriber(QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed("subscriber"))?;
        let publisher =
            participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS).map_err(failed("publisher"))?;
        let own = (&participant, &subscriber, &publisher);
        let controllers = model
            .controllers
            .iter()
            .map(|controller| Controller::open(model, controller, own))
            .collect::<Result<_, _>>()?;
        let kept = DataReaderQos {
            durability: DurabilityQosPolicy { kind: DurabilityQosPolicyKind::TransientLocal },
            reliability: reliable(),
            ..DataReaderQos::default()
        };
        let emergency = (!settings.emergency_stop_topic.is_empty())
            .then(|| reader(&participant, &subscriber, &settings.emergency_stop_topic, QosKind::Default))
            .transpose()?;
        Ok(Self {
            joint_names: model.joint_names.clone(),
            prefer_difference: false,
            delay_ns: (settings.delay_ms * 1e6) as u64,
            controllers,
            states: reader(&participant, &subscriber, &settings.joint_states_topic, QosKind::Default)?,
            emergency,
            description: reader(&participant, &subscriber, "/robot_description", QosKind::Specific(kept))?,
            builtin: participant.get_builtin_subscriber(),
            clock: RobotClock::default(),
            heard: None,
            incomplete: None,
            disbelieved: 0,
            pressed: None,
            urdf: None,
            past: Past::default(),
            smooth: Smooth::new(model.limits.map(|limits| limits.a_max)),
            looked: Stamp::NONE,
        })
    }

    /// Takes what arrived. Returns true if a new complete joint state is among it.
    pub fn hear(&mut self, now: Stamp) -> bool {
        let mut news = false;
        for state in take(&self.states) {
            news |= self.take_state(&state, now);
        }
        for controller in &mut self.controllers {
            for state in take(&controller.state) {
                controller.heard = Some(now);
                let same = |name: &String| state.joint_names.contains(name);
                let all = controller.joint_names.iter().all(same);
                controller.other_joints = !all || state.joint_names.len() != controller.joint_names.len();
            }
        }
        if let Some(emergency) = &self.emergency
            && let Some(newest) = take(emergency).pop()
        {
            self.pressed = Some(newest.data);
        }
        if let Some(text) = take(&self.description).pop() {
            self.urdf = Some(text.data);
        }
        if now.since(self.looked) >= LOOK_NS {
            self.looked = now;
            self.look_around();
        }
        news
    }

    fn take_state(&mut self, state: &JointState, now: Stamp) -> bool {
        let stamp_ns = state.header.stamp.ns();
        if !self.clock.hear(stamp_ns, now) {
            self.disbelieved += 1;
            if self.clock.offset_ns().is_none() {
                // The clock is taken again from the next stamp on.
                self.heard = None;
            }
            return false;
        }
        if self.heard.as_ref().is_some_and(|heard| stamp_ns <= heard.stamp_ns) {
            return false;
        }
        let (mut q, mut dq) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        for (j, name) in self.joint_names.iter().enumerate() {
            let Some(i) = state.name.iter().position(|other| other == name) else {
                self.incomplete = Some(format!("joint_states does not name `{name}`"));
                return false;
            };
            q[j] = state.position.get(i).copied().unwrap_or(f64::NAN);
            dq[j] = state.velocity.get(i).copied().unwrap_or(f64::NAN);
            if !q[j].is_finite() {
                self.incomplete = Some(format!("joint_states has {} for the position of `{name}`", q[j]));
                return false;
            }
        }
        let measured = self.clock.here(stamp_ns).map_or(now, |here| here.min(now));
        // A robot may report no velocities. Then they are the differences of its positions.
        self.prefer_difference |= dq[..self.joint_names.len()].iter().any(|dq| !dq.is_finite());
        let before = self.heard.as_ref();
        if self.prefer_difference {
            let since_s = before.map_or(0.0, |before| (stamp_ns - before.stamp_ns) as f64 * 1e-9);
            dq = std::array::from_fn(|j| match before {
                Some(before) if since_s > 0.0 => (q[j] - before.sample.q[j]) / since_s,
                _ => 0.0,
            });
        }
        let count = before.map_or(0, |before| before.count) + 1;
        self.heard = Some(Heard { sample: Sample { measured, q, dq }, stamp_ns, count });
        true
    }

    /// Counts who else is on the command topics.
    fn look_around(&mut self) {
        const ALIVE: &[InstanceStateKind] = &[InstanceStateKind::Alive];
        let publications = self
            .builtin
            .lookup_datareader::<PublicationBuiltinTopicData>("DCPSPublication")
            .ok()
            .flatten()
            .and_then(|reader| reader.read(i32::MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ALIVE).ok())
            .unwrap_or_default();
        let subscriptions = self
            .builtin
            .lookup_datareader::<SubscriptionBuiltinTopicData>("DCPSSubscription")
            .ok()
            .flatten()
            .and_then(|reader| reader.read(i32::MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ALIVE).ok())
            .unwrap_or_default();
        for controller in &mut self.controllers {
            let name = topic(&controller.topic);
            let own: [u8; 16] = controller.writer.get_instance_handle().into();
            let publishes =
                |found: &&PublicationBuiltinTopicData| found.topic_name() == name && found.key().value != own;
            let reads = |found: &&SubscriptionBuiltinTopicData| found.topic_name() == name;
            controller.publishers =
                publications.iter().filter_map(|sample| sample.data.as_ref()).filter(publishes).count();
            controller.readers = subscriptions.iter().filter_map(|sample| sample.data.as_ref()).filter(reads).count();
        }
    }

    /// The controllers as they show themselves at `now`.
    pub fn controllers(&self, now: Stamp) -> Vec<Seen> {
        let seen = |controller: &Controller| Seen {
            name: controller.name.clone(),
            topic: controller.topic.clone(),
            active: controller.heard.is_some_and(|heard| now.since(heard) <= CONTROLLER_SILENT_NS),
            other_joints: controller.other_joints,
            readers: controller.readers,
            publishers: controller.publishers,
        };
        self.controllers.iter().map(seen).collect()
    }

    /// The messages of a command, one for each controller. None while the robot's clock is not known.
    pub fn messages(&self, command: &Command) -> Option<Vec<JointTrajectory>> {
        let message = |controller: &Controller| {
            let (first, points) = points(self.past.points(), command, controller.joints);
            let stamp_ns = self.clock.there_ns(first.plus_ns(self.delay_ns))?;
            Some(JointTrajectory {
                header: Header { stamp: Time::of_ns(stamp_ns), frame_id: String::new() },
                joint_names: controller.joint_names.clone(),
                points: points
                    .into_iter()
                    .map(|point| JointTrajectoryPoint {
                        positions: point.positions,
                        velocities: point.velocities,
                        accelerations: Vec::new(),
                        effort: Vec::new(),
                        time_from_start: Time::of_ns(point.since_first_ns as i64),
                    })
                    .collect(),
            })
        };
        self.controllers.iter().map(message).collect()
    }

    /// Sends the last of `commands` to all controllers. The others came too late. Returns false if it could not be sent
    /// to all, or did not continue what the robot executes.
    pub fn send(&mut self, commands: &[Command], now: Stamp) -> bool {
        let Some(wanted) = commands.last() else { return !self.smooth.approaches() };
        let from = self.past.prepare(commands, tick_at(Stamp(now.0.saturating_sub(self.delay_ns))));
        let command = &self.smooth.pass(from.as_ref(), wanted, self.pressed != Some(true));
        let Some(messages) = self.messages(command) else { return false };
        let mut sent = true;
        for (controller, message) in self.controllers.iter().zip(messages) {
            sent &= controller.writer.write(message, None).is_ok();
        }
        self.past.sent(command);
        sent && !self.smooth.approaches()
    }
}
