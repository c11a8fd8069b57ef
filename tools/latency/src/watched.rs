//! Measures the cost of a page and a recorder for the loops. Blocks with and without them alternate.

use crate::blocks::{self, Kind};
use crate::cli::Cli;
use crate::distribution::Distribution;
use crate::error::unmeasured;
use crate::figures::VariantFigures;
use crate::load::Load;
use crate::measured::ratio;
use crate::processes::{self, Setup};
use crate::settings::Changes;
use report::table::{self, column, number};
use rt::{Failure, Shutdown};
use serde_json::{Value, json};

const QUANTILES: [(&str, f64); 4] = [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p99.9", 0.999)];

/// Both variants, and the effect of chance alone: the blocks without page and recorder, split into every second
/// one and the others.
#[derive(Clone, Debug)]
pub struct ObserverCost {
    alone: VariantFigures,
    watched: VariantFigures,
    halves: [VariantFigures; 2],
}

/// One compared figure: both variants, and both halves of the blocks alone.
struct Row<'a> {
    name: String,
    of: [&'a Distribution; 4],
}

impl Row<'_> {
    /// Returns four values: without, with (both in µs), the ratio of with to without, and the ratio of both
    /// halves of the blocks without.
    fn at(&self, q: f64) -> [Option<f64>; 4] {
        let [alone, watched, one, other] = self.of.map(|distribution| distribution.quantile_us(q));
        [alone, watched, ratio(watched, alone), ratio(other, one)]
    }
}

pub fn run(options: &Cli, shutdown: &Shutdown) -> Result<ObserverCost, Failure> {
    let changes = Changes { policy: options.policy, pin: options.pin.clone() };
    let setup = Setup { config: options.config.clone(), changes, rate_hz: options.rate_hz };
    let load = Load::start(options.load).map_err(|error| unmeasured("load", error))?;
    let (mut alone, mut watched) = (Vec::new(), Vec::new());
    let blocks = blocks::plan_watched(options.seconds);
    for (i, block) in blocks.iter().enumerate() {
        eprintln!("latency: block {} of {}: {:?}, {:.1} s", i + 1, blocks.len(), block.kind, block.seconds);
        let outcome = processes::run(&setup, *block, shutdown)?;
        if block.kind == Kind::ObserverCost { &mut watched } else { &mut alone }.push(outcome);
        if shutdown.requested() {
            return Err(::report::interrupted());
        }
    }
    drop(load);
    let half = |n: usize| alone.iter().skip(n).step_by(2).cloned().collect::<Vec<_>>();
    let halves = [VariantFigures::merge(&half(0))?, VariantFigures::merge(&half(1))?];
    Ok(ObserverCost { alone: VariantFigures::merge(&alone)?, watched: VariantFigures::merge(&watched)?, halves })
}

impl ObserverCost {
    /// Returns the compared figures: work and wake-ups of control first, then those of the others, and the path.
    fn rows(&self) -> Vec<Row<'_>> {
        let all = [&self.alone, &self.watched, &self.halves[0], &self.halves[1]];
        let hops = ["control_work", "retarget_work", "target_to_command", "skeleton_to_command"];
        let hops = hops.map(|hop| Row { name: hop.to_owned(), of: all.map(|figures| figures.hop(hop)) });
        let loops = self.alone.wake_ups().enumerate().map(|(n, (name, _))| {
            let of = all.map(|figures| figures.wake_ups().nth(n).expect("as many of each").1);
            Row { name: format!("{name}_wake_up"), of }
        });
        hops.into_iter().chain(loops).collect()
    }

    /// Returns JSON. Each row and quantile has alone and watched, both in us, their ratio, and the ratio of
    /// both halves of the blocks alone.
    pub fn to_json(&self) -> Value {
        let rows = self.rows().into_iter().map(|row| {
            let quantiles = QUANTILES.map(|(label, q)| {
                let [alone, watched, ratio, chance] = row.at(q);
                let row = json!({ "alone_us": alone, "watched_us": watched, "ratio": ratio, "chance": chance });
                (label.to_owned(), row)
            });
            (row.name, Value::Object(quantiles.into_iter().collect()))
        });
        json!({
            "rows": rows.collect::<serde_json::Map<_, _>>(),
            "alone": self.alone.to_json(),
            "watched": self.watched.to_json(),
        })
    }

    pub fn text(&self) -> String {
        let mut out = format!(
            "{} blocks alone, {} beside a page and a recorder, in turns; us alone, us watched, ratio,\n\
             and in brackets that of one half of the blocks alone to the other: chance\n",
            self.alone.blocks, self.watched.blocks
        );
        let columns = QUANTILES.map(|(label, q)| {
            column(["", label], 32, move |row: &Row<'_>| {
                let [alone, watched, ratio, chance] = row.at(q);
                let (ratio, chance) = (number(ratio, 2), format!("({})", number(chance, 2)));
                format!("{:>10}{:>10}{ratio:>6}{chance:>6}", number(alone, 1), number(watched, 1))
            })
        });
        let rows = self.rows();
        // Writing to a String cannot fail.
        let _ = table::write(&mut out, ("", 20), &columns, rows.iter().map(|row| (row.name.as_str(), row)));
        out
    }
}
