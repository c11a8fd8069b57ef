//! Measures an operator. A T-pose held still gives the lengths and the trunk's lean. Moving arms give the axes of
//! the elbows. The robot takes no part and must not be engaged.

use crate::{mode, only_disengaged};
use bus::{BusError, Domain, Reader};
use config::{Operator, Operators};
use explain::dropped_now;
use instance::Instance;
use messages::{
    CalibrationSource, InputStatus, Layout, Mode, Service, Skeleton, Status, calibration_flag, raw_flag, skeleton_flag,
};
use operator::{Client, OperatorError};
use rt::{err, out};
use skeleton::{Calibration, Pose, TPose};
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Polling period, shorter than the frame period of the fastest client.
const LOOK: Duration = Duration::from_millis(4);
/// Polling period of the robot's mode.
const PRINT_PERIOD: Duration = Duration::from_secs(1);
/// Time between two updates of the line in a terminal.
const DRAW_PERIOD: Duration = Duration::from_millis(100);
/// Time for which the person holds the T-pose, ns.
const HOLD_NS: u64 = 2_000_000_000;
/// Fewest frames with both elbows flexed that the axes need: one second at 60 Hz, three at 20 Hz.
const FLEXED_MIN: u32 = 60;
/// Time limit of each step.
const PATIENCE: Duration = Duration::from_secs(60);

/// Advice while no person is seen.
const NOBODY: &str = "No skeletons come. Start your client, or let a built-in person be measured, in another terminal: \
                      replay builtin:calibration. Wait a second after the client before it has ended.";

/// The measurement to make, and its destination.
pub struct Job<'a> {
    pub name: &'a str,
    pub folder: PathBuf,
    /// Process for which the measurement is made. Without it, nothing is written any more.
    pub child_of: Option<u32>,
}

/// Reads the instance's data about the person.
struct StateObserver {
    skeletons: Reader<Skeleton>,
    inputs: Reader<InputStatus>,
    input: InputStatus,
    /// Session of the newest frame.
    session: u64,
    _domain: Domain,
}

impl StateObserver {
    fn open(run_dir: &Path) -> Result<Self, BusError> {
        let domain = Domain::open(Instance::unmade(run_dir).core_domain(), "calibrate")?;
        let (skeletons, inputs) = (domain.reader(Service::Skeleton)?, domain.reader(Service::InputStatus)?);
        Ok(Self { skeletons, inputs, input: InputStatus::ZERO, session: 0, _domain: domain })
    }

    /// Returns the person if there is a new frame. Of a mirror image it is the person before the mirror, whose sides the file
    /// names.
    fn look(&mut self) -> Option<Skeleton> {
        self.input = self.inputs.latest().unwrap_or(self.input);
        let seen = self.skeletons.latest();
        let is_image = |person: &Skeleton| person.flags & skeleton_flag::IMAGE != 0;
        let person = seen.map(|seen| if is_image(&seen) { skeleton::mirror_image(&seen) } else { seen });
        self.session = person.map_or(self.session, |person| person.session_nonce);
        person
    }

    /// Identifies the visible person: the session, the client's person, the layout.
    fn who(&self) -> (u64, u32, u32) {
        (self.session, self.input.operator_id, self.input.layout)
    }
}

