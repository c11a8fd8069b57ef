//! The steps with a robot and a person that are made up: no process, no clock.

use super::path::Path;
use super::ports::{Facts, Person, Robot, Sample, Stop, Victim};
use super::session::{Ended, Session};
use super::{description, tracking};
use messages::{JOINTS_MAX, Mode};
use std::cell::Cell;
use std::rc::Rc;

/// Time between two states, s.
const STEP_S: f64 = 0.01;
/// Delay from a command to its measurement, s: three states.
const DELAY_STATES: usize = 3;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Defect {
    #[default]
    Nothing,
    /// The measurement of this joint has the wrong sign.
    Sign(usize),
    Swapped(usize, usize),
    /// This joint moves half as far as commanded.
    Half(usize),
    /// The second joint moves along with the first one.
    Along(usize, usize),
    Unseen,
    Unlatched,
    /// This joint sinks while the emergency stop is pressed.
    Sinks(usize),
    /// The robot goes on after this process was killed.
    GoesOn(Victim),
    /// This joint jumps while this process starts again.
    Jumps(Victim, usize),
}

/// A robot in steps of [`STEP_S`].
struct Made {
    facts: Facts,
    defect: Defect,
    now_s: f64,
    home: [f64; JOINTS_MAX],
    path: Option<(Path, f64)>,
    /// The path that a killed process left, and the time of its end.
    dead: Option<f64>,
    past: Vec<[f64; JOINTS_MAX]>,
    mode: Mode,
    /// The button, as the person leaves it.
    button: Rc<Cell<bool>>,
    pressed: bool,
    latched: bool,
    jumped: bool,
}

impl Made {
    fn new(defect: Defect) -> Self {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
        let loaded = config::load(&file, config::Overrides::default()).expect("the shipped settings");
        let facts = Facts::from_settings(&loaded, false);
        let home = facts.model.home;
        let (path, dead, mode, button) = (None, None, Mode::Disengaged, Rc::default());
        let (past, pressed, latched, jumped) = (vec![home], false, false, false);
        Self { facts, defect, now_s: 100.0, home, path, dead, past, mode, button, pressed, latched, jumped }
    }

    fn look_at_button(&mut self) {
        let before = std::mem::replace(&mut self.pressed, self.button.get());
        if self.pressed && !before && self.defect != Defect::Unlatched {
            (self.mode, self.latched) = (Mode::Faulted, true);
        }
    }

    fn command(&self) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
        let Some((path, begun_s)) = &self.path else { return (self.home, [0.0; JOINTS_MAX]) };
        let until_s = self.dead.unwrap_or(self.now_s).min(self.now_s);
        let (q, dq) = path.at(until_s - begun_s);
        (q, if until_s < self.now_s { [0.0; JOINTS_MAX] } else { dq })
    }

    fn measured(&self) -> [f64; JOINTS_MAX] {
        let mut q = self.past[self.past.len().saturating_sub(DELAY_STATES + 1)];
        let home = self.home;
        match self.defect {
            Defect::Sign(j) => q[j] = 2.0 * home[j] - q[j],
            Defect::Swapped(a, b) => (q[a], q[b]) = (home[a] + q[b] - home[b], home[b] + q[a] - home[a]),
            Defect::Half(j) => q[j] = (home[j] + q[j]) / 2.0,
            Defect::Along(a, b) => q[b] += q[a] - home[a],
            Defect::Sinks(j) if self.pressed => q[j] -= 0.01,
            Defect::Jumps(_, j) if self.jumped => q[j] += 0.3,
            _ => {}
        }
        q
    }
}

impl Robot for Made {
    fn preflight(&mut self) -> Result<String, Stop> {
        Ok("made up".into())
    }

    fn begin(&mut self) -> Result<(), Stop> {
        Ok(())
    }

