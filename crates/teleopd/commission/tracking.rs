//! Delay and tracking error of a slow sinusoid. Does no IO and reads no clock.
//!
//! A joint that follows its command q with the velocity v by the delay d, beside a constant offset c, is measured at
//! m = q - c - d v. The least squares over all samples are
//!
//! ```text
//! d = cov(v, q - m) / var(v)
//! ```

use super::kills::free_joint;
use super::path::Path;
use super::ports::{Facts, Sample, Stop};
use super::session::{Session, require};
use messages::Mode;

/// Waves that are measured.
const WAVES: u32 = 5;
/// Time after the waves, s.
const SETTLES_S: f64 = 0.5;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Followed {
    /// Delay from the command to its measurement, s.
    pub delay_s: f64,
    /// Largest |command - measured|, rad or m.
    pub error_max: f64,
    /// Largest part of it that the delay and a constant offset do not explain, rad or m.
    pub rest_max: f64,
}

pub fn run(run: &mut Session<'_>) -> Result<Vec<String>, Stop> {
    let (mut found, mut delays_s) = (Vec::new(), Vec::new());
    for arm in 0..2 {
        let facts = run.facts;
        let q = run.robot.watch(SETTLES_S)?[0].q;
        let (joint, by) = free_joint(facts, &q, arm)?;
        let name = &facts.model.joint_names[joint];
        run.person.confirm(&format!("{name} will swing {WAVES} times. Enter begins."))?;
        run.robot.engage()?;
        let path = Path::waves(q, joint, by, facts.speed(joint), WAVES);
        run.robot.play(&path)?;
        let samples = run.robot.watch(path.length_s() + SETTLES_S)?;
        let stopped = run.robot.mode() != Some(Mode::Engaged);
        require(!stopped, || format!("control stopped the robot: {}", run.robot.why()))?;
        run.robot.release()?;
        let followed = fit(&samples, joint)
            .ok_or_else(|| Stop::Failed(format!("{name} was not commanded to move, so no delay can be measured")))?;
        let error = facts.with_unit(joint, followed.error_max);
        let rest = facts.with_unit(joint, followed.rest_max);
        let delay_ms = (followed.delay_s + facts.delay_s - facts.shown_delay_s) * 1e3;
        found.push(format!(
            "{name}: {delay_ms:.1} ms from command to measurement, error at most {error}, without the delay {rest}"
        ));
        delays_s.push(followed.delay_s);
    }
    let delay_s = delays_s.iter().sum::<f64>() / delays_s.len() as f64;
    run.proposals.extend(settings(run.facts, delay_s));
    Ok(found)
}

/// Fits the delay. `None` if the joint was not commanded to move.
pub fn fit(samples: &[Sample], joint: usize) -> Option<Followed> {
    let pairs: Vec<_> = samples.iter().map(|s| (s.v[joint], s.q[joint] - s.q_measured[joint])).collect();
    let count = pairs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let (v_mean, e_mean) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let variance: f64 = pairs.iter().map(|(v, _)| (v - v_mean).powi(2)).sum();
    let covariance: f64 = pairs.iter().map(|(v, e)| (v - v_mean) * (e - e_mean)).sum();
    let delay_s = Some(covariance / variance).filter(|delay_s| delay_s.is_finite())?;
    let rest = |&(v, e): &(f64, f64)| (e - e_mean - delay_s * (v - v_mean)).abs();
    Some(Followed {
        delay_s,
        error_max: pairs.iter().map(|(_, e)| e.abs()).fold(0.0, f64::max),
        rest_max: pairs.iter().map(rest).fold(0.0, f64::max),
    })
}

fn settings(facts: &Facts, delay_s: f64) -> Option<String> {
    let lag_ms = facts.servo_lag_ms? + (delay_s - facts.shown_delay_s) * 1e3;
    Some(format!("[ros2]\nservo_lag_ms = {:.1}", lag_ms.clamp(0.0, 100.0)))
}
