//! Known bugs of robot software, planted one at a time: each must break a promise. See `.ci/known_bugs`.

#[cfg(known_bugs)]
pub use planted::{hunt, hunt_one, plant};

/// What the options answer in a build that knows no bugs.
#[cfg(not(known_bugs))]
const NONE_HERE: &str = "this build holds no known bugs: run .ci/known_bugs, which builds with --cfg known_bugs";

/// Plants nothing: a build for that purpose does.
#[cfg(not(known_bugs))]
pub fn plant(_name: &str) -> Result<(), String> {
    Err(NONE_HERE.into())
}

/// One bug; see [`hunt`].
#[cfg(not(known_bugs))]
pub fn hunt_one(_cli: &crate::cli::Cli, _name: &str) -> Result<bool, String> {
    Err(NONE_HERE.into())
}

/// All bugs.
#[cfg(not(known_bugs))]
pub fn hunt(_cli: &crate::cli::Cli) -> Result<bool, String> {
    Err(NONE_HERE.into())
}

#[cfg(known_bugs)]
mod planted {
    use crate::campaign::{self, Plan};
    use crate::cli::Cli;
    use crate::oracle::Violation;
    use crate::run::Run;
    use crate::subject::Subject;
    use messages::KnownBug;
    use rayon::ThreadPoolBuilder;
    use rayon::prelude::*;
    use serde_json::{Value, json};
    use std::time::Instant;

    /// What became of a bug: the first promise that it broke.
    struct Found {
        bug: KnownBug,
        /// Runs up to and with the one that found it; 0 if the robot did not even start without any fault.
        runs: u64,
        /// Seed, and what was broken.
        how: Option<(u64, Violation)>,
        wall_s: f64,
    }

    impl Found {
        fn words(&self) -> String {
            let Self { bug, runs, how, wall_s } = self;
            let name = bug.name();
            match how {
                Some((0, v)) => {
                    format!("{name:26} found without any fault: {}: {} ({wall_s:.1} s)", v.invariant, v.detail)
                }
                Some((seed, v)) => format!(
                    "{name:26} found after {runs} runs, seed {seed}, tick {}, {}: {} ({wall_s:.1} s)",
                    v.tick, v.invariant, v.detail
                ),
                None => format!("{name:26} NOT FOUND in {runs} runs ({wall_s:.1} s): {}", bug.what()),
            }
        }

        fn json(&self) -> Value {
            let Self { bug, runs, how, wall_s } = self;
            let how = how
                .as_ref()
                .map(|(seed, v)| json!({ "seed": seed, "tick": v.tick, "invariant": v.invariant, "detail": v.detail }));
            json!({
                "name": bug.name(), "what": bug.what(), "like": bug.like(), "found": how, "runs": runs, "wall_s": wall_s
            })
        }
    }

    /// Plants the bug of this name.
    pub fn plant(name: &str) -> Result<(), String> {
        KnownBug::plant(Some(named(name)?));
        Ok(())
    }

    fn named(name: &str) -> Result<KnownBug, String> {
        let known = KnownBug::ALL.iter().copied().find(|bug| bug.name() == name);
        known.ok_or_else(|| {
            let names: Vec<_> = KnownBug::ALL.iter().map(|bug| bug.name()).collect();
            format!("--known-bug = {name}: is none of {}", names.join(", "))
        })
    }

    /// One bug: whether it was found.
    pub fn hunt_one(cli: &Cli, name: &str) -> Result<bool, String> {
        report(cli, &[named(name)?])
    }

    /// Every bug in turn: whether all were found.
    pub fn hunt(cli: &Cli) -> Result<bool, String> {
        report(cli, &KnownBug::ALL)
    }

    fn report(cli: &Cli, bugs: &[KnownBug]) -> Result<bool, String> {
        let plan = cli.plan()?;
        KnownBug::plant(None);
        let sound = Subject::load(&cli.config).map_err(|error| error.to_string())?;
        let sound_engaged = sound.engaged()?;
        let mut all = vec![];
        for &bug in bugs {
            let found = seek(cli, &plan, bug)?;
            // What breaks without the bug as well was not found by it.
            KnownBug::plant(None);
            if let Some((seed, _)) = found.how
                && seed != 0
                && let Some(violation) = run(&sound_engaged, &sound, seed, &plan)
            {
                return Err(format!("seed {seed} breaks a promise without {}: {violation:?}", bug.name()));
            }
            println!("{}", found.words());
            all.push(found);
        }
        let survivors = all.iter().filter(|found| found.how.is_none()).count();
        let runs = all.iter().map(|found| found.runs).max().unwrap_or(0);
        let wall_s = all.iter().map(|found| found.wall_s).sum::<f64>();
        println!("{} bugs, {survivors} not found, {runs} runs at most, {wall_s:.0} s", all.len());
        if let Some(path) = &cli.json {
            let bugs: Vec<_> = all.iter().map(Found::json).collect();
            let text =
                json!({ "ticks_per_seed": plan.ticks, "seeds": plan.seeds, "survivors": survivors, "bugs": bugs });
            std::fs::write(path, format!("{text:#}\n")).map_err(|error| format!("{}: {error}", path.display()))?;
        }
        Ok(survivors == 0)
    }

    fn run(engaged: &Run<'_>, subject: &Subject, seed: u64, plan: &Plan) -> Option<Violation> {
        campaign::single(engaged, subject, seed, plan, &campaign::drawn(seed, plan)).violation
    }

    /// Seeds in their order, as many at once as there are threads, up to the first promise that breaks. Everything is
    /// made anew with the bug in it: it may sit in what is derived from the settings.
    fn seek(cli: &Cli, plan: &Plan, bug: KnownBug) -> Result<Found, String> {
        let start = Instant::now();
        let found = |runs, how| Found { bug, runs, how, wall_s: start.elapsed().as_secs_f64() };
        KnownBug::plant(Some(bug));
        let subject = Subject::load(&cli.config).map_err(|error| format!("{}: {error}", bug.name()))?;
        let engaged = match subject.engaged() {
            Ok(engaged) => engaged,
            Err(detail) => return Ok(found(0, Some((0, Violation { tick: 0, invariant: "start", detail })))),
        };
        let pool = ThreadPoolBuilder::new().num_threads(plan.jobs).build().map_err(|error| error.to_string())?;
        let (first, step) = (plan.first_seed, plan.jobs as u64);
        for from in (first..first + plan.seeds).step_by(plan.jobs) {
            let outcome = |seed| run(&engaged, &subject, seed, plan).map(|violation| (seed, violation));
            let to = (from + step).min(first + plan.seeds);
            let broken: Vec<_> = pool.install(|| {
                (from..to).collect::<Vec<u64>>().into_par_iter().with_max_len(1).filter_map(outcome).collect()
            });
            if let Some((seed, violation)) = broken.into_iter().next() {
                return Ok(found(seed - first + 1, Some((seed, violation))));
            }
        }
        Ok(found(plan.seeds, None))
    }
}
