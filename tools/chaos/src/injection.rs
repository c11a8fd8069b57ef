//! Draws each fault from a seed: its target, its kind and its moment.

use config::SafetySettings;
use messages::TICK_HZ;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::time::Duration;

/// Shortest and longest suspension: 1.5 ticks, and more than the longest detection and stop together.
const SUSPENDED_MS: [f64; 2] = [1.0, 2000.0];
/// Latest moment of a fault after Engaging began, or after Engaged, s.
const PHASE_MAX_S: [f64; 2] = [1.5, 1.0];
/// Longest time that the enable stays held after a process died, ms. The process is back by then.
const HELD_ON_MAX_MS: f64 = 300.0;
/// Longest stop, ms. `limits.stop_time_max_ms` of every robot file may not exceed it.
const STOP_MS: f64 = 500.0;

messages::named! {
    /// Targets of faults, the driver last. The name of a process of teleopd is its subcommand.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Target {
        Ingest => "ingest",
        Retarget => "retarget",
        Control => "control",
        /// The client that publishes skeletons.
        Client => "client",
        /// The operator's program, which holds the enable.
        Operator => "operator",
        Driver => "driver",
    }
}

impl Target {
    /// Ticks from the fault until the robot must be at rest. It is the sum of the detection time, the longest
    /// stop, and two ticks for messages under way. On a machine that is not real-time, the detection time of
    /// the 1500 Hz streams is `factor` times longer.
    pub fn rest_within_ticks(self, safety: &SafetySettings, factor: f64) -> u64 {
        let noticed_ms = match self {
            // The clip loops at 60 Hz or faster, and resampling adds nothing to the age.
            Self::Ingest | Self::Client => safety.input_stale_ms,
            Self::Retarget => safety.target_stale_ms * factor,
            Self::Control => 0.0,
            Self::Operator => safety.operator_silent_ms,
            Self::Driver => safety.state_stale_ms * factor,
        };
        ((noticed_ms + STOP_MS) * 1e-3 * TICK_HZ as f64).ceil() as u64 + 2
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// SIGKILL. The process restarts while the enable stays held for `held_on`.
    Kill { held_on: Duration },
    /// SIGSTOP, and SIGCONT after `length`.
    Suspend { length: Duration },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    pub target: Target,
    pub kind: Kind,
    /// True if the fault waits until the robot is engaged.
    pub engaged: bool,
    /// Time from Engaging, or from Engaged, to the fault.
    pub phase: Duration,
}

impl Injection {
    /// Draws a fault for `target`. A share `engaged_share` of all draws waits until the robot is engaged.
    pub fn draw(target: Target, kill: bool, engaged_share: f64, dice: &mut Pcg64Mcg) -> Self {
        let mut uniform = || dice.random::<f64>();
        let engaged = uniform() < engaged_share;
        let phase = Duration::from_secs_f64(uniform() * PHASE_MAX_S[usize::from(engaged)]);
        let kind = if kill {
            Kind::Kill { held_on: Duration::from_secs_f64(uniform() * HELD_ON_MAX_MS * 1e-3) }
        } else {
            // The distribution is uniform in the logarithm: half of them are below 45 ms.
            let [low, high] = SUSPENDED_MS;
            Kind::Suspend { length: Duration::from_secs_f64(low * (high / low).powf(uniform()) * 1e-3) }
        };
        Self { target, kind, engaged, phase }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn injections_are_drawn_from_the_seed_within_their_bounds() {
        let draw = |seed| {
            let mut dice = Pcg64Mcg::seed_from_u64(seed);
            (0..1000).map(|n| Injection::draw(Target::ALL[n % 6], n % 2 == 0, 0.5, &mut dice)).collect::<Vec<_>>()
        };
        let faults = draw(1);
        assert_eq!(faults, draw(1));
        assert_ne!(faults, draw(2));
        assert!(faults.iter().any(|fault| fault.engaged) && faults.iter().any(|fault| !fault.engaged));
        for fault in faults {
            assert!(fault.phase.as_secs_f64() <= PHASE_MAX_S[usize::from(fault.engaged)]);
            match fault.kind {
                Kind::Kill { held_on } => assert!(held_on.as_secs_f64() <= HELD_ON_MAX_MS * 1e-3),
                Kind::Suspend { length } => {
                    let ms = length.as_secs_f64() * 1e3;
                    assert!((SUSPENDED_MS[0] - 1e-6..=SUSPENDED_MS[1] + 1e-6).contains(&ms));
                }
            }
        }
    }
}