    fn watch(&mut self, time_s: f64) -> Result<Vec<Sample>, Stop> {
        self.look_at_button();
        let one = |made: &mut Self| {
            made.now_s += STEP_S;
            let (q, v) = made.command();
            made.past.push(q);
            let emergency_stop = made.pressed && made.defect != Defect::Unseen;
            let q_measured = made.measured();
            Sample { at_s: made.now_s, q, v, q_measured, emergency_stop, driver_fault: made.latched }
        };
        Ok((0..(time_s / STEP_S).ceil() as usize).map(|_| one(self)).collect())
    }

    fn engage(&mut self) -> Result<(), Stop> {
        assert_eq!(self.mode, Mode::Disengaged, "only a free robot is enabled");
        self.mode = Mode::Engaged;
        Ok(())
    }

    fn play(&mut self, path: &Path) -> Result<(), Stop> {
        assert_eq!(self.mode, Mode::Engaged, "only an enabled robot moves");
        let speed = (0..1000).map(|n| path.at(f64::from(n) / 1000.0 * path.period_s).1[path.joint].abs());
        assert!(speed.fold(0.0, f64::max) <= 0.0501 * self.facts.model.limits[path.joint].v_max, "5 % at most");
        (self.path, self.dead) = (Some((*path, self.now_s)), None);
        Ok(())
    }

    fn release(&mut self) -> Result<(), Stop> {
        (self.home, self.path) = (self.command().0, None);
        (self.mode, self.dead) = (if self.latched { Mode::Faulted } else { Mode::Disengaged }, None);
        Ok(())
    }

    fn reset(&mut self) -> Result<bool, Stop> {
        if !self.pressed {
            (self.mode, self.latched) = (Mode::Disengaged, false);
        }
        Ok(!self.pressed)
    }

    fn mode(&mut self) -> Option<Mode> {
        Some(self.mode)
    }

    fn why(&mut self) -> String {
        "It is made up.".into()
    }

    fn kill(&mut self, victim: Victim) -> Result<f64, Stop> {
        if self.defect != Defect::GoesOn(victim) {
            self.dead = Some(self.now_s + 0.1);
        }
        Ok(self.now_s)
    }

    fn restart(&mut self, victim: Victim) -> Result<(), Stop> {
        self.jumped |= matches!(self.defect, Defect::Jumps(jumps, _) if jumps == victim);
        Ok(())
    }

    fn pause(&mut self, time_s: f64) -> Result<(), Stop> {
        self.watch(time_s).map(drop)
    }

    fn button(&self) -> String {
        String::new()
    }
}

/// A person who presses the button when asked to. Answers no to the first question that contains `refuses`.
struct Scripted {
    lines: Vec<String>,
    refuses: Option<&'static str>,
    button: Rc<Cell<bool>>,
}

impl Person for Scripted {
    fn print(&mut self, text: &str) {
        self.lines.push(text.to_owned());
    }

    fn confirm(&mut self, question: &str) -> Result<(), Stop> {
        self.print(question);
        if self.refuses.is_some_and(|words| question.contains(words)) {
            return Err(Stop::Refused("the person refused".into()));
        }
        if question.contains("emergency stop now") {
            self.button.set(question.contains("Press the"));
        }
        Ok(())
    }

    fn saw(&mut self, question: &str, otherwise: &str) -> Result<(), Stop> {
        self.print(question);
        let no = self.refuses.is_some_and(|words| question.contains(words));
        if no { Err(Stop::Failed(otherwise.to_owned())) } else { Ok(()) }
    }
}

fn run(defect: Defect, refuses: Option<&'static str>) -> (Result<Vec<String>, Ended>, Vec<String>, Vec<String>) {
    let mut robot = Made::new(defect);
    let (facts, button) = (robot.facts.clone(), Rc::clone(&robot.button));
    let mut person = Scripted { lines: Vec::new(), refuses, button };
    let mut session = Session { robot: &mut robot, person: &mut person, facts: &facts, proposals: Vec::new() };
    let outcome = session.run();
    let proposals = session.proposals;
    (outcome, person.lines, proposals)
}

