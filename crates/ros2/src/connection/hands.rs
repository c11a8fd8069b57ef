//! The grippers' topics: what their controllers and the joint states say, and the messages that they get.

use super::{Connection, ControllerStatus};
use crate::curves::BEFORE_NS;
use crate::dds::{Controller, Member, Message, take_messages};
use crate::hands::{Hand, Observation};
use crate::ros::{Header, JointState, JointTrajectory, Time};
use dust_dds::publication::publisher::Publisher;
use messages::{GripperMotion, GripperState, Layout, Stamp, tick_at};
use robot::{Model, SetpointKind};

struct DrivenHand {
    side: usize,
    hand: Hand,
    controller: Controller,
}

impl DrivenHand {
    /// Why it can be sent nothing at `now`.
    fn hindrance(&self, missing: Option<&str>, now: Stamp) -> Option<String> {
        missing.map(str::to_owned).or_else(|| ControllerStatus::new(&self.controller, now).fault(true))
    }
}

/// The hands of one robot. Empty for a robot without trajectory controllers, and for one without grippers.
#[derive(Default)]
pub(super) struct Hands {
    all: Vec<DrivenHand>,
    /// Why the description does not allow the grippers.
    refused: Option<String>,
    /// Why the newest joint state did not have all fingers.
    lacking: Option<String>,
}

impl Hands {
    pub(super) fn open(
        model: &Model,
        interface: SetpointKind,
        members: &[Member; 2],
        publisher: Option<&Publisher>,
    ) -> Result<Self, String> {
        let mut all = Vec::new();
        for (side, gripper) in model.grippers.iter().enumerate() {
            let Some(gripper) = gripper.as_ref().filter(|gripper| !gripper.controller.is_empty()) else { continue };
            if interface != SetpointKind::Trajectories {
                continue;
            }
            let names = gripper.fingers.iter().map(|finger| finger.joint.clone()).collect();
            let controller = Controller::of_fingers(&gripper.controller, names, members, publisher)?;
            all.push(DrivenHand { side, hand: Hand::new(side, gripper.clone()), controller });
        }
        let lacking = Some("joint_states has not named the fingers yet".to_owned());
        Ok(Self { all, refused: None, lacking })
    }

    /// Why no hand can be driven.
    fn missing(&self) -> Option<&str> {
        self.refused.as_deref().or(self.lacking.as_deref())
    }

    pub(super) fn controllers(&mut self) -> impl Iterator<Item = &mut Controller> {
        self.all.iter_mut().map(|own| &mut own.controller)
    }

    /// Takes the robot's own description. It must have each finger, with limits that hold its open and closed positions.
    pub(super) fn describe(&mut self, urdf: Option<&str>) {
        let robot = urdf.and_then(|urdf| robot::read_urdf("/robot_description", urdf).ok());
        for own in &mut self.all {
            let mut efforts = Vec::new();
            for finger in own.hand.fingers() {
                let mut joints = robot.iter().flat_map(|robot| &robot.joints);
                let name = &finger.joint;
                let Some(limit) = joints.find(|joint| joint.name == *name).map(|joint| &joint.limit) else {
                    self.refused = Some(format!("/robot_description has no joint `{name}`"));
                    return;
                };
                let holds = |q: f64| (limit.lower - 1e-6..=limit.upper + 1e-6).contains(&q);
                if !(holds(finger.open) && holds(finger.closed)) {
                    self.refused = Some(format!(
                        "/robot_description lets `{name}` go from {} to {}, the robot file from {} to {}",
                        limit.lower, limit.upper, finger.open, finger.closed
                    ));
                    return;
                }
                efforts.push(limit.effort);
            }
            let known = efforts.iter().all(|effort| effort.is_finite() && *effort > 0.0);
            own.hand.limit(if known { efforts } else { Vec::new() });
        }
    }

