//! Report of a run, collected from the processes' own figures. Available as JSON and as a table.

use crate::timeline::Timeline;
use instance::Instance;
use messages::{FAULTS, Fault, FaultRow, Response, TICK_HZ};
use rt::{Exit, Failure, out};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Kinds of violation that the command checker counts.
const VIOLATIONS: [&str; 7] = ["position", "velocity", "acceleration", "jerk", "clearance", "hand speed", "torque"];
/// Kinds of violation that the judge of the joints' true motion counts.
const TRUE_VIOLATIONS: [plant::ViolationKind; 7] = plant::ViolationKind::ALL;
/// Smallest share of the motion that a robot must follow. Below it the robot counts as not following. Assumption.
const FOLLOWED_MIN: f64 = 0.5;
/// Pause of a process that explains a stopped robot, ms. `control` may miss ten deadlines in a row, 7 ms.
const PAUSE_MS: f64 = 10.0;
/// Percentiles of a latency.
const PERCENTILES: [&str; 4] = ["p50", "p99", "p99_9", "max"];

/// Source of the robot's motion in a demo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Simulator {
    /// The built-in one. Its judge keeps figures of the true motion.
    BuiltIn,
    /// The program of `driver.program`.
    Own,
}

/// Report of a run. Its keys are self-explanatory.
pub struct Report {
    value: Value,
}

impl Report {
    /// Reads the reports that the processes wrote to the instance's folder.
    /// `faults` counts them up to the end of the motion. What the processes raise while they end one after another is no
    /// fault of the run. Without it, all are counted.
    pub fn collect(instance: &Instance, simulator: Simulator, faults: Option<Value>) -> Result<Self, Failure> {
        let read = |process: &str| -> Result<Value, Failure> {
            let path = instance.report(process);
            let text = std::fs::read_to_string(&path).map_err(|error| {
                Failure::new(Exit::Failed, format!("{process} wrote no figures: {}: {error}", path.display()))
            })?;
            serde_json::from_str(&text)
                .map_err(|error| Failure::new(Exit::Failed, format!("{}: {error}", path.display())))
        };
        let (retarget, control, driver) = (read("retarget")?, read("control")?, read("driver")?);
        let robot = if simulator == Simulator::BuiltIn { read("robot")? } else { Value::Null };
        let timelines = [&retarget, &control, &driver].map(|figures| Timeline::deserialize(&figures["timeline"]).ok());
        let [Some(of_retarget), Some(of_control), Some(of_driver)] = timelines else {
            return Err(Failure::new(Exit::Failed, "a process wrote no timeline"));
        };
        let (first, last) = of_retarget.span().ok_or_else(|| Failure::new(Exit::Failed, "retarget never ticked"))?;
        let length = last - first + 1;
        let timelines = [("retarget", of_retarget), ("control", of_control), ("driver", of_driver)];
        let of_robot = Timeline::deserialize(&robot["timeline"]).ok().map(|timeline| ("robot", timeline));
        let (mut ticks, mut missed) = (Map::new(), Map::new());
        for (name, timeline) in &timelines {
            let ran = timeline.ticks_within(first, last);
            ticks.insert((*name).into(), json!(ran));
            missed.insert((*name).into(), json!(length - ran));
        }
        let mut transitions = control["mode_transitions"].as_array().cloned().unwrap_or_default();
        for transition in &mut transitions {
            let k = transition["k"].as_u64().unwrap_or(first);
            *transition = json!({
                "t_s": (k as f64 - first as f64) / TICK_HZ as f64,
                "from": transition["from"], "to": transition["to"], "why": transition["why"],
                "meant_to_follow": transition["meant_to_follow"],
            });
        }
        let followed = followed(&transitions, length as f64 / TICK_HZ as f64);
        let limb = |which: &str| json!({ "mean": control["limb_error_deg"][which]["mean"], "p95": control["limb_error_deg"][which]["p95"] });
        let value = json!({
            "seconds": length as f64 / TICK_HZ as f64,
            "ticks": ticks,
            "missed_deadlines": missed,
            "longest_pause": longest_pause(timelines.iter().chain(&of_robot), first),
            "latency_us": {
                "skeleton_to_command": percentiles(&driver["telemetry"]["metrics"]["skeleton_to_command"]),
                "target_to_command": percentiles(&driver["telemetry"]["metrics"]["target_to_command"]),
            },
            "violations": VIOLATIONS.iter().map(|&kind| (kind.to_owned(), driver["violations"][kind].clone())).collect::<Map<_, _>>(),
            "min_clearance_mm": driver["min_clearance_mm"],
            "torque_share_max": driver["torque_share_max"],
            "robot": robot.is_object().then(|| json!({
                "violations": robot["violations"], "first_violation": robot["first_violation"],
                "min_clearance_mm": robot["min_clearance_mm"], "speed_ratio_max": robot["speed_ratio_max"],
                "effort_ratio_max": robot["effort_ratio_max"],
            })),
            "followed": followed,
            "limb_error_deg": {
                "target": limb("target"), "measured": limb("measured"), "throughout": limb("throughout"),
            },
            "tracking_error_rad": { "rms": control["tracking_error_rad"]["rms"], "max": control["tracking_error_rad"]["max"] },
            "engage": driver["engage"],
            "first_latch": driver["first_latch"],
            "faults": faults.unwrap_or_else(|| control["status"]["fault_counts"].clone()),
            "faults_before_engaging": control["faults_before_engaging"],
            "mode_transitions": transitions,
        });
        Ok(Self { value })
    }

