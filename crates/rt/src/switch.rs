//! A switch that two signals turn, for a process that simulates a button.

use crate::error::RtError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A switch. SIGUSR1 turns it on, SIGUSR2 turns it off.
#[derive(Clone, Debug, Default)]
pub struct Switch {
    on: Arc<AtomicBool>,
    off: Arc<AtomicBool>,
}

impl Switch {
    /// Listens to the two signals.
    pub fn on_signals() -> Result<Self, RtError> {
        let switch = Self::default();
        for (signal, flag) in [(libc::SIGUSR1, &switch.on), (libc::SIGUSR2, &switch.off)] {
            signal_hook::flag::register(signal, Arc::clone(flag))
                .map_err(|source| RtError::Signal { signal, source })?;
        }
        Ok(switch)
    }

    /// Returns the new position, if the switch was turned since the last call. Off wins if both signals came.
    pub fn turned(&self) -> Option<bool> {
        let on = self.on.swap(false, Ordering::Relaxed).then_some(true);
        self.off.swap(false, Ordering::Relaxed).then_some(false).or(on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_signal_turns_the_switch_once() {
        let switch = Switch::on_signals().expect("handlers can be installed");
        assert_eq!(switch.turned(), None);
        for (signal, position) in [(libc::SIGUSR1, true), (libc::SIGUSR2, false)] {
            signal_hook::low_level::raise(signal).expect("a process may signal itself");
            assert_eq!((switch.turned(), switch.turned()), (Some(position), None));
        }
    }
}
