//! Who is struck, how and when: drawn from a seed.

use messages::TICK_HZ;
use pipeline::SafetySettings;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::time::Duration;

/// Shortest and longest suspension: a tick and a half, and more than the longest detection and stop together.
const SUSPENDED_MS: [f64; 2] = [1.0, 2000.0];
/// Latest moment of a blow after Engaging began, or after Engaged, s.
const PHASE_MAX_S: [f64; 2] = [1.5, 1.0];
/// Longest time that the enable is held on after a death, ms: the process is back by then.
const HELD_ON_MAX_MS: f64 = 300.0;
/// Longest stop, ms: `limits.stop_time_max_ms` of every robot file may be no more.
const STOP_MS: f64 = 500.0;

/// Who is struck.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// `ingest`.
    Ingest,
    /// `retarget`.
    Retarget,
    /// `control`.
    Control,
    /// The driver: `sim`.
    Driver,
    /// The client that publishes skeletons.
    Client,
    /// The operator's program that holds the enable.
    Operator,
}

impl Target {
    /// Everybody, the driver last.
    pub const ALL: [Self; 6] =
        [Self::Ingest, Self::Retarget, Self::Control, Self::Client, Self::Operator, Self::Driver];

    /// Name in reports; of a process of teleopd, its subcommand.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Retarget => "retarget",
            Self::Control => "control",
            Self::Driver => "sim",
            Self::Client => "client",
            Self::Operator => "operator",
        }
    }

    /// Ticks from the blow until the robot must be at rest: the time in which the silence is noticed (of the 1500 Hz
    /// streams `factor` times longer where the machine is not real-time), the longest stop, and two ticks for what is
    /// under way.
    pub fn rest_within_ticks(self, safety: &SafetySettings, factor: f64) -> u64 {
        let noticed_ms = match self {
            // A looped clip of 60 Hz or faster; resampling adds nothing to the age.
            Self::Ingest | Self::Client => safety.input_stale_ms,
            Self::Retarget => safety.target_stale_ms * factor,
            Self::Control => 0.0,
            Self::Operator => safety.operator_silent_ms,
            Self::Driver => safety.state_stale_ms * factor,
        };
        ((noticed_ms + STOP_MS) * 1e-3 * TICK_HZ as f64).ceil() as u64 + 2
    }
}

/// How.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// SIGKILL; the process is started again while the enable is held on for so long.
    Kill {
        /// How long.
        held_on: Duration,
    },
    /// SIGSTOP, and SIGCONT so much later.
    Suspend {
        /// How much.
        length: Duration,
    },
}

/// One blow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Who.
    pub victim: Target,
    /// How.
    pub kind: Kind,
    /// Whether it waits until the robot is engaged.
    pub engaged: bool,
    /// Time from Engaging, or from Engaged, to the blow.
    pub phase: Duration,
}

impl Injection {
    /// Draws a blow against `victim`, which waits until the robot is engaged in `engaged_share` of all draws.
    pub fn draw(victim: Target, kill: bool, engaged_share: f64, dice: &mut Pcg64Mcg) -> Self {
        let mut uniform = || dice.random::<f64>();
        let engaged = uniform() < engaged_share;
        let phase = Duration::from_secs_f64(uniform() * PHASE_MAX_S[usize::from(engaged)]);
        let kind = if kill {
            Kind::Kill { held_on: Duration::from_secs_f64(uniform() * HELD_ON_MAX_MS * 1e-3) }
        } else {
            // Uniform in the logarithm: half of them below 45 ms.
            let [low, high] = SUSPENDED_MS;
            Kind::Suspend { length: Duration::from_secs_f64(low * (high / low).powf(uniform()) * 1e-3) }
        };
        Self { victim, kind, engaged, phase }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn blows_are_drawn_from_the_seed_within_their_bounds() {
        let draw = |seed| {
            let mut dice = Pcg64Mcg::seed_from_u64(seed);
            (0..1000).map(|n| Injection::draw(Target::ALL[n % 6], n % 2 == 0, 0.5, &mut dice)).collect::<Vec<_>>()
        };
        let blows = draw(1);
        assert_eq!(blows, draw(1));
        assert_ne!(blows, draw(2));
        assert!(blows.iter().any(|blow| blow.engaged) && blows.iter().any(|blow| !blow.engaged));
        for blow in blows {
            assert!(blow.phase.as_secs_f64() <= PHASE_MAX_S[usize::from(blow.engaged)]);
            match blow.kind {
                Kind::Kill { held_on } => assert!(held_on.as_secs_f64() <= HELD_ON_MAX_MS * 1e-3),
                Kind::Suspend { length } => {
                    let ms = length.as_secs_f64() * 1e3;
                    assert!((SUSPENDED_MS[0] - 1e-6..=SUSPENDED_MS[1] + 1e-6).contains(&ms));
                }
            }
        }
    }
}