/// Measures the operator and writes the file. Returns false if that was not possible.
pub fn run(client: &mut Client, run_dir: &Path, job: &Job<'_>) -> Result<bool, OperatorError> {
    if let Some(why) = refusal(&client.heartbeat()?, run_dir) {
        err!("teleopctl: {why}");
        return Ok(false);
    }
    let mut observer = match StateObserver::open(run_dir) {
        Ok(observer) => observer,
        Err(error) => {
            err!("teleopctl: {error}");
            return Ok(false);
        }
    };
    out!("Stand upright with both arms straight out to the sides, and hold still for 2 s.");
    let mut pose = TPose::default();
    let posed =
        wait(client, &mut observer, job, |observer, status| match observer.look().map(|person| pose.add(&person)) {
            Some(Pose::Held(ns)) if ns >= HOLD_NS => Step::Done,
            Some(Pose::Held(ns)) => Step::Going(format!("hold still: {:.1} of {:.0} s", s(ns), s(HOLD_NS))),
            Some(pose) => Step::Going(hint(pose).to_owned()),
            None => Step::Silent(dropped_now(status)),
        })?;
    let (Some(mut calibration), true) = (pose.measured(), posed) else { return Ok(false) };
    let who = observer.who();
    let (_, operator_id, layout) = who;
    if let Some(why) = name_conflict(job, operator_id, layout) {
        err!("teleopctl: {why}; nothing was written");
        return Ok(false);
    }
    if observer.input.flags & raw_flag::ROTATIONS != 0 {
        out!("Good. Now move both arms up and down, and bend and stretch the elbows a few times.");
        let begun = observer.input.online.samples;
        let flexed = wait(client, &mut observer, job, |observer, status| {
            let seen = observer.look().is_some();
            let online = observer.input.online;
            let bent = online.samples.saturating_sub(begun);
            match (bent >= FLEXED_MIN && online.flags == calibration_flag::ALL, seen) {
                (true, _) => Step::Done,
                (false, true) => Step::Going(format!("elbows bent in {bent} frames, {FLEXED_MIN} are needed")),
                (false, false) => Step::Silent(dropped_now(status)),
            }
        })?;
        if !flexed {
            err!(
                "teleopctl: the rotations do not show the elbows' axes; check that they move with the arms; nothing \
                was written"
            );
            return Ok(false);
        }
        calibration.hinges = observer.input.online;
    } else {
        out!("Good. This client sends no rotations, so the elbows' axes come from the arms' planes as they move.");
    }
    observer.look();
    if observer.who() != who {
        err!("teleopctl: the person changed after the T-pose; nothing was written");
        return Ok(false);
    }
    if !may_go_on(job, &client.heartbeat()?) {
        return Ok(false);
    }
    let operator = Operator { name: job.name.to_owned(), operator_id, layout, calibration };
    Ok(store(&operator, &job.folder))
}

fn refusal(status: &Status, run_dir: &Path) -> Option<String> {
    if mode(status) != Mode::Disengaged {
        return Some(only_disengaged(status, "calibrated to", &instance::read_names(run_dir)));
    }
    let robot = operator::linked_robot(run_dir)?;
    let folder = run_dir.display();
    Some(format!(
        "{folder}: an operator's end of a link to robot {robot} runs there, and persons are measured at the robot's machine"
    ))
}

/// Returns false, and says why, if the robot was engaged or the caller has ended meanwhile.
fn may_go_on(job: &Job<'_>, status: &Status) -> bool {
    let is_free = mode(status) == Mode::Disengaged;
    if !is_free {
        err!("teleopctl: the robot is {} now; nothing was written", mode(status).name());
    }
    is_free && !rt::is_orphaned(job.child_of)
}

/// Returns the reason why this person cannot have a file of that name.
fn name_conflict(job: &Job<'_>, operator_id: u32, layout: u32) -> Option<String> {
    let known = match Operators::read(&job.folder) {
        Ok(known) => known,
        Err(error) => return Some(error.to_string()),
    };
    let why = known.refuses(job.name, operator_id, layout)?;
    Some(format!("{}: {why}", job.folder.display()))
}

fn store(operator: &Operator, folder: &Path) -> bool {
    let Calibration { lengths_m: [a, b, c, d], torso_lean_rad, hinges } = operator.calibration;
    let path = match operator.write(folder) {
        Ok(path) => path,
        Err(error) => {
            err!("teleopctl: {}: {error}", folder.display());
            return false;
        }
    };
    out!("upper arms        {a:.3} m left, {c:.3} m right");
    out!("forearms          {b:.3} m left, {d:.3} m right");
    out!("trunk             leans back by {:.1} deg", torso_lean_rad.to_degrees());
    if hinges.flags == calibration_flag::ALL {
        out!("elbows            axes from {} frames", hinges.samples);
    }
    out!("written           {}", path.display());
    out!(
        "{} is measured. Now end the client, wait a second, and start it again: from then on it is used.",
        operator.name
    );
    out!("`teleopctl status` then says \"calibration       {}\".", CalibrationSource::Stored.name());
    true
}