    /// Returns the report as JSON.
    pub fn to_json(&self) -> &Value {
        &self.value
    }

    /// Writes the report as JSON to this file, if there is one.
    pub fn write(&self, path: Option<&Path>) -> Result<(), Failure> {
        let Some(path) = path else { return Ok(()) };
        let text = format!("{:#}\n", self.to_json());
        std::fs::write(path, text).map_err(|error| Failure::new(Exit::Failed, rt::unwritable(path, &error)))
    }

    /// Returns the violations. Empty if no limit was broken.
    pub fn violations(&self) -> Vec<String> {
        let mut all = Vec::new();
        let mut add = |count: &Value, what: String| match count.as_u64() {
            Some(0) => {}
            Some(count) => all.push(format!("{count} {what}")),
            None => all.push(format!("{what} were not counted")),
        };
        for kind in VIOLATIONS {
            add(&self.value["violations"][kind], format!("{kind} violations"));
        }
        // A simulator of the user's own judges its robot by itself.
        let judged = self.value["robot"].as_object().is_some();
        for kind in TRUE_VIOLATIONS.map(plant::ViolationKind::name).into_iter().filter(|_| judged) {
            add(&self.value["robot"]["violations"][kind], format!("{kind} violations of the joints' true motion"));
        }
        all
    }

    /// Returns what stopped the robot: Stop faults, or that it never engaged. Empty if all was well.
    pub fn stops(&self) -> Vec<String> {
        let raised = FAULTS.iter().filter(|row| row.response == Response::Stop);
        let stop = |row: &FaultRow| {
            let latch = self.value["first_latch"].as_str().filter(|_| row.fault == Fault::DriverFault);
            let why = latch.map_or(String::new(), |why| format!(" First, {why}."));
            format!("{}: {}{why}", row.name, row.meaning)
        };
        let mut all: Vec<_> = raised.filter(|row| self.value["faults"].get(row.name).is_some()).map(stop).collect();
        if !self.engaged() {
            all.push("the robot was never engaged".into());
        }
        all
    }

    /// Returns the checks that failed: a violation, a Stop fault, or no engagement. Empty if all was well.
    pub fn complaints(&self) -> Vec<String> {
        [self.violations(), self.stops()].concat()
    }

    /// Says when this machine ran a process for so long not that a robot must stop. `None` if it never did.
    pub fn pause(&self) -> Option<String> {
        let pause = &self.value["longest_pause"];
        let (ms, at_s) = (pause["ms"].as_f64().filter(|ms| *ms >= PAUSE_MS)?, pause["at_s"].as_f64()?);
        let process = pause["process"].as_str().unwrap_or("?");
        Some(format!("this machine paused for {ms:.0} ms at {at_s:.1} s ({process})"))
    }

