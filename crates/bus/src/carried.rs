//! Messages that services carry. The transport is generic over its messages, and large. Its code for each message
//! is made here once, behind `dyn`, and not again in every program.

use crate::domain::Domain;
use crate::error::{BusError, PublishError};
use crate::reader::Sample;
use messages::{
    Feedback, InputStatus, JointCommand, JointTarget, Joints, Message, PolicyChunk, RawSkeleton, RobotMeasured,
    RobotSetpoint, RobotState, Service, Skeleton, Status,
};

/// The writing end of a service.
pub trait WritePort<M> {
    /// Does the same as `Writer::publish`.
    fn publish(&mut self, message: &M) -> Result<usize, PublishError>;
    /// Does the same as `Writer::notify`.
    fn notify(&mut self) -> Result<(), PublishError>;
}

/// The reading end of a service.
pub trait ReadPort<M> {
    /// Returns the next message that has not been read. The error means that a writer could not be connected.
    fn receive(&mut self) -> Result<Option<Sample<M>>, Unconnected>;
}

/// Returned when a writer could not be connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unconnected;

/// A message that a service carries. [`carried`](crate::carried) implements it.
pub trait Carried: Message {
    #[doc(hidden)]
    fn write_port(domain: &Domain, service: Service) -> Result<Box<dyn WritePort<Self>>, BusError>;
    #[doc(hidden)]
    fn read_port(domain: &Domain, service: Service) -> Result<Box<dyn ReadPort<Self>>, BusError>;
}

/// Implements `Carried` for messages. So their ports are compiled in the crate that calls it.
#[macro_export]
macro_rules! carried {
    ($($message:ty),* $(,)?) => {$(
        impl $crate::Carried for $message {
            #[inline(never)]
            fn write_port(
                domain: &$crate::Domain,
                service: ::messages::Service,
            ) -> Result<Box<dyn $crate::WritePort<Self>>, $crate::BusError> {
                domain.make_write_port(service)
            }

            #[inline(never)]
            fn read_port(
                domain: &$crate::Domain,
                service: ::messages::Service,
            ) -> Result<Box<dyn $crate::ReadPort<Self>>, $crate::BusError> {
                domain.make_read_port(service)
            }
        }
    )*};
}

carried!(
    RawSkeleton,
    Skeleton,
    JointTarget,
    JointCommand,
    RobotState,
    Status,
    InputStatus,
    RobotSetpoint,
    RobotMeasured,
    Feedback,
    PolicyChunk,
    Joints
);