enum Step {
    Done,
    /// Frames arrive. The text tells the progress, or the problem.
    Going(String),
    /// No frame arrived just now. The text tells why frames are dropped, if they are.
    Silent(Option<String>),
}

/// Waits until a step is done, and updates a line meanwhile. Returns false if it took too long or the robot was
/// engaged.
fn wait(
    client: &mut Client,
    observer: &mut StateObserver,
    job: &Job<'_>,
    mut look: impl FnMut(&mut StateObserver, &Status) -> Step,
) -> Result<bool, OperatorError> {
    let begun = Instant::now();
    let (mut status, mut asked, mut heard) = (client.heartbeat()?, begun, begun);
    let (mut line, mut hinted) = (Progress::new(), false);
    while begun.elapsed() < PATIENCE {
        match look(observer, &status) {
            Step::Done => return Ok(true),
            Step::Going(progress) => heard = line.draw(&progress),
            Step::Silent(why) if heard.elapsed() > PRINT_PERIOD => {
                if why.is_none() && !std::mem::replace(&mut hinted, true) {
                    line.print(NOBODY);
                }
                line.draw(why.as_deref().unwrap_or("no skeletons arrive"));
            }
            Step::Silent(_) => {}
        }
        if asked.elapsed() > PRINT_PERIOD {
            asked = Instant::now();
            status = client.heartbeat()?;
            if mode(&status) != Mode::Disengaged || rt::is_orphaned(job.child_of) {
                drop(line);
                return Ok(may_go_on(job, &status));
            }
        }
        std::thread::sleep(LOOK);
    }
    drop(line);
    err!("teleopctl: not done within {} s; nothing was written", PATIENCE.as_secs());
    Ok(false)
}

/// A line that shows the progress of a step. In a terminal it is redrawn in place. Elsewhere it is a new line, once a second
/// at most.
struct Progress {
    terminal: bool,
    drawn: Option<Instant>,
    last: String,
}

impl Progress {
    fn new() -> Self {
        Self { terminal: std::io::stdout().is_terminal(), drawn: None, last: String::new() }
    }

    /// Shows `text`, unless the last update is too recent. Returns the present time.
    fn draw(&mut self, text: &str) -> Instant {
        let now = Instant::now();
        let every = if self.terminal { DRAW_PERIOD } else { PRINT_PERIOD };
        let soon = self.drawn.is_some_and(|drawn| now - drawn < every);
        if soon || text == self.last {
            return now;
        }
        if self.terminal {
            let columns = ratatui::crossterm::terminal::size().map_or(0, |(columns, _)| usize::from(columns));
            // A terminal of unknown width counts as 80 columns wide.
            let columns = if columns == 0 { 80 } else { columns };
            let text: String = text.chars().take(columns.saturating_sub(3)).collect();
            let _ = write!(std::io::stdout(), "\r\x1b[2K  {text}").and_then(|()| std::io::stdout().flush());
        } else {
            out!("  {text}");
        }
        (self.drawn, self.last) = (Some(now), text.to_owned());
        now
    }

    fn print(&mut self, text: &str) {
        self.clear();
        out!("{text}");
    }

    /// Clears the line, so that the next output begins where it began.
    fn clear(&self) {
        if self.terminal && self.drawn.is_some() {
            let _ = write!(std::io::stdout(), "\r\x1b[2K").and_then(|()| std::io::stdout().flush());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

fn s(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

fn hint(pose: Pose) -> &'static str {
    match pose {
        Pose::Unseen => "shoulders, elbows, wrists and hips must all be seen",
        Pose::Leaning => "stand upright",
        Pose::ArmsNotOut => "arms straight out to the sides, at the height of the shoulders",
        Pose::Held(_) => "hold still",
    }
}