    /// The verdict of a run without complaint.
    pub fn verdict(&self) -> String {
        let share = self.value["followed"]["share"].as_f64().unwrap_or(0.0);
        let count = |key: &str| self.value[key]["retarget"].as_f64().unwrap_or(0.0);
        let late = count("missed_deadlines") / (count("ticks") + count("missed_deadlines")).max(1.0);
        // A robot whose person comes late follows, but behind: then the share alone would be half of the truth.
        let but =
            if late > 0.1 { format!(", but {:.0} % of the ticks were late", 100.0 * late) } else { String::new() };
        let behind = self.value["limb_error_deg"]["measured"]["mean"].as_f64();
        let behind = behind.map(|degrees| format!(", {degrees:.1} degrees from the person")).unwrap_or_default();
        format!("OK: followed {:.0} %{behind}, no limit broken{but}", 100.0 * share)
    }

    /// Returns advice if the robot followed for less than half of the time in which it should have. `None` if it
    /// followed.
    pub fn advice(&self) -> Option<String> {
        let followed = &self.value["followed"];
        let share = followed["share"].as_f64()?;
        let holds = followed["holds"].as_array().map_or(&[][..], Vec::as_slice);
        let most = holds.iter().max_by_key(|hold| hold["times"].as_u64());
        let why = most.and_then(|hold| hold["why"].as_str()).unwrap_or("unknown");
        let meaning = FAULTS.iter().find(|row| row.name == why).map_or("", |row| row.meaning);
        (share < FOLLOWED_MIN).then(|| {
            format!(
                "the robot followed for only {:.0} % of the motion, and held most often because of {why}: {meaning} On \
                 a busy machine close other programs; `teleopd doctor` says what else helps",
                share * 100.0
            )
        })
    }

    fn engaged(&self) -> bool {
        self.value["mode_transitions"].as_array().is_some_and(|all| all.iter().any(|one| one["to"] == "Engaged"))
    }

    /// Prints a table for people.
    pub fn print(&self) {
        let v = &self.value;
        let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
        let seconds = number(&v["seconds"]);
        out!("\n{:<34} {:>10} {:>10} {:>10}", format!("{seconds:.2} s"), "retarget", "control", "driver");
        for (label, key) in [("ticks", "ticks"), ("missed deadlines", "missed_deadlines")] {
            let row = &v[key];
            let [retarget, control, driver] = ["retarget", "control", "driver"].map(|name| number(&row[name]));
            out!("{label:<34} {retarget:>10} {control:>10} {driver:>10}");
        }
        let rate = |name: &str| number(&v["ticks"][name]) / seconds;
        out!("{:<34} {:>10.1} {:>10.1} {:>10.1}", "rate, Hz", rate("retarget"), rate("control"), rate("driver"));
        out!("\n{:<34} {:>10} {:>10} {:>10} {:>10}", "latency, us", "p50", "p99", "p99.9", "max");
        for (label, key) in [("skeleton to command", "skeleton_to_command"), ("target to command", "target_to_command")]
        {
            let row = &v["latency_us"][key];
            let [p50, p99, p99_9, max] = PERCENTILES.map(|name| number(&row[name]));
            out!("{label:<34} {p50:>10.0} {p99:>10.0} {p99_9:>10.0} {max:>10.0}");
        }
        print_followed(&v["followed"]);
        out!("\n{:<34} {:>10} {:>10}", "limb error, deg", "mean", "p95");
        let rows =
            [("target", "target"), ("measured", "measured, while engaged"), ("throughout", "measured, throughout")];
        for (which, label) in rows {
            let row = &v["limb_error_deg"][which];
            let degrees = |value: &Value| value.as_f64().map_or("-".into(), |degrees| format!("{degrees:.2}"));
            out!("{label:<34} {:>10} {:>10}", degrees(&row["mean"]), degrees(&row["p95"]));
        }
        out!(
            "(mean of four angles: the person's upper arms and forearms against the robot's, in its targets and as \
             measured;"
        );
        out!(" throughout: holds count too; p95: 95 of 100 ticks lie below)");
        let [rms, max] = ["rms", "max"].map(|key| number(&v["tracking_error_rad"][key]));
        out!("\n{:<34} {rms:>10.4} rms {max:>10.4} max", "tracking error, rad");
        out!("{:<34} {:>10.1e} rad", "largest step at engage", number(&v["engage"]["max_step_rad"]));
        let ratio = number(&v["engage"]["first_second_velocity_ratio"]);
        out!("{:<34} {:>10.2} % of the limit", "velocity in the first second", ratio * 100.0);
        let [clearance, torque] = ["smallest clearance", "largest torque"];
        let (clearance_mm, share) = (number(&v["min_clearance_mm"]), number(&v["torque_share_max"]));
        out!("{clearance:<34} {clearance_mm:>10.1} mm between two parts of the robot, or one and an obstacle");
        out!("{torque:<34} {share:>10.2} of the effort limit, from the commanded motion and the links' dynamics");
        let counts = VIOLATIONS.map(|kind| format!("{kind} {}", v["violations"][kind]));
        out!("{:<16} {}", "violations", counts.join(", "));
        let (before, since) = faults(&v["faults"], &v["faults_before_engaging"]);
        let listed = |all: &[String]| if all.is_empty() { "none".to_owned() } else { all.join(", ") };
        out!("{:<16} {}", "faults raised", listed(&since));
        if !before.is_empty() {
            out!("{:<16} {} (the streams start later)", "before engaging", listed(&before));
        }
        for one in v["mode_transitions"].as_array().into_iter().flatten() {
            let text = |key: &str| one[key].as_str().unwrap_or("?").to_owned();
            out!("{:>12.3} s   {} -> {} ({})", number(&one["t_s"]), text("from"), text("to"), text("why"));
        }
    }
}

