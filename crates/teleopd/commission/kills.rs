//! SIGKILL of every process while a joint moves slowly. The robot must be at rest within the bound. Does no IO and reads
//! no clock.

use super::path::Path;
use super::ports::{Facts, Sample, Stop, Victim};
use super::session::{Session, require};
use messages::{JOINTS_MAX, Mode};

/// Waves of the motion. The first kill comes in the first one.
const WAVES: u32 = 20;
/// Share of the largest speed at which the process is killed.
const FAST: f64 = 0.8;
/// Time between two looks at the speed, s.
const LOOK_S: f64 = 0.05;
/// A joint that stays within this is at rest, rad or m. At 0.1 rad/s the time of rest is 10 ms exact. Assumption: it is
/// above the noise of an arm's encoders.
const RESTS: f64 = 1e-3;
/// Time for which the robot is watched beyond the bound, and after a restart, s. Assumption.
const WATCHED_S: f64 = 1.0;

pub fn run(run: &mut Session<'_>) -> Result<Vec<String>, Stop> {
    Victim::ALL.into_iter().map(|victim| one(run, victim)).collect()
}

/// Returns the first joint of the left arm that can move, and its travel.
pub fn free_joint(facts: &Facts, q: &[f64; JOINTS_MAX], arm: usize) -> Result<(usize, f64), Stop> {
    let mut joints = facts.model.arms[arm].range().map(|joint| facts.travel(q, joint).map(|by| (joint, by)));
    let first = joints.next().unwrap_or_else(|| Err(Stop::Failed("the arm has no joints".into())));
    first.or_else(|none| joints.find_map(Result::ok).ok_or(none))
}

fn one(run: &mut Session<'_>, victim: Victim) -> Result<String, Stop> {
    let (facts, name) = (run.facts, victim.name());
    let q = run.robot.watch(WATCHED_S)?[0].q;
    let (joint, by) = free_joint(facts, &q, 0)?;
    let joint_name = &facts.model.joint_names[joint];
    run.person.confirm(&format!("{joint_name} will move to and fro, then {name} is killed. Enter begins."))?;
    run.robot.engage()?;
    let path = Path::waves(q, joint, by, facts.speed(joint), WAVES);
    run.robot.play(&path)?;
    let (mut moves, mut before) = (false, q);
    for _ in 0..(2.0 * path.period_s / LOOK_S) as usize {
        let samples = run.robot.watch(LOOK_S)?;
        before = samples.last().map_or(before, |last| last.q_measured);
        moves = samples.last().is_some_and(|last| last.v[joint].abs() >= FAST * facts.speed(joint));
        if moves {
            break;
        }
    }
    require(moves, || format!("{joint_name} did not move before the kill. {}", run.robot.why()))?;
    let killed_s = run.robot.kill(victim)?;
    let found = match victim {
        Victim::Driver => driver(run, &before, (joint, [q[joint], q[joint] + by]))?,
        _ => other(run, victim, killed_s)?,
    };
    run.person.print(&found);
    Ok(found)
}

fn other(run: &mut Session<'_>, victim: Victim, killed_s: f64) -> Result<String, Stop> {
    let (facts, name) = (run.facts, victim.name());
    let within_s = bound_s(facts, victim);
    let samples = run.robot.watch(within_s + WATCHED_S)?;
    // The driver's estimate hides a part of the delay.
    let rest_s = rest_s(facts, &samples) - killed_s + facts.delay_s - facts.shown_delay_s;
    let ms = |s: f64| format!("{:.0} ms", s * 1e3);
    require(rest_s <= within_s, || {
        format!("after kill -9 of {name} the robot was at rest {} later, the bound is {}", ms(rest_s), ms(within_s))
    })?;
    run.robot.restart(victim)?;
    stands_after(run, victim, &samples[samples.len() - 1].q_measured, None)?;
    Ok(format!(
        "kill -9 of {name}: measured within {:.0} mrad or mm of its rest {} later, the bound is {}",
        RESTS * 1e3,
        ms(rest_s),
        ms(within_s)
    ))
}

/// Nothing of ours measures while the driver is dead. The restarted driver measures that the joints stand, and the person
/// says whether they stopped at once. All joints but the moving one must be where they were `before`, and that one on its
/// way between two ends.
fn driver(run: &mut Session<'_>, before: &[f64; JOINTS_MAX], (joint, ends): (usize, [f64; 2])) -> Result<String, Stop> {
    run.robot.pause(run.facts.stop_s + run.facts.delay_s + WATCHED_S)?;
    run.person.saw(
        "The driver was killed, and nothing of ours measures now. Did the robot stop at once?",
        "the person saw that the robot did not stop at once after kill -9 of the driver",
    )?;
    run.robot.restart(Victim::Driver)?;
    let sample = stands_after(run, Victim::Driver, before, Some(joint))?;
    let (facts, at) = (run.facts, sample.q_measured[joint]);
    let margin = facts.differs(joint) + facts.stands(joint);
    let on_way = at >= ends[0].min(ends[1]) - margin && at <= ends[0].max(ends[1]) + margin;
    require(on_way, || {
        let (name, off) = (&facts.model.joint_names[joint], facts.with_unit(joint, at - before[joint]));
        format!("{name} is {off} from where it was when the driver was killed")
    })?;
    Ok("kill -9 of the driver: the person saw the robot stop, and the restarted driver measures that it stands".into())
}

/// Requires that a restart moved nothing away from `before`, and resets. The joint `but` may have gone on before the
/// restart, and must stand now. Returns the last sample.
fn stands_after(
    run: &mut Session<'_>,
    victim: Victim,
    before: &[f64; JOINTS_MAX],
    but: Option<usize>,
) -> Result<Sample, Stop> {
    let (facts, name) = (run.facts, victim.name());
    let samples = run.robot.watch(WATCHED_S)?;
    let strayed = facts.strayed(before, &samples, but);
    if let Some((joint, off)) = strayed.or_else(|| facts.strayed(&samples[0].q_measured, &samples, None)) {
        let (joint, off) = (&facts.model.joint_names[joint], facts.with_unit(joint, off));
        return Err(Stop::Failed(format!("{joint} moved by {off} after {name} was started again")));
    }
    run.robot.release()?;
    let free = run.robot.mode() == Some(Mode::Disengaged) || run.robot.reset()?;
    require(free, || format!("the robot cannot be reset after {name} was started again. {}", run.robot.why()))?;
    Ok(samples[samples.len() - 1])
}

/// Longest time from the kill to a measured rest, s: until control or the driver notices, the longest stop, the robot's
/// delay, and the age of a measurement.
fn bound_s(facts: &Facts, victim: Victim) -> f64 {
    let noticed_s = match victim {
        Victim::Ingest => facts.noticed_s[0],
        Victim::Targets => facts.noticed_s[1],
        // The driver plays the stop from the first missed tick.
        Victim::Control | Victim::Driver => 0.0,
    };
    noticed_s + facts.stop_s + facts.delay_s + facts.age_s
}

/// Time of the first sample from which on every joint is measured where it ends, s.
fn rest_s(facts: &Facts, samples: &[Sample]) -> f64 {
    let end = samples[samples.len() - 1];
    let rests = |sample: &Sample, j: usize| (sample.q_measured[j] - end.q_measured[j]).abs() <= RESTS;
    let off = |sample: &&Sample| !(0..facts.model.count).all(|j| rests(sample, j));
    samples.iter().rev().find(off).map_or(samples[0].at_s, |last| last.at_s)
}
