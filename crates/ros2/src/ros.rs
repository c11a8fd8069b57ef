//! The ROS 2 messages that a driver reads and writes, as DDS types, and how ROS 2 names them.
//!
//! A topic `/a` is `rt/a` in DDS. A type `p/msg/T` is `p::msg::dds_::T_`. The layouts are those of `common_interfaces`
//! and `control_msgs` of ROS 2 Humble.

use dust_dds::infrastructure::type_support::DdsType;

/// `builtin_interfaces/Time` and `builtin_interfaces/Duration`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// `sensor_msgs/JointState`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct JointState {
    pub header: Header,
    pub name: Vec<String>,
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s. Empty if the robot reports none.
    pub velocity: Vec<f64>,
    /// Torques, N m or N.
    pub effort: Vec<f64>,
}

/// `trajectory_msgs/JointTrajectoryPoint`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct JointTrajectoryPoint {
    /// Positions, rad or m.
    pub positions: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub velocities: Vec<f64>,
    /// Empty: the curve is a cubic.
    pub accelerations: Vec<f64>,
    pub effort: Vec<f64>,
    /// Time since the stamp of the trajectory.
    pub time_from_start: Time,
}

impl From<crate::trajectory::Point> for JointTrajectoryPoint {
    fn from(point: crate::trajectory::Point) -> Self {
        let (accelerations, effort) = (Vec::new(), Vec::new());
        let time_from_start = Time::from_ns(point.since_first_ns as i64);
        Self { positions: point.positions, velocities: point.velocities, accelerations, effort, time_from_start }
    }
}

/// `trajectory_msgs/JointTrajectory`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct JointTrajectory {
    /// Its stamp is the time of the trajectory's beginning.
    pub header: Header,
    pub joint_names: Vec<String>,
    pub points: Vec<JointTrajectoryPoint>,
}

/// The beginning of `control_msgs/JointTrajectoryControllerState`. What follows differs between releases.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct ControllerState {
    pub header: Header,
    pub joint_names: Vec<String>,
    /// The controller's own setpoint. Older releases call it `desired`.
    pub reference: JointTrajectoryPoint,
}

/// `std_msgs/MultiArrayDimension`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct MultiArrayDimension {
    pub label: String,
    pub size: u32,
    pub stride: u32,
}

/// `std_msgs/MultiArrayLayout`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct MultiArrayLayout {
    /// Empty: a list.
    pub dim: Vec<MultiArrayDimension>,
    pub data_offset: u32,
}

/// `std_msgs/Float64MultiArray`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct Float64MultiArray {
    pub layout: MultiArrayLayout,
    /// Positions in the order of the controller's joints, rad or m.
    pub data: Vec<f64>,
}

/// `std_msgs/Bool`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct Bool {
    pub data: bool,
}

/// `std_msgs/String`.
#[derive(Clone, Debug, DdsType, PartialEq)]
pub struct Text {
    pub data: String,
}

pub trait RosType {
    const NAME: &'static str;
}

macro_rules! named {
    ($($message:ty: $name:literal,)*) => { $(impl RosType for $message { const NAME: &'static str = $name; })* };
}

named! {
    JointState: "sensor_msgs::msg::dds_::JointState_",
    JointTrajectory: "trajectory_msgs::msg::dds_::JointTrajectory_",
    ControllerState: "control_msgs::msg::dds_::JointTrajectoryControllerState_",
    Float64MultiArray: "std_msgs::msg::dds_::Float64MultiArray_",
    Bool: "std_msgs::msg::dds_::Bool_",
    Text: "std_msgs::msg::dds_::String_",
}

pub fn topic(ros: &str) -> String {
    format!("rt/{}", ros.trim_start_matches('/'))
}

impl Time {
    pub fn from_ns(ns: i64) -> Self {
        let (sec, nanosec) = (ns.div_euclid(1_000_000_000), ns.rem_euclid(1_000_000_000));
        Self { sec: sec.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32, nanosec: nanosec as u32 }
    }

    pub fn ns(&self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_convert_there_and_back() {
        for ns in [0, 1, -1, 999_999_999, 1_000_000_000, -1_500_000_000, 1_795_000_000_123_456_789] {
            assert_eq!(Time::from_ns(ns).ns(), ns);
        }
        assert!(Time::from_ns(-1).nanosec == 999_999_999 && Time::from_ns(-1).sec == -1);
    }

    #[test]
    fn topics_have_the_prefix_of_ros() {
        assert_eq!(topic("/joint_states"), "rt/joint_states");
        assert_eq!(topic("arm/joint_trajectory"), "rt/arm/joint_trajectory");
    }
}
