//! Everything that a run measured, and the figures computed from it.

use crate::blocks::Block;
use crate::cli::{Cli, Pin, Policy};
use crate::distribution::Distribution;
use crate::figures::VariantFigures;
use crate::host::Host;
use crate::reference::core_text;
use messages::Stamp;
use serde_json::{Value, json};

/// Quantiles of the commands' path, p50 and p99, us.
const BEYOND: [(&str, f64); 2] = [("p50", 0.5), ("p99", 0.99)];

#[derive(Clone, Debug)]
pub struct Measured {
    /// Figures of the processes that events wake.
    pub events: VariantFigures,
    pub polled: VariantFigures,
    /// Wake-ups of cyclictest, if it is installed.
    pub cyclictest: Option<Distribution>,
    pub probe: Distribution,
    /// Real-time properties that the system granted to the probe.
    pub probe_realtime: Vec<String>,
    pub host: Host,
    pub blocks: Vec<Block>,
    pub start: Stamp,
}

impl Measured {
    /// The reference of the headline, and its name.
    pub fn reference(&self) -> (&'static str, &Distribution) {
        self.cyclictest.as_ref().map_or(("own probe", &self.probe), |cyclictest| ("cyclictest", cyclictest))
    }

    /// Returns the ratio of retarget's wake-up to `reference`'s at a quantile.
    pub fn wake_up_ratio(&self, reference: &Distribution, quantile: f64) -> Option<f64> {
        ratio(self.events.wake_up().quantile_us(quantile), reference.quantile_us(quantile))
    }

    /// Returns the factor by which the median of a hop is below the polled one.
    pub fn times_below_polled(&self, hop: &str) -> Option<f64> {
        ratio(self.polled.hop(hop).quantile_us(0.5), self.events.hop(hop).quantile_us(0.5))
    }

    /// Returns the time from target to command, less control's work at the same quantile, us.
    pub fn beyond_work_us(&self, quantile: f64) -> Option<f64> {
        let (whole, work) = (self.events.hop("target_to_command"), self.events.hop("control_work"));
        Some(whole.quantile_us(quantile)? - work.quantile_us(quantile)?)
    }

    pub fn to_json(&self, options: &Cli) -> Value {
        let (name, reference) = self.reference();
        let mut events = self.events.to_json();
        let rest = events.as_object_mut().expect("an object");
        let (hops, wake_ups) = (rest.remove("hops_us"), rest.remove("wake_up_us"));
        let beyond = BEYOND.map(|(name, quantile)| (name.to_owned(), json!(self.beyond_work_us(quantile))));
        let pin = |pin: &Pin| if let Pin::Cores(cores) = pin { core_text(cores) } else { "free".into() };
        let mut value = json!({
            "ratios": {
                "wakeup_p50_vs_cyclictest": self.wake_up_ratio(reference, 0.5),
                "wakeup_p99_vs_cyclictest": self.wake_up_ratio(reference, 0.99),
                "skeleton_to_command_vs_polled": self.times_below_polled("skeleton_to_command"),
                "target_to_command_vs_polled": self.times_below_polled("target_to_command"),
                "wakeup_p50_vs_probe": self.wake_up_ratio(&self.probe, 0.5),
                "wakeup_p99_vs_probe": self.wake_up_ratio(&self.probe, 0.99),
            },
            "hops_us": hops,
            "target_to_command_beyond_work_us": beyond.into_iter().collect::<serde_json::Map<_, _>>(),
            "wake_up_us": wake_ups,
            "missed_deadlines": self.events.missed.iter().sum::<u64>(),
            "allocations_after_ready": self.events.total(|process| process.allocations.r#loop),
            "transport_allocations_after_ready": self.events.total(|process| process.allocations.transport),
            "major_faults_after_ready": self.events.total(|process| process.major_faults),
            "reference": { "name": name, "probe": self.probe.to_json(), "probe_realtime": self.probe_realtime },
            "events": events,
            "polled": self.polled.to_json(),
            "machine": self.host.to_json(),
            "options": {
                "seconds": options.seconds, "load": options.load, "rate_hz": options.rate_hz,
                "policy": options.policy.map(|policy| if policy == Policy::Fifo { "fifo" } else { "other" }),
                "pin": options.pin.as_ref().map(pin),
            },
            "blocks": self.blocks.iter().map(|block| json!([block.kind.name(), block.seconds])).collect::<Vec<_>>(),
        });
        let absent = "not on the PATH (install rt-tests), or the policy is not fifo";
        match &self.cyclictest {
            Some(cyclictest) => value["reference"]["cyclictest"] = json!(cyclictest.to_json()),
            None => value["reference"]["cyclictest_absent"] = json!(absent),
        }
        value["machine"]["policy"] = json!(self.granted("scheduling"));
        value["machine"]["cores_used"] = json!(self.granted("cores"));
        value
    }

    /// Returns the real-time property that the system granted to retarget under this heading.
    pub fn granted(&self, heading: &str) -> String {
        let found = self.events.processes.iter().find(|(name, _)| *name == "retarget");
        let lines = found.map(|(_, process)| process.realtime.as_slice()).unwrap_or_default();
        let line = lines.iter().find_map(|line| line.strip_prefix(heading)?.strip_prefix(": "));
        line.unwrap_or("unknown").to_owned()
    }
}

/// Returns the quotient of two durations. None if either is missing or the divisor is zero.
pub(crate) fn ratio(over: Option<f64>, under: Option<f64>) -> Option<f64> {
    let (over, under) = (over?, under?);
    (under > 0.0).then(|| over / under)
}
