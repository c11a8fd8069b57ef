//! The steps in their order. Each is shown, confirmed and judged. The first that fails ends the run. Does no IO and
//! reads no clock.

use super::ports::{Facts, Person, Robot, Stop};
use super::{emergency, joints, kills, tracking};

pub struct Session<'a> {
    pub robot: &'a mut dyn Robot,
    pub person: &'a mut dyn Person,
    pub facts: &'a Facts,
    /// Settings that the run proposes, as TOML.
    pub proposals: Vec<String>,
}

struct Step {
    title: &'static str,
    shows: &'static str,
    work: fn(&mut Session<'_>) -> Result<Vec<String>, Stop>,
}

const STEPS: [Step; 5] = [
    Step { title: "Preflight", shows: "Checks machine, settings and robot. Nothing moves.", work: preflight },
    Step {
        title: "Emergency stop",
        shows: "Starts the driver and control. When you are asked, you press the robot's emergency stop, and release it. Nothing moves.",
        work: emergency::run,
    },
    Step {
        title: "Joints, one by one",
        shows: "Each joint moves a little and back, at 5 % of its speed. Keep a hand on the emergency stop.",
        work: joints::run,
    },
    Step {
        title: "kill -9 of every process",
        shows: "A joint moves slowly, a process is killed, and the robot must stop by itself. Keep a hand on the \
                emergency stop.",
        work: kills::run,
    },
    Step {
        title: "Delay and tracking",
        shows: "One joint of each arm swings slowly. The run measures how far the robot is behind.",
        work: tracking::run,
    },
];

#[derive(Debug, PartialEq)]
pub struct Ended {
    pub step: String,
    pub why: Stop,
}

impl Session<'_> {
    /// Runs all steps. Returns a line for each.
    pub fn run(&mut self) -> Result<Vec<String>, Ended> {
        let mut summary = Vec::new();
        for (index, Step { title, shows, work }) in STEPS.into_iter().enumerate() {
            let step = format!("step {} of {}, {title}", index + 1, STEPS.len());
            self.person.print(&format!("\n{step}\n{shows}"));
            let done = self.person.confirm("Enter begins.").and_then(|()| work(self));
            let found = done.map_err(|why| Ended { step: step.clone(), why })?;
            self.person.print(&format!("passed: {step}"));
            summary.push(format!("{step}: passed"));
            summary.extend(found.into_iter().map(|line| format!("    {line}")));
        }
        Ok(summary)
    }
}

pub fn require(passed: bool, sentence: impl FnOnce() -> String) -> Result<(), Stop> {
    if passed { Ok(()) } else { Err(Stop::Failed(sentence())) }
}

fn preflight(run: &mut Session<'_>) -> Result<Vec<String>, Stop> {
    let found = run.robot.preflight()?;
    run.person.print(&found);
    Ok(Vec::new())
}
