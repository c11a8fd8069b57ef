//! The connection to the robot over DDS. Everything here may block and allocate. It runs in a thread beside the driver's
//! loop.

mod hands;
mod low_state;

use self::hands::Hands;
use crate::clock::RobotClock;
use crate::curves::{self, Curves};
pub use crate::dds::Message;
use crate::dds::{
    Controller, Member, TAKEN_MAX, best_effort_qos, failed, join_domain, reader_pair, readers, take_messages,
    transient_local_qos,
};
use crate::discovery;
use crate::emergency::EmergencyStop;
use crate::estimate::Sample;
use crate::gravity::Gravity;
use crate::interface::period_ticks;
use crate::ros::{Float64MultiArray, Header, JointState, JointTrajectory, MultiArrayLayout, Text, Time};
use crate::stream::{self, Position, Stream};
use crate::trajectory::Command;
use crate::unitree::{LowCmd, LowState};
use config::Ros2Settings;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::QosKind;
use dust_dds::infrastructure::sample_info::{ANY_INSTANCE_STATE, ANY_SAMPLE_STATE, ANY_VIEW_STATE};
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber;
use messages::{JOINTS_MAX, Stamp};
use robot::{Model, Motor, SetpointKind};

/// Longest time for which a controller may be silent, ns. An active one publishes its state 50 times a second.
const CONTROLLER_SILENT_NS: u64 = 100_000_000;
/// Time between two turns without the loop, ns.
const TURN_NS: u64 = 1_000_000;
/// Time between two looks at who else is on the command topics, ns.
const LOOK_NS: u64 = 250_000_000;

/// A controller as it shows itself.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerStatus {
    pub name: String,
    /// Its command topic, as ROS names it.
    pub topic: String,
    /// It published its state within the last 0.1 s, as only an active one does.
    pub active: bool,
    /// It has other joints than the robot file.
    pub other_joints: bool,
    pub readers: usize,
    /// Number of other publishers on its command topic.
    pub publishers: usize,
}

