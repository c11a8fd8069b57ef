//! The one table of services: name, writer, rate, and the silence that is a fault.

/// Shared-memory domain of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Clients publish here, and `ingest` reads and answers.
    Input,
    /// Only teleopd's own processes open it.
    Core,
}

/// The services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Service {
    /// `RawSkeleton`, written by any client.
    RawSkeleton = 0,
    /// `Skeleton`, written by `ingest`.
    Skeleton = 1,
    /// `JointTarget`, written by `retarget`.
    JointTarget = 2,
    /// `JointCommand`, written by `control`.
    JointCommand = 3,
    /// `RobotState`, written by the driver.
    RobotState = 4,
    /// `Status`, written by `control`.
    Status = 5,
    /// `InputStatus`, written by `ingest`.
    InputStatus = 6,
    /// `RobotSetpoint`, written by the driver.
    RobotSetpoint = 7,
    /// `RobotMeasured`, written by the simulated robot.
    RobotMeasured = 8,
    /// `Feedback`, written by `ingest` for any client.
    Feedback = 9,
    /// `PolicyChunk`, written by any policy.
    PolicyChunk = 10,
    /// `PolicyChunk` as `ingest` passes it on.
    Policy = 11,
    /// `JointTarget` of the policy, written by `retarget` while one holds its lease.
    PolicyTarget = 12,
    /// `Joints`, written by `ingest` for any client.
    Joints = 13,
}

/// A row of the service table.
#[derive(Clone, Copy, Debug)]
pub struct ServiceRow {
    /// The service.
    pub service: Service,
    /// Name on the bus. The number at its end is the layout version.
    pub name: &'static str,
    /// Domain.
    pub domain: Domain,
    /// Process that writes it.
    pub writer: &'static str,
    /// Publishers that may exist at once.
    pub writers_max: usize,
    /// Nominal (or highest) rate.
    pub rate_hz: u32,
    /// Messages that are kept until the reader reads them. If the queue is full, the oldest is dropped.
    pub kept: usize,
    /// Silence after which readers count the writer as gone, ms. Zero if they do not. `safety` has settings of its own.
    pub stale_after_ms: u32,
}

const fn row(
    service: Service,
    name: &'static str,
    domain: Domain,
    writer: &'static str,
    writers_max: usize,
    rate_hz: u32,
    stale_after_ms: u32,
) -> ServiceRow {
    ServiceRow { service, name, domain, writer, writers_max, rate_hz, kept: 1, stale_after_ms }
}

/// Setpoints that wait for a simulated robot whose process is late, as they would in the memory of its field bus. 640 of
/// them are 427 ms, longer than `control` waits for a state without real-time scheduling. The drives of a real robot are
/// never late.
const SETPOINTS_KEPT: usize = 640;

/// The one table of services.
pub const SERVICES: [ServiceRow; 14] = [
    row(Service::RawSkeleton, "teleop/raw_skeleton/1", Domain::Input, "client", 8, 240, 0),
    row(Service::Skeleton, "teleop/skeleton/3", Domain::Core, "ingest", 1, 240, 100),
    row(Service::JointTarget, "teleop/joint_target/7", Domain::Core, "retarget", 1, 1500, 10),
    row(Service::JointCommand, "teleop/joint_command/3", Domain::Core, "control", 1, 1500, 10),
    row(Service::RobotState, "teleop/robot_state/3", Domain::Core, "driver", 1, 1500, 5),
    row(Service::Status, "teleop/status/11", Domain::Core, "control", 1, 50, 500),
    row(Service::InputStatus, "teleop/input_status/2", Domain::Core, "ingest", 1, 10, 0),
    ServiceRow {
        kept: SETPOINTS_KEPT,
        ..row(Service::RobotSetpoint, "teleop/robot_setpoint/3", Domain::Core, "driver", 1, 1500, 10)
    },
    row(Service::RobotMeasured, "teleop/robot_measured/3", Domain::Core, "robot", 1, 1000, 10),
    row(Service::Feedback, "teleop/feedback/1", Domain::Input, "ingest", 1, 20, 0),
    row(Service::PolicyChunk, "teleop/policy_chunk/1", Domain::Input, "policy", 8, 240, 0),
    row(Service::Policy, "teleop/policy/1", Domain::Core, "ingest", 1, 240, 0),
    row(Service::PolicyTarget, "teleop/policy_target/7", Domain::Core, "retarget", 1, 1500, 10),
    row(Service::Joints, "teleop/joints/2", Domain::Input, "ingest", 1, 100, 0),
];

impl Service {
    /// Returns the service whose name is that of the message that this one carries: itself, unless two carry one message.
    pub const fn namesake(self) -> Self {
        match self {
            Self::Policy => Self::PolicyChunk,
            Self::PolicyTarget => Self::JointTarget,
            own => own,
        }
    }

    /// Returns the service's row of the table.
    pub const fn row(self) -> &'static ServiceRow {
        &SERVICES[self as usize]
    }
}