/// The longest time for which one of the processes ran no tick, in a run that began at tick `first`. Null without one.
fn longest_pause<'a>(timelines: impl Iterator<Item = &'a (&'static str, Timeline)>, first: u64) -> Value {
    let pauses = timelines.filter_map(|(name, timeline)| Some((*name, timeline.longest_pause(first)?)));
    pauses.max_by_key(|(_, (_, lost))| *lost).map_or(Value::Null, |(process, (k, lost))| {
        let [ms, at_s] = [lost as f64 * 1e3, k.saturating_sub(first) as f64].map(|ticks| ticks / TICK_HZ as f64);
        json!({ "process": process, "ms": ms, "at_s": at_s })
    })
}

/// Returns how long the robot should have followed, how long it did, and why it held. The run ended at `end_s`.
/// `share` is null if the robot was never engaged.
fn followed(transitions: &[Value], end_s: f64) -> Value {
    let (mut meant_since, mut engaged_since): (Option<f64>, Option<f64>) = (None, None);
    let (mut meant_s, mut engaged_s) = (0.0, 0.0);
    let mut holds: Vec<(String, u64)> = Vec::new();
    for one in transitions {
        let at_s = one["t_s"].as_f64().unwrap_or(end_s);
        let (to, why) = (one["to"].as_str().unwrap_or("?"), one["why"].as_str().unwrap_or("?"));
        engaged_s += engaged_since.take().map_or(0.0, |since| at_s - since);
        engaged_since = (to == "Engaged").then_some(at_s);
        if one["meant_to_follow"] == json!(true) {
            meant_since = meant_since.or(Some(at_s));
        } else {
            meant_s += meant_since.take().map_or(0.0, |since| at_s - since);
        }
        if meant_since.is_some() && (to == "Holding" || to == "Faulted") {
            match holds.iter_mut().find(|(name, _)| name == why) {
                Some((_, times)) => *times += 1,
                None => holds.push((why.into(), 1)),
            }
        }
    }
    engaged_s += engaged_since.map_or(0.0, |since| end_s - since);
    meant_s += meant_since.map_or(0.0, |since| end_s - since);
    let holds: Vec<_> = holds.into_iter().map(|(why, times)| json!({ "why": why, "times": times })).collect();
    json!({
        "meant_s": meant_s, "engaged_s": engaged_s,
        "share": (meant_s > 0.0).then(|| engaged_s / meant_s), "holds": holds,
    })
}