    pub(super) fn measure(&mut self, state: &JointState, now: Stamp) {
        self.lacking = None;
        for own in &mut self.all {
            let names = &own.controller.joint_names;
            let place = |name: &String| state.name.iter().position(|other| other == name);
            let places: Vec<Option<usize>> = names.iter().map(place).collect();
            let at = |values: &[f64]| -> Option<Vec<f64>> {
                let value = |place: &Option<usize>| values.get((*place)?).copied().filter(|value| value.is_finite());
                places.iter().map(value).collect()
            };
            match at(&state.position) {
                Some(q) => own.hand.measure(&q, &at(&state.effort).unwrap_or_default(), now),
                None => {
                    let missing = names.iter().zip(&places).find(|(_, place)| place.is_none());
                    let name = missing.map_or(&names[0], |(name, _)| name);
                    self.lacking = Some(format!("joint_states has no position of `{name}`"));
                }
            }
        }
    }

    pub(super) fn receive(&mut self, now: Stamp) {
        for DrivenHand { hand, controller, .. } in &mut self.all {
            let Some(states) = &controller.states else { continue };
            for state in states.each_ref().map(take_messages).into_iter().flatten() {
                controller.last_message = Some(now);
                let q = |name: &String| {
                    let place = state.joint_names.iter().position(|other| other == name)?;
                    state.reference.positions.get(place).copied()
                };
                let reference: Option<Vec<f64>> = controller.joint_names.iter().map(q).collect();
                controller.other_joints =
                    reference.is_none() || state.joint_names.len() != controller.joint_names.len();
                hand.receive(&reference.unwrap_or_default(), now);
            }
        }
    }
}

impl Connection {
    pub fn describe_hands(&mut self) {
        self.hands.describe(self.urdf.as_deref());
    }

    /// The grippers at `now`. None if one of them does not show all that belongs to it.
    pub fn gripped(&self, now: Stamp) -> Option<GripperState> {
        let mut state = GripperState::ZERO;
        if self.hands.all.is_empty() || self.hands.refused.is_some() || self.hands.lacking.is_some() {
            return None;
        }
        for own in &self.hands.all {
            [state.closure[own.side], state.force_n[own.side], state.setpoint[own.side]] = own.hand.state(now)?;
        }
        Some(state)
    }

    /// Sends the grippers what is due at index `k`. `follows` says that the arms were sent theirs.
    pub fn grip(&mut self, k: u64, motion: Option<&GripperMotion>, follows: bool, now: Stamp) {
        let before_ticks = tick_at(Stamp(self.delay_ns + BEFORE_NS));
        let Hands { all, refused, lacking } = &mut self.hands;
        let none = refused.as_deref().or(lacking.as_deref());
        for own in all {
            if let Some(why) = own.hindrance(none, now) {
                own.hand.leave(why);
                continue;
            }
            let Some(motion) = motion else { continue };
            let Some((first, points)) = own.hand.next(k, motion, &Observation { now, follows, before_ticks }) else {
                continue;
            };
            let Some(stamp_ns) = self.clock.there_ns(first.plus_ns(self.delay_ns)) else { continue };
            if let Some(writer) = &own.controller.writer {
                writer.write(Message::Trajectory(JointTrajectory {
                    header: Header { stamp: Time::from_ns(stamp_ns), frame_id: String::new() },
                    joint_names: own.controller.joint_names.clone(),
                    points: points.into_iter().map(Into::into).collect(),
                }));
            }
        }
    }

    /// Each hand's controller, and why it could be sent nothing at `now`. A preflight sends nothing to any.
    pub fn hindered_hands(&self, now: Stamp) -> impl Iterator<Item = (&str, Option<String>)> {
        let none = self.hands.missing();
        self.hands.all.iter().map(move |own| (own.controller.name.as_str(), own.hindrance(none, now)))
    }

    /// Each hand's controller, and why nothing is sent to it. None while it is sent what is commanded.
    pub fn hands(&self) -> impl Iterator<Item = (&str, Option<&str>)> {
        self.hands.all.iter().map(|own| (own.controller.name.as_str(), own.hand.idle()))
    }
}
