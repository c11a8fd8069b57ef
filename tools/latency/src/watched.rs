//! What a page and a recorder cost the loops: blocks with and without them in turns.

use crate::blocks::{self, Kind};
use crate::cli::Cli;
use crate::distribution::Distribution;
use crate::error::LatencyError;
use crate::figures::Figures;
use crate::load::Load;
use crate::processes::{self, Setup};
use crate::settings::Changes;
use rt::Shutdown;
use serde_json::{Value, json};
use std::fmt::Write;

/// Quantiles that are compared.
const QUANTILES: [(&str, f64); 4] = [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p99.9", 0.999)];

/// Both variants.
#[derive(Clone, Debug)]
pub struct Watched {
    alone: Figures,
    watched: Figures,
}

/// Runs blocks of both kinds in turns.
///
/// # Errors
/// If the options or settings are refused, or a block is not valid.
pub fn run(options: &Cli, shutdown: &Shutdown) -> Result<Watched, LatencyError> {
    let changes = Changes { policy: options.policy, pin: options.pin.clone() };
    let setup = Setup { config: options.config.clone(), changes, rate_hz: options.rate_hz };
    let load = Load::start(options.load).map_err(|error| LatencyError::reference("load", error))?;
    let (mut alone, mut watched) = (Vec::new(), Vec::new());
    let blocks = blocks::plan_watched(options.seconds);
    for (i, block) in blocks.iter().enumerate() {
        eprintln!("latency: block {} of {}: {:?}, {:.1} s", i + 1, blocks.len(), block.kind, block.seconds);
        let outcome = processes::run(&setup, *block, shutdown)?;
        if block.kind == Kind::Watched { &mut watched } else { &mut alone }.push(outcome);
        if shutdown.requested() {
            return Err(LatencyError::Interrupted);
        }
    }
    drop(load);
    Ok(Watched { alone: Figures::merge(&alone)?, watched: Figures::merge(&watched)? })
}

impl Watched {
    /// What is compared: work and wake-ups of control first, then of the others, and the path.
    fn rows(&self) -> impl Iterator<Item = (String, &Distribution, &Distribution)> {
        let hops = ["control_work", "retarget_work", "target_to_command", "skeleton_to_command"];
        let hops = hops.map(|hop| (hop.to_owned(), self.alone.hop(hop), self.watched.hop(hop)));
        let wake_ups = self.alone.wake_ups().zip(self.watched.wake_ups());
        hops.into_iter()
            .chain(wake_ups.map(|((name, alone), (_, watched))| (format!("{name}_wake_up"), alone, watched)))
    }

    /// As JSON: for each row and quantile alone, watched, both us, and their ratio.
    pub fn to_json(&self) -> Value {
        let rows = self.rows().map(|(name, alone, watched)| {
            let quantiles = QUANTILES.map(|(label, q)| {
                let (a, w) = (alone.quantile_us(q), watched.quantile_us(q));
                (label.to_owned(), json!({ "alone_us": a, "watched_us": w, "ratio": ratio(w, a) }))
            });
            (name, Value::Object(quantiles.into_iter().collect()))
        });
        json!({
            "rows": rows.collect::<serde_json::Map<_, _>>(),
            "alone": self.alone.to_json(),
            "watched": self.watched.to_json(),
        })
    }

    /// As a table.
    pub fn words(&self) -> String {
        let mut out = format!(
            "{} blocks alone, {} beside a page and a recorder, in turns; us alone, us watched, ratio\n",
            self.alone.blocks, self.watched.blocks
        );
        let _ = write!(out, "{:20}", "");
        for (label, _) in QUANTILES {
            let _ = write!(out, "{label:>26}");
        }
        for (name, alone, watched) in self.rows() {
            let _ = write!(out, "\n{name:20}");
            for (_, q) in QUANTILES {
                let (a, w) = (alone.quantile_us(q), watched.quantile_us(q));
                let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
                let ratio = ratio(w, a).map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
                let _ = write!(out, "{:>10}{:>10}{ratio:>6}", number(a), number(w));
            }
        }
        out.push('\n');
        out
    }
}

fn ratio(over: Option<f64>, under: Option<f64>) -> Option<f64> {
    let (over, under) = (over?, under?);
    (under > 0.0).then(|| over / under)
}
