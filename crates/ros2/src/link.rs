//! The connection to the robot over DDS. Everything here may block and allocate. It runs in a thread beside the driver's
//! loop.

use crate::clock::RobotClock;
use crate::dds::{Controller, Member, TAKEN_MAX, failed, join, kept, readers, take, twice};
use crate::emergency::EmergencyStop;
use crate::estimate::Sample;
use crate::join::{Joined, Reference, agrees, continues};
use crate::ros::{Header, JointState, JointTrajectory, JointTrajectoryPoint, Text, Time, topic};
use crate::trajectory::{Command, Past, points};
use config::Ros2Settings;
use dust_dds::builtin_topics::{PublicationBuiltinTopicData, SubscriptionBuiltinTopicData};
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::QosKind;
use dust_dds::infrastructure::sample_info::{ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE, InstanceStateKind};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber;
use messages::{JOINTS_MAX, Stamp, tick_at};
use robot::Model;

/// Longest time for which a controller may be silent, ns. An active one publishes its state 50 times a second.
const CONTROLLER_SILENT_NS: u64 = 100_000_000;
/// Time between two looks at who else is on the command topics, ns.
const LOOK_NS: u64 = 250_000_000;

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
    states: [DataReader<JointState>; 2],
    emergency: Option<EmergencyStop>,
    description: Option<DataReader<Text>>,
    builtin: Subscriber,
    /// The robot's clock.
    pub clock: RobotClock,
    /// The newest state of all joints.
    pub heard: Option<Heard>,
    /// Sentence on the last joint state that was not complete.
    pub incomplete: Option<String>,
    /// Number of stamps that were not believed.
    pub disbelieved: u64,
    /// The emergency stop is pressed. None before the first message, and once its publisher left.
    pub pressed: Option<bool>,
    /// The robot's own description.
    pub urdf: Option<String>,
    past: Past,
    joined: Joined,
    reference: Reference,
    /// Acceleration limits, rad/s^2 or m/s^2.
    a_max: [f64; JOINTS_MAX],
    /// Why the robot departed.
    departed: Option<String>,
    /// The participant that reports the joint states.
    reporter: Option<[u8; 16]>,
    members: [Member; 2],
    looked: Stamp,
}