#[test]
fn sound_robot_passes_every_step() {
    let (outcome, lines, proposals) = run(Defect::Nothing, None);
    let summary = outcome.expect("it passes");
    assert_eq!(summary.iter().filter(|line| line.ends_with(": passed")).count(), 5, "{summary:#?}");
    let moved = summary.iter().filter(|line| line.contains("commanded")).count();
    assert_eq!(moved, Made::new(Defect::Nothing).facts.model.count, "each joint: {summary:#?}");
    assert_eq!(summary.iter().filter(|line| line.contains("kill -9")).count(), 1 + Victim::ALL.len(), "{summary:#?}");
    assert!(summary.iter().any(|line| line.contains("29.9 ms from command to measurement")), "{summary:#?}");
    assert!(lines.iter().any(|line| line.contains("fingertips of the left hand went")), "{lines:#?}");
    assert!(proposals.is_empty(), "the simulated robot has no servo lag to set: {proposals:?}");
}

#[test]
fn defects_are_found_at_their_step_with_the_joint_named() {
    let facts = Made::new(Defect::Nothing).facts;
    let [left, right] = [0, 1].map(|arm| facts.model.arms[arm].range().start + 1);
    let (moving, _) = super::kills::free_joint(&facts, &facts.model.home, 0).expect("a joint that moves");
    let moving_name = facts.model.joint_names[moving].as_str();
    let names = [left, right].map(|joint| facts.model.joint_names[joint].as_str());
    for (defect, step, printed, named) in [
        (Defect::Unseen, "step 2", "does not show", ""),
        (Defect::Unlatched, "step 2", "does not latch", ""),
        (Defect::Sinks(left), "step 2", "moved by -10.0 mrad while the emergency stop", names[0]),
        (Defect::Sign(left), "step 3", "its sign differs", names[0]),
        (Defect::Swapped(left, right), "step 3", "their names are swapped", names[1]),
        (Defect::Half(right), "step 3", "they may differ by 5.0 mrad", names[1]),
        (Defect::Along(left, right), "step 3", "the bound is 5.0 mrad", names[1]),
        (Defect::GoesOn(Victim::Control), "step 4", "after kill -9 of control", ""),
        (Defect::GoesOn(Victim::Ingest), "step 4", "after kill -9 of ingest", ""),
        (Defect::Jumps(Victim::Ingest, right), "step 4", "after ingest was started again", names[1]),
        (Defect::Jumps(Victim::Driver, right), "step 4", "after the driver was started again", names[1]),
        (Defect::Jumps(Victim::Driver, moving), "step 4", "from where it was when the driver was killed", moving_name),
    ] {
        let (outcome, lines, _) = run(defect, None);
        let ended = outcome.expect_err("a defect");
        let Stop::Failed(why) = &ended.why else { panic!("{defect:?}: {ended:?}") };
        assert!(ended.step.starts_with(step), "{defect:?}: {ended:?}");
        assert!(why.contains(printed) && why.contains(named), "{defect:?}: {why}");
        let passed = lines.iter().filter(|line| line.starts_with("passed: ")).count();
        assert_eq!(format!("step {}", passed + 1), step, "{defect:?}: nothing follows the failed step");
    }
}

#[test]
fn refusal_ends_the_run_at_its_step() {
    let (outcome, ..) = run(Defect::Nothing, Some("press Enter"));
    let ended = outcome.expect_err("refused");
    assert_eq!(
        (ended.step.as_str(), ended.why),
        ("step 2 of 5, Emergency stop", Stop::Refused("the person refused".into()))
    );
    for (words, step) in [("You should have seen", "step 3"), ("Did the robot stop at once", "step 4")] {
        let ended = run(Defect::Nothing, Some(words)).0.expect_err("not seen");
        assert!(ended.step.starts_with(step) && matches!(ended.why, Stop::Failed(_)), "{ended:?}");
    }
}