fn print_followed(followed: &Value) {
    let number = |key: &str| followed[key].as_f64().unwrap_or(f64::NAN);
    let Some(share) = followed["share"].as_f64() else {
        return out!("\n{:<34} {:>10}", "followed", "never");
    };
    let holds = followed["holds"].as_array().into_iter().flatten();
    let holds: Vec<_> =
        holds.map(|hold| format!("{} x {}", hold["why"].as_str().unwrap_or("?"), hold["times"])).collect();
    let held = if holds.is_empty() { String::new() } else { format!("; held because of {}", holds.join(", ")) };
    let (engaged_s, meant_s) = (number("engaged_s"), number("meant_s"));
    out!("\n{:<34} {:>10.1} % of {meant_s:.1} s ({engaged_s:.1} s){held}", "followed", share * 100.0);
}

/// Splits the faults into those before the first engagement and those since. All are before if the robot never engaged.
fn faults(all: &Value, before: &Value) -> (Vec<String>, Vec<String>) {
    let (mut early, mut since) = (Vec::new(), Vec::new());
    for (name, count) in all.as_object().into_iter().flatten() {
        let count = count.as_u64().unwrap_or(0);
        let first = if before.is_null() { count } else { before[name].as_u64().unwrap_or(0) };
        for (list, count) in [(&mut early, first), (&mut since, count.saturating_sub(first))] {
            if count > 0 {
                list.push(format!("{name} x {count}"));
            }
        }
    }
    (early, since)
}

fn percentiles(value: &Value) -> Value {
    let figure = |name: &str| value[format!("{name}_us")].clone();
    Value::Object(PERCENTILES.iter().map(|&name| (name.to_owned(), figure(name))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_before_engaging_are_listed_apart() {
        let all = json!({ "NoTarget": 1, "InputStale": 3 });
        let names = |one: &[&str]| one.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let before = json!({ "NoTarget": 1, "InputStale": 1 });
        assert_eq!(faults(&all, &before), (names(&["NoTarget x 1", "InputStale x 1"]), names(&["InputStale x 2"])));
        assert_eq!(faults(&all, &Value::Null), (names(&["NoTarget x 1", "InputStale x 3"]), vec![]), "never engaged");
        assert_eq!(faults(&all, &json!({})).0, names(&[]));
    }

    #[test]
    fn time_not_followed_lowers_followed_share() {
        let at = |t_s: f64, to: &str, why: &str| {
            let meant = (3.0..13.0).contains(&t_s);
            json!({ "t_s": t_s, "to": to, "why": why, "meant_to_follow": meant })
        };
        let run = [
            at(1.0, "Engaging", "enabled"),
            at(3.0, "Engaged", "aligned"),
            at(5.0, "Holding", "InputStale"),
            at(6.0, "Engaging", "settled"),
            at(8.0, "Engaged", "aligned"),
            at(9.0, "Holding", "InputStale"),
            at(12.0, "Engaged", "aligned"),
            at(13.0, "Holding", "released"),
            at(13.2, "Disengaged", "at rest"),
        ];
        let all = followed(&run, 20.0);
        assert_eq!((&all["meant_s"], &all["engaged_s"], &all["share"]), (&json!(10.0), &json!(4.0), &json!(0.4)));
        assert_eq!(all["holds"], json!([{ "why": "InputStale", "times": 2 }]));
        let report = Report { value: json!({ "followed": all, "limb_error_deg": { "measured": { "mean": 20.84 } } }) };
        let verdict = "OK: followed 40 %, 20.8 degrees from the person, no limit broken";
        assert_eq!((report.verdict().as_str(), report.pause()), (verdict, None));
        let pause = json!({ "process": "driver", "ms": 59.2, "at_s": 3.21 });
        let paused = Report { value: json!({ "longest_pause": pause }) };
        assert_eq!(paused.pause().as_deref(), Some("this machine paused for 59 ms at 3.2 s (driver)"));
        let advice = report.advice().expect("less than half");
        assert!(advice.contains("40 %") && advice.contains("InputStale"), "{advice}");
        // The robot still holds at the end of the run.
        assert_eq!(followed(&run[..3], 7.0)["share"], json!(0.5));
        assert_eq!(followed(&run[..1], 7.0)["share"], Value::Null);
        let never = Report { value: json!({ "followed": followed(&[], 7.0) }) };
        assert!(never.advice().is_none(), "it never engaged: that is not a robot that held");
    }
}
