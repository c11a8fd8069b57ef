//! The changes to the settings that a block needs.

use crate::blocks::Kind;
use crate::cli::{Pin, Policy};
use messages::TICK_HZ;

/// Driver grace of the polled variant. Two half ticks would be 667 us. This is the longest value that the
/// settings allow, and favours polling by 7 us.
const POLLED_DRIVER_GRACE_US: f64 = 660.0;

/// Changes that the command line makes to the settings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Changes {
    pub policy: Option<Policy>,
    pub pin: Option<Pin>,
}

impl Changes {
    /// Returns the changes that a block of `kind` needs, as TOML. In the polled variant every process runs half a
    /// tick after its predecessor. That is the mean wait of timers that are not synchronised.
    pub fn toml(&self, kind: Kind) -> String {
        let mut lines =
            vec![format!("realtime.hand_off = \"{}\"", if kind == Kind::Polled { "polled" } else { "events" })];
        if kind == Kind::Polled {
            let half_us = (5e5 / TICK_HZ as f64).floor();
            lines.push(format!("control.grace_us = {half_us:?}"));
            lines.push(format!("driver.grace_us = {POLLED_DRIVER_GRACE_US:?}"));
        }
        if let Some(policy) = self.policy {
            lines.push(format!("realtime.policy = \"{}\"", if policy == Policy::Fifo { "fifo" } else { "other" }));
        }
        match &self.pin {
            Some(Pin::Free) => lines.push("realtime.cores = \"free\"".to_owned()),
            Some(Pin::Cores(cores)) => lines.push(format!("realtime.cores = {cores:?}")),
            None => {}
        }
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Overrides;

    fn loaded(changes: &Changes, kind: Kind) -> config::Settings {
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("teleop.toml");
        harness::write_settings(&harness::config(), &changes.toml(kind), &copy).expect("the settings of this tree");
        config::load(&copy, Overrides::default()).expect("the copy is a settings file").settings
    }

    #[test]
    fn settings_copy_differs_only_as_its_block_needs() {
        let original = config::load(&harness::config(), Overrides::default()).unwrap().settings;
        let mut events = loaded(&Changes::default(), Kind::Events);
        events.robot = original.robot.clone();
        events.weights = original.weights.clone();
        events.retarget.prediction = original.retarget.prediction.clone();
        events.ingest.lifter = original.ingest.lifter.clone();
        assert_eq!(events, original);
        let polled = loaded(&Changes::default(), Kind::Polled);
        assert_ne!(polled.realtime, original.realtime);
        assert_eq!((polled.control.grace_us, polled.driver.grace_us), (333.0, 660.0));
        assert_eq!(polled.safety, original.safety);
    }

    #[test]
    fn policy_and_cores_of_the_command_line_override_the_file() {
        let free = Changes { policy: Some(Policy::Other), pin: Some(Pin::Free) };
        assert_eq!(loaded(&free, Kind::Events).realtime.policy, config::Policy::Other);
        let pinned = Changes { policy: Some(Policy::Fifo), pin: Some(Pin::Cores(vec![0])) };
        let pinned = loaded(&pinned, Kind::Events).realtime;
        assert_eq!(pinned.policy, config::Policy::Fifo);
        assert_ne!(pinned.cores, loaded(&free, Kind::Events).realtime.cores);
    }
}