impl ControllerStatus {
    fn new(controller: &Controller, now: Stamp) -> Self {
        Self {
            name: controller.name.clone(),
            topic: controller.topic.clone(),
            active: controller.states.is_none()
                || controller.last_message.is_some_and(|heard| now.since(heard) <= CONTROLLER_SILENT_NS),
            other_joints: controller.other_joints,
            readers: controller.readers,
            publishers: controller.publishers,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct LatestState {
    /// The sample, by this machine's clock.
    pub sample: Sample,
    /// Stamp of the robot's clock, ns.
    pub stamp_ns: i64,
    pub count: u64,
}

enum States {
    Joints([DataReader<JointState>; 2]),
    Low(DataReader<LowState>),
}

/// Messages that the robot gets, and whether it follows them.
enum Sender {
    Curves(Curves),
    Stream(Stream),
}

pub struct Connection {
    joint_names: Vec<String>,
    prefer_difference: bool,
    delay_ns: u64,
    controllers: Vec<Controller>,
    hands: Hands,
    states: States,
    motors: Vec<Motor>,
    /// None for a robot of ROS, which holds itself.
    gravity: Option<Gravity>,
    emergency: Option<EmergencyStop>,
    description: Option<DataReader<Text>>,
    builtin: Subscriber,
    pub clock: RobotClock,
    pub latest: Option<LatestState>,
    /// Sentence on the last joint state that was not complete.
    pub incomplete: Option<String>,
    pub rejected_stamps: u64,
    /// The emergency stop is pressed. None before the first message, and once its publisher left.
    pub pressed: Option<bool>,
    pub urdf: Option<String>,
    /// Robot type that `rt/lowstate` reports.
    pub mode_machine: Option<u8>,
    sender: Sender,
    /// The participant that reports the joint states.
    reporter: Option<[u8; 16]>,
    members: [Member; 2],
    looked: Stamp,
    participants: usize,
}

impl Connection {
    /// Joins the robot's domain. With `sends`, it may send.
    pub fn open(model: &Model, settings: &Ros2Settings, interface: SetpointKind, sends: bool) -> Result<Self, String> {
        let members = join_domain(settings)?;
        let publisher = members[0].participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS);
        let publisher = publisher.map_err(failed("publisher"))?;
        let (joints, order) = (model.joint_mask(), (0..model.count).collect());
        let all = [robot::Controller { name: "arm_sdk".into(), joints, order }];
        let named = if interface == SetpointKind::ArmSdk { &all } else { model.controllers.as_slice() };
        let open = |one| Controller::open(model, one, interface, &members, sends.then_some(&publisher));
        let controllers = named.iter().map(open).collect::<Result<_, _>>()?;
        let hands = Hands::open(model, interface, &members, sends.then_some(&publisher))?;
        let emergency = (!settings.emergency_stop_topic.is_empty())
            .then(|| EmergencyStop::open(&members[0], &settings.emergency_stop_topic))
            .transpose()?;
        let is_ros = interface != SetpointKind::ArmSdk;
        let describe =
            || readers(&members[0], "/robot_description", [transient_local_qos()]).map(|[description]| description);
        let states = if is_ros {
            States::Joints(reader_pair(&members, &settings.joint_states_topic)?)
        } else {
            // At 500 Hz a lost state is no matter.
            let [low] = readers(&members[0], "/lowstate", [best_effort_qos()])?;
            States::Low(low)
        };
        let (a_max, delay_ns) = (model.limits.map(|limits| limits.a_max), (settings.delay_ms * 1e6) as u64);
        let sender = match interface {
            SetpointKind::Trajectories => Sender::Curves(Curves::new(model.count, delay_ns, a_max)),
            _ => Sender::Stream(Stream::new(model.count, period_ticks(interface), !is_ros, a_max)),
        };
        Ok(Self {
            joint_names: model.joint_names.clone(),
            prefer_difference: false,
            delay_ns,
            controllers,
            hands,
            states,
            motors: model.driver.motors.clone(),
            gravity: (!is_ros).then(|| Gravity::new(model)),
            emergency,
            description: is_ros.then(describe).transpose()?,
            builtin: members[0].participant.get_builtin_subscriber(),
            clock: RobotClock::default(),
            latest: None,
            incomplete: None,
            rejected_stamps: 0,
            pressed: None,
            urdf: None,
            mode_machine: None,
            sender,
            reporter: None,
            members,
            looked: Stamp::NONE,
            participants: 0,
        })
    }

    /// Takes what arrived. Returns true if a new complete joint state is among it.
    pub fn receive(&mut self, now: Stamp) -> bool {
        let mut is_new = false;
        let joints = |states: &DataReader<JointState>| {
            states.take(TAKEN_MAX, ANY_SAMPLE_STATE, ANY_VIEW_STATE, ANY_INSTANCE_STATE).unwrap_or_default()
        };
        let (states, lows) = match &self.states {
            States::Joints(states) => (states.each_ref().map(joints).into_iter().flatten().collect(), Vec::new()),
            States::Low(states) => (Vec::new(), take_messages(states)),
        };
        // A state that came twice is older than itself.
        for sample in states {
            let from: [u8; 16] = sample.sample_info.publication_handle.into();
            // A robot that started again is another one: its driver must start again, too.
            if let Some(state) = sample.data
                && self.reporter.is_none_or(|reporter| reporter == from)
                && self.receive_joint_state(&state, now)
            {
                (is_new, self.reporter) = (true, Some(from));
            }
        }
        for state in lows {
            is_new |= self.receive_low_state(&state, now);
        }
        if let (true, Some(heard), Sender::Stream(stream)) = (is_new, &self.latest, &mut self.sender) {
            stream.compare(&heard.sample, &self.joint_names);
        }
        self.receive_controllers(now);
        self.hands.receive(now);
        if let Some(emergency) = &mut self.emergency {
            emergency.receive();
        }
        if let Some(text) = self.description.as_ref().and_then(|description| take_messages(description).pop()) {
            self.urdf = Some(text.data);
        }
        if now.since(self.looked) >= LOOK_NS {
            self.looked = now;
            let all = self.controllers.iter_mut().chain(self.hands.controllers());
            self.participants =
                discovery::count_endpoints(&self.builtin, &self.members[0], all, self.emergency.as_mut());
        }
        self.pressed = self.emergency.as_ref().and_then(EmergencyStop::pressed);
        is_new
    }

    /// Stops listening to what only the preflight needs.
    pub fn forget_description(&mut self) {
        if let Some(description) = self.description.take() {
            // An error leaves a reader that nobody asks.
            let _ = self.members[0].subscriber.delete_datareader(&description);
        }
    }

    fn receive_controllers(&mut self, now: Stamp) {
        let Sender::Curves(curves) = &mut self.sender else { return };
        for controller in &mut self.controllers {
            let Some(states) = &controller.states else { continue };
            for state in states.each_ref().map(take_messages).into_iter().flatten() {
                controller.last_message = Some(now);
                let place = |name: &String| state.joint_names.iter().position(|other| other == name);
                let places: Vec<Option<usize>> = controller.joint_names.iter().map(place).collect();
                let all = places.iter().all(Option::is_some);
                controller.other_joints = !all || state.joint_names.len() != controller.joint_names.len();
                // A stamp that is not believed shows neither a motion nor a rest.
                let Some(at) = self.clock.here(state.header.stamp.ns()).map(|at| at.min(now)) else { continue };
                let joints = (0..JOINTS_MAX).filter(|j| controller.joints & 1 << j != 0);
                for (j, place) in joints.zip(places) {
                    let positions = &state.reference.positions;
                    let q = place.and_then(|place| positions.get(place)).copied().unwrap_or(f64::NAN);
                    curves.receive(j, &self.joint_names[j], q, at);
                }
            }
        }
    }

    fn depart(&mut self, why: String) {
        match &mut self.sender {
            Sender::Curves(curves) => curves.depart(why),
            Sender::Stream(stream) => stream.depart(why),
        }
    }

    /// Why the robot does not follow. None while it executes what it is sent.
    pub fn departed(&self) -> Option<&str> {
        match &self.sender {
            Sender::Curves(curves) => curves.departed(),
            Sender::Stream(stream) => stream.departed(),
        }
    }

    /// Positions at which the robot is held: the controllers' own setpoints, or what they were sent. Before that, the measured
    /// posture. In rad or m.
    pub fn held(&self) -> [f64; JOINTS_MAX] {
        match (&self.sender, &self.latest) {
            (Sender::Curves(curves), _) => curves.held(),
            (Sender::Stream(stream), Some(heard)) if stream.is_released() && stream.departed().is_none() => {
                heard.sample.q
            }
            (Sender::Stream(stream), _) => *stream.held(),
        }
    }

    /// True if controllers publish their own state.
    pub const fn has_states(&self) -> bool {
        matches!(self.sender, Sender::Curves(_))
    }

    /// Words on a robot that departed.
    pub const fn consequence(&self) -> &'static str {
        match (self.has_states(), self.gravity.is_some()) {
            (true, _) => "nothing is sent to the robot",
            (_, true) => "the robot is stopped, and its arms are given back",
            (_, false) => "the robot is stopped and held",
        }
    }

    /// True if somebody else is in the domain, whatever it publishes.
    pub const fn has_company(&self) -> bool {
        self.participants > self.members.len()
    }

    /// True if the robot has a description and controllers of ROS.
    pub const fn is_ros(&self) -> bool {
        matches!(self.states, States::Joints(_))
    }

    fn receive_joint_state(&mut self, state: &JointState, now: Stamp) -> bool {
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
        let is_newer = self.receive_sample(state.header.stamp.ns(), q, dq, now);
        if is_newer {
            self.hands.measure(state, now);
        }
        is_newer
    }

    /// Takes a complete state. Returns true if it is newer than the one before, and its stamp is believed.
    fn receive_sample(&mut self, stamp_ns: i64, q: [f64; JOINTS_MAX], mut dq: [f64; JOINTS_MAX], now: Stamp) -> bool {
        if !self.clock.receive(stamp_ns, now) {
            self.rejected_stamps += 1;
            if self.clock.offset_ns().is_none() {
                // The clock is taken again from the next stamp on.
                self.latest = None;
                self.depart("the robot's clock jumped".to_owned());
                if let Sender::Curves(curves) = &mut self.sender {
                    curves.lose_clock(now);
                }
            }
            return false;
        }
        if self.latest.as_ref().is_some_and(|heard| stamp_ns <= heard.stamp_ns) {
            return false;
        }
        let measured = self.clock.here(stamp_ns).map_or(now, |here| here.min(now));
        // A robot may report no velocities. Then they are the differences of its positions.
        self.prefer_difference |= dq[..self.joint_names.len()].iter().any(|dq| !dq.is_finite());
        let before = self.latest.as_ref();
        if self.prefer_difference {
            let since_s = before.map_or(0.0, |before| (stamp_ns - before.stamp_ns) as f64 * 1e-9);
            dq = std::array::from_fn(|j| match before {
                Some(before) if since_s > 0.0 => (q[j] - before.sample.q[j]) / since_s,
                _ => 0.0,
            });
        }
        let count = before.map_or(0, |before| before.count) + 1;
        self.latest = Some(LatestState { sample: Sample { measured, q, dq }, stamp_ns, count });
        true
    }

    pub fn controllers(&self, now: Stamp) -> Vec<ControllerStatus> {
        self.controllers.iter().map(|controller| ControllerStatus::new(controller, now)).collect()
    }

    /// The messages of a command, one for each controller. None while the robot's clock is not known. A robot with a weight
    /// would get the weight 0.
    pub fn messages(&self, command: &Command) -> Option<Vec<Message>> {
        let position = Position { q: command.motion.q, weight: 0.0 };
        let message = |controller: &Controller| match &self.sender {
            Sender::Curves(curves) => self.trajectory(curves, controller, command),
            Sender::Stream(_) => Some(self.position(controller, &position)),
        };
        self.controllers.iter().map(message).collect()
    }

    fn trajectory(&self, curves: &Curves, controller: &Controller, command: &Command) -> Option<Message> {
        let (first, points) = curves.points(command, controller.joints);
        let stamp_ns = self.clock.there_ns(first.plus_ns(self.delay_ns))?;
        Some(Message::Trajectory(JointTrajectory {
            header: Header { stamp: Time::from_ns(stamp_ns), frame_id: String::new() },
            joint_names: controller.joint_names.clone(),
            points: points.into_iter().map(Into::into).collect(),
        }))
    }

    fn position(&self, controller: &Controller, Position { q, weight }: &Position) -> Message {
        let Some(gravity) = &self.gravity else {
            let data = controller.order.iter().map(|&j| q[j]).collect();
            let layout = MultiArrayLayout { dim: Vec::new(), data_offset: 0 };
            return Message::Positions(Float64MultiArray { layout, data });
        };
        let mode_machine = self.mode_machine.unwrap_or_default();
        Message::ArmSdk(Box::new(LowCmd::new(mode_machine, &self.motors, q, &gravity.torques(q), *weight)))
    }

    /// Sends what is due after the last of `commands`. The others came too late. Returns false if the robot does not follow.
    pub fn send(&mut self, commands: &[Command], now: Stamp) -> bool {
        let pressed = if self.emergency.is_none() { Some(false) } else { self.pressed };
        let active = self.controllers(now).iter().all(|seen| seen.active && !seen.other_joints)
            && (!self.has_states() || self.clock.is_settled(now));
        match &mut self.sender {
            Sender::Curves(curves) => {
                let Some(command) = commands.last() else { return curves.follows() };
                let joints = self.controllers.iter().fold(0, |all, controller| all | controller.joints);
                if !curves.prepare(commands, &curves::Observation { now, joints, active, pressed }) {
                    return false;
                }
                let Some(messages) = self.messages(command) else { return false };
                self.write(messages);
                if let Sender::Curves(curves) = &mut self.sender {
                    curves.sent(command);
                }
                true
            }
            Sender::Stream(stream) => {
                let sample = self.latest.as_ref().map(|heard| &heard.sample);
                let position = stream.next(commands, &stream::Observation { now, sample, pressed });
                let follows = stream.follows();
                if let Some(position) = position {
                    self.write(self.controllers.iter().map(|one| self.position(one, &position)).collect());
                }
                follows
            }
        }
    }

    fn write(&self, messages: Vec<Message>) {
        for (controller, message) in self.controllers.iter().zip(messages) {
            if let Some(writer) = &controller.writer {
                writer.write(message);
            }
        }
    }

    /// Notes at `now` that the robot fell silent, if it did.
    pub fn check_silence(&mut self, now: Stamp) {
        let states = self.latest.as_ref().is_some_and(|heard| now.since(heard.sample.measured) <= CONTROLLER_SILENT_NS);
        if states && self.controllers(now).iter().all(|seen| seen.active) {
            return;
        }
        match &mut self.sender {
            Sender::Curves(curves) => curves.fall_silent(),
            Sender::Stream(stream) => stream.depart("the robot fell silent".to_owned()),
        }
    }

    /// Takes the robot over at the measured posture, and returns when it follows. A weight takes 5 s to rise. The error says
    /// why the robot did not stay there. It has been given back then.
    pub fn begin(&mut self) -> Result<(), String> {
        let (Sender::Stream(stream), Some(heard)) = (&mut self.sender, &self.latest) else { return Ok(()) };
        stream.begin(&heard.sample.q, rt::now());
        self.run_until(|stream| stream.follows() || stream.is_released());
        let why = self.departed().map(|why| format!("the robot was not taken over: {why}"));
        why.map_or(Ok(()), Err)
    }

    /// Stops the robot if nobody in it does, and gives it back.
    pub fn end(&mut self) {
        if let Sender::Stream(stream) = &mut self.sender {
            stream.end();
            self.run_until(Stream::is_released);
        }
    }

    /// Hears and sends without the loop, until the stream is so.
    fn run_until(&mut self, until: impl Fn(&Stream) -> bool) {
        while let Sender::Stream(stream) = &self.sender
            && !until(stream)
        {
            let now = rt::now();
            self.receive(now);
            self.check_silence(now);
            self.send(&[], now);
            rt::sleep_until(now.plus_ns(TURN_NS));
        }
    }
}