#[test]
fn joint_without_room_fails_instead_of_being_skipped() {
    let facts = Made::new(Defect::Nothing).facts;
    let joint = facts.model.arms[0].range().start;
    let mut q = facts.model.home;
    let free = facts.travel(&q, joint).expect("home has room");
    q[joint] = if free > 0.0 { facts.model.limits[joint].q_max } else { facts.model.limits[joint].q_min };
    let other = facts.travel(&q, joint);
    assert!(other.as_ref().is_ok_and(|by| by * free < 0.0) || other.is_err(), "never into the limit: {other:?}");
    q[joint] = f64::NAN;
    let Err(Stop::Failed(why)) = facts.travel(&q, joint) else { panic!("NaN has no room") };
    assert!(why.starts_with(&facts.model.joint_names[joint]), "{why}");
}

#[test]
fn paths_are_smooth_and_survive_their_line() {
    let from = std::array::from_fn(|j| j as f64 * 0.1);
    for path in [Path::ramp(from, 3, -0.05, 0.1), Path::waves(from, 3, 0.05, 0.1, 5), Path::stand(from)] {
        assert_eq!(Path::from_line(&path.to_line()), Some(path));
        let (step_s, mut fastest) = (1e-4, 0.0_f64);
        for n in 0..(path.length_s() / step_s) as u32 {
            let t_s = f64::from(n) * step_s;
            let slope = (path.at(t_s + step_s).0[3] - path.at(t_s).0[3]) / step_s;
            assert!((slope - path.at(t_s + step_s / 2.0).1[3]).abs() < 1e-3, "{path:?} at {t_s} s");
            fastest = fastest.max(slope.abs());
        }
        assert!(path.by == 0.0 || (fastest - 0.1).abs() < 1e-3, "{fastest}");
        assert_eq!(path.at(path.length_s() + 1.0).1, [0.0; JOINTS_MAX], "it stands at its end");
    }
    for line in ["", "{}", r#"{"from":[1],"joint":0,"by":0,"period_s":1,"waves":0}"#] {
        assert_eq!(Path::from_line(line), None, "{line}");
    }
    assert_eq!(Path::from_line(&Path { period_s: 0.0, ..Path::stand(from) }.to_line()), None, "no duration");
}

#[test]
fn known_delay_is_measured_beside_an_offset() {
    let path = Path::waves([0.0; JOINTS_MAX], 2, 0.05, 0.1, 5);
    let sample = |t_s: f64| {
        let ((q, v), (mut q_measured, _)) = (path.at(t_s), path.at(t_s - 0.02));
        q_measured[2] += 0.001;
        Sample { at_s: t_s, q, v, q_measured, emergency_stop: false, driver_fault: false }
    };
    let samples: Vec<_> = (0..8000).map(|n| sample(f64::from(n) * 1e-3)).collect();
    let followed = tracking::fit(&samples, 2).expect("it moves");
    assert!((followed.delay_s - 0.02).abs() < 5e-4, "{followed:?}");
    assert!((followed.error_max - 0.003).abs() < 2e-4 && followed.rest_max < 2e-4, "{followed:?}");
    assert_eq!(tracking::fit(&samples, 3), None, "a joint that stands shows no delay");
}

#[test]
fn words_name_the_hand_that_moves_and_its_direction() {
    let facts = Made::new(Defect::Nothing).facts;
    let (model, q) = (&facts.model, &facts.model.home);
    let lift = model.lift.expect("a torso that slides");
    let up = description::visible_motion(model, q, lift, 0.01);
    assert!(up.contains("left hand went 10 mm up") && up.contains("right hand went 10 mm up"), "{up}");
    let down = description::visible_motion(model, q, lift, -0.01);
    assert!(down.contains("left hand went 10 mm down"), "{down}");
    let left = description::visible_motion(model, q, model.arms[0].range().start, 0.05);
    assert!(left.contains("left hand") && !left.contains("right hand") && left.contains("2.9 degrees"), "{left}");
}
