//! The writing end of a service.

use crate::carried::WritePort;
use crate::error::PublishError;
use crate::payload::Payload;
use crate::port::Publish;
use crate::presence::Presence;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::{LoanError, SendError};
use iceoryx2::prelude::ipc;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use messages::Message;
use std::fmt;
use std::mem::MaybeUninit;
use std::sync::Arc;

type Loan<M> = SampleMutUninit<ipc::Service, MaybeUninit<Payload<M>>, ()>;

/// The one writer of a service. Publishing makes no system call. Waking readers is a separate step.
///
/// Each message costs one allocation and one release of 48 bytes in the transport (a reference count around the
/// loan). It is the one known exception to "no allocation in a tick". The writer takes the loan for the next
/// message after it has sent this one, so it never delays a message. Block and thread are always the same. So
/// glibc serves both from the thread's own cache, without a lock or a system call.
pub struct Writer<M: Message> {
    port: Box<dyn WritePort<M>>,
}

impl<M: Message> Writer<M> {
    pub(crate) fn new(port: Box<dyn WritePort<M>>) -> Self {
        Self { port }
    }

    /// Makes `message` the newest one for every reader. Returns how many readers got it.
    pub fn publish(&mut self, message: &M) -> Result<usize, PublishError> {
        self.port.publish(message)
    }

    /// Wakes every waiting reader, with one system call for each that is not awake yet.
    pub fn notify(&mut self) -> Result<(), PublishError> {
        self.port.notify()
    }
}

/// A writer over iceoryx2.
pub(crate) struct IpcWriter<M: Message> {
    // Declared first, so that it is returned before its publisher is dropped.
    in_hand: Option<Loan<M>>,
    publisher: Publisher<ipc::Service, Payload<M>, ()>,
    notifier: Notifier<ipc::Service>,
    // Declared last, so that the ports are dropped before it.
    _presence: Arc<Presence>,
}

impl<M: Message> IpcWriter<M> {
    pub(crate) fn new(
        publisher: Publisher<ipc::Service, Payload<M>, ()>,
        notifier: Notifier<ipc::Service>,
        presence: Arc<Presence>,
    ) -> Self {
        let in_hand = publisher.loan_uninit().ok();
        Self { in_hand, publisher, notifier, _presence: presence }
    }
}

impl<M: Message> WritePort<M> for IpcWriter<M> {
    fn publish(&mut self, message: &M) -> Result<usize, PublishError> {
        let loan = match self.in_hand.take() {
            Some(loan) => loan,
            None => self.publisher.loan_uninit().map_err(loan_error)?,
        };
        let sent = loan.write_payload(Payload(*message)).send();
        self.in_hand = self.publisher.loan_uninit().ok();
        sent.map_err(send_error)
    }

    fn notify(&mut self) -> Result<(), PublishError> {
        self.notifier.notify().map(drop).map_err(|_| PublishError::Wake)
    }
}

impl<M: Message> fmt::Debug for Writer<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Writer of {}", M::TYPE_NAME.as_str())
    }
}

impl<M: Message> Publish<M> for Writer<M> {
    fn publish(&mut self, message: &M) -> Result<(), PublishError> {
        Writer::publish(self, message).map(drop)
    }
}

fn loan_error(_: LoanError) -> PublishError {
    PublishError::NoMemory
}

fn send_error(error: SendError) -> PublishError {
    match error {
        SendError::LoanError(error) => loan_error(error),
        SendError::ConnectionError(_) => PublishError::Connection,
        SendError::ConnectionBrokenSinceSenderNoLongerExists
        | SendError::ConnectionCorrupted
        | SendError::UnableToDeliver
        | SendError::InternalError => PublishError::Delivery,
    }
}