impl Link {
    /// Joins the robot's domain. With `sends`, it may send.
    pub fn open(model: &Model, settings: &Ros2Settings, sends: bool) -> Result<Self, String> {
        let members = join(settings)?;
        let publisher = members[0].participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS);
        let publisher = publisher.map_err(failed("publisher"))?;
        let controller = |controller| Controller::open(model, controller, &members, sends.then_some(&publisher));
        let controllers = model.controllers.iter().map(controller).collect::<Result<_, _>>()?;
        let emergency = (!settings.emergency_stop_topic.is_empty())
            .then(|| EmergencyStop::open(&members[0], &settings.emergency_stop_topic))
            .transpose()?;
        let [description] = readers(&members[0], "/robot_description", [kept()])?;
        Ok(Self {
            joint_names: model.joint_names.clone(),
            prefer_difference: false,
            delay_ns: (settings.delay_ms * 1e6) as u64,
            controllers,
            states: twice(&members, &settings.joint_states_topic)?,
            emergency,
            description: Some(description),
            builtin: members[0].participant.get_builtin_subscriber(),
            clock: RobotClock::default(),
            heard: None,
            incomplete: None,
            disbelieved: 0,
            pressed: None,
            urdf: None,
            past: Past::default(),
            joined: Joined::No,
            reference: Reference::default(),
            a_max: model.limits.map(|limits| limits.a_max),
            departed: None,
            reporter: None,
            members,
            looked: Stamp::NONE,
        })
    }

    /// Takes what arrived. Returns true if a new complete joint state is among it.
    pub fn hear(&mut self, now: Stamp) -> bool {
        let mut news = false;
        let samples = |states: &DataReader<JointState>| {
            states.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default()
        };
        // A state that came twice is older than itself.
        for sample in self.states.each_ref().map(samples).into_iter().flatten() {
            let from: [u8; 16] = sample.sample_info.publication_handle.into();
            // A robot that started again is another one: its driver must start again, too.
            if let Some(state) = sample.data
                && self.reporter.is_none_or(|reporter| reporter == from)
                && self.take_state(&state, now)
            {
                (news, self.reporter) = (true, Some(from));
            }
        }
        self.hear_controllers(now);
        if let Some(emergency) = &mut self.emergency {
            emergency.hear();
        }
        if let Some(text) = self.description.as_ref().and_then(|description| take(description).pop()) {
            self.urdf = Some(text.data);
        }
        if now.since(self.looked) >= LOOK_NS {
            self.looked = now;
            self.look_around();
        }
        self.pressed = self.emergency.as_ref().and_then(EmergencyStop::pressed);
        news
    }

    /// Stops listening to what only the preflight needs.
    pub fn forget_description(&mut self) {
        if let Some(description) = self.description.take() {
            // An error leaves a reader that nobody asks.
            let _ = self.members[0].subscriber.delete_datareader(&description);
        }
    }

    fn hear_controllers(&mut self, now: Stamp) {
        for i in 0..self.controllers.len() {
            for state in self.controllers[i].states.each_ref().map(take).into_iter().flatten() {
                let controller = &mut self.controllers[i];
                controller.heard = Some(now);
                let place = |name: &String| state.joint_names.iter().position(|other| other == name);
                let places: Vec<Option<usize>> = controller.joint_names.iter().map(place).collect();
                let all = places.iter().all(Option::is_some);
                controller.other_joints = !all || state.joint_names.len() != controller.joint_names.len();
                let at = self.clock.here(state.header.stamp.ns());
                let joints: Vec<usize> = (0..JOINTS_MAX).filter(|j| controller.joints & 1 << j != 0).collect();
                for (j, place) in joints.into_iter().zip(places) {
                    let positions = &state.reference.positions;
                    let q = place.and_then(|place| positions.get(place)).copied().unwrap_or(f64::NAN);
                    self.reference.hear(j, q, now);
                    self.compare(j, q, at);
                }
            }
        }
    }

    /// Compares a controller's setpoint with what it was sent.
    fn compare(&mut self, j: usize, q: f64, at: Option<Stamp>) {
        let (Joined::Since(since), Some(at)) = (self.joined, at) else { return };
        let then = Stamp(at.0.saturating_sub(self.delay_ns));
        if then.since(since) == 0 {
            return;
        }
        if let Some(sent) = self.past.expected(then)
            && !agrees(q, sent.q[j], sent.v[j])
        {
            let (name, off) = (&self.joint_names[j], (q - sent.q[j]) * 1e3);
            self.depart(format!(
                "the controller of `{name}` is {off:.1} mrad or mm off what it was sent: messages were lost"
            ));
        }
    }

    fn depart(&mut self, why: String) {
        if self.joined != Joined::Departed {
            self.joined = Joined::Departed;
            self.departed = Some(why);
            self.past.clear();
        }
    }

    /// Why the robot is not sent anything. None while it executes what it is sent.
    pub fn departed(&self) -> Option<&str> {
        self.departed.as_deref()
    }

    /// The controllers' own setpoints, if all are known.
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    fn take_state(&mut self, state: &JointState, now: Stamp) -> bool {
        let stamp_ns = state.header.stamp.ns();
        let (mut q, mut dq) = ([0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        for (j, name) in self.joint_names.iter().enumerate() {
            let mut places = state.name.iter().enumerate().filter(|(_, other)| *other == name);
            let (Some((i, _)), None) = (places.next(), places.next()) else {
                self.incomplete = Some(format!("joint_states does not name `{name}` once"));
                return false;
            };
            q[j] = state.position.get(i).copied().unwrap_or(f64::NAN);
            dq[j] = state.velocity.get(i).copied().unwrap_or(f64::NAN);
            if !q[j].is_finite() {
                self.incomplete = Some(format!("joint_states has {} for the position of `{name}`", q[j]));
                return false;
            }
        }
        if !self.clock.hear(stamp_ns, now) {
            self.disbelieved += 1;
            if self.clock.offset_ns().is_none() {
                // The clock is taken again from the next stamp on.
                self.heard = None;
                self.depart("the robot's clock jumped".to_owned());
            }
            return false;
        }
        if self.heard.as_ref().is_some_and(|heard| stamp_ns <= heard.stamp_ns) {
            return false;
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
        let there: Vec<Vec<u8>> = self.members[0]
            .participant
            .get_discovered_participants()
            .unwrap_or_default()
            .into_iter()
            .map(|handle| <[u8; 16]>::from(handle)[..12].to_vec())
            .collect();
        let there: Vec<&[u8]> = there.iter().map(Vec::as_slice).collect();
        if let Some(emergency) = &mut self.emergency {
            let publishes = |found: &&PublicationBuiltinTopicData| {
                found.topic_name() == emergency.topic && there.contains(&&found.key().value[..12])
            };
            let count = publications.iter().filter_map(|sample| sample.data.as_ref()).filter(publishes).count();
            emergency.note_publishers(count);
        }
        for controller in &mut self.controllers {
            let name = topic(&controller.topic);
            let own: Option<[u8; 16]> = controller.writer.as_ref().map(|writer| writer.get_instance_handle().into());
            // A publisher whose participant left is gone.
            let publishes = |found: &&PublicationBuiltinTopicData| {
                found.topic_name() == name
                    && Some(found.key().value) != own
                    && there.contains(&&found.key().value[..12])
            };
            let reads = |found: &&SubscriptionBuiltinTopicData| {
                found.topic_name() == name && there.contains(&&found.key().value[..12])
            };
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

    /// Sends the last of `commands` to all controllers. The others came too late. Returns false if nothing was sent,
    /// because the robot executes something else.
    pub fn send(&mut self, commands: &[Command], now: Stamp) -> bool {
        let Some(command) = commands.last() else { return self.joined != Joined::Departed };
        match self.joined {
            Joined::Since(_) if self.is_released() => {
                let from = self.past.prepare(commands, tick_at(Stamp(now.0.saturating_sub(self.delay_ns))));
                if !from.is_some_and(|from| continues(&self.a_max, &from, command)) {
                    self.depart("a setpoint did not continue what the robot executes".to_owned());
                }
            }
            Joined::Since(_) if self.pressed.is_none() => {
                self.depart("nobody says whether the emergency stop is pressed: its publisher left".to_owned());
            }
            Joined::Since(_) => self.depart("the emergency stop is pressed".to_owned()),
            Joined::No | Joined::Departed => self.join_where_it_stands(command, now),
        }
        if !matches!(self.joined, Joined::Since(_)) {
            return false;
        }
        let Some(messages) = self.messages(command) else { return false };
        for (controller, message) in self.controllers.iter().zip(messages) {
            // A message that could not be sent is a lost one. The reference will show it.
            let _ = controller.writer.as_ref().map(|writer| writer.write(message, None));
        }
        self.past.sent(command);
        true
    }

    /// True if the robot's emergency stop is known to be released, or the settings say that it has none.
    fn is_released(&self) -> bool {
        self.emergency.is_none() || self.pressed == Some(false)
    }

    fn join_where_it_stands(&mut self, command: &Command, now: Stamp) {
        let all = self.controllers.iter().fold(0, |all, controller| all | controller.joints);
        let active = self.controllers(now).iter().all(|seen| seen.active && !seen.other_joints);
        let meets = self.reference.stands(all, now) && self.reference.meets(&command.motion, self.joint_names.len());
        if active && meets && self.is_released() {
            self.past.clear();
            (self.joined, self.departed) = (Joined::Since(now), None);
        } else {
            self.joined = Joined::Departed;
            self.departed.get_or_insert_with(|| "the robot does not stand where the driver begins".to_owned());
        }
    }

    /// Notes at `now` that the robot fell silent, if it did.
    pub fn mind_silence(&mut self, now: Stamp) {
        let states = self.heard.as_ref().is_some_and(|heard| now.since(heard.sample.measured) <= CONTROLLER_SILENT_NS);
        if matches!(self.joined, Joined::Since(_)) && !(states && self.controllers(now).iter().all(|seen| seen.active))
        {
            self.depart("the robot fell silent".to_owned());
        }
    }
}
