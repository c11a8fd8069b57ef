//! The only wrapper between our messages and the transport's marker trait.
#![allow(unsafe_code)]

use iceoryx2::prelude::ZeroCopySend;
use messages::{Message, TypeName};
use std::fmt;

/// A message as it lies in shared memory.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Payload<M>(pub(crate) M);

impl<M: Message> Payload<M> {
    const TYPE_NAME: &'static TypeName = &M::TYPE_NAME;
}

impl<M: Message> fmt::Debug for Payload<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Self::TYPE_NAME.as_str())
    }
}

// SAFETY: a `Message` is `Copy`, `'static` and `repr(C)`. It consists of explicit-width numbers and arrays of
// them, without padding (asserted at compile time where it is declared). So it holds no pointer or handle, every
// process sees the same layout, and every bit pattern is a valid value. The name carries version and layout hash,
// so equal names mean equal layouts.
unsafe impl<M: Message> ZeroCopySend for Payload<M> {
    unsafe fn type_name() -> &'static str {
        Self::TYPE_NAME.as_str()
    }
}
