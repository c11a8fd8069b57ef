//! The driver's port: wait-free on the loop's side, DDS in a thread of its own.

use crate::estimate::{Sample, Sent};
use crate::interface::{disagreement, period_ticks};
use crate::join::HELD;
use crate::lag::Lag;
use crate::link::{Link, Seen};
use crate::preflight;
use crate::trajectory::{Command, Executed};
use config::{Loaded, Policy, Ros2Settings};
use driver::{Driver, Drives, Measured, Setpoint};
use messages::{GripperMotion, GripperState, JOINTS_MAX, JointMotion, Stamp, StopPlan, TICK_S};
use robot::{Model, SetpointKind};
use rtrb::{Consumer, Producer, RingBuffer};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// SCHED_FIFO priority of the threads of DDS. It is far below that of the loops. Without it other work delayed messages by
/// 54 ms on two busy cores.
const PRIORITY: u8 = 10;
/// Time between two looks of the thread at DDS, ns.
const LOOK_NS: u64 = 1_000_000;
/// Time between two lines of the log on the robot's state, ns. It is a choice.
const LINE_NS: u64 = 1_000_000_000;
/// Commands and samples in flight. The thread looks once a millisecond, so more than a few means that it stands.
const RING: usize = 64;
/// A measurement that stays exactly the same while the joint is commanded to move by more than this counts as stuck,
/// rad or m. `safety` uses the same distance.
const STUCK: f64 = 0.02;
/// Samples in a row that must be the same. At 50 Hz it is 0.1 s.
const STUCK_SAMPLES: u32 = 5;

/// Longest time for which the end of the driver waits for its thread: a stop of 0.5 s and a weight that falls for 5 s.
const END_WITHIN: Duration = Duration::from_millis(6_500);

/// Message from the loop to the thread. The grippers are none until the driver knows where they are.
type Order = (Command, Option<GripperMotion>);

/// Message from the thread to the loop.
#[derive(Clone, Copy, Debug)]
struct News {
    sample: Sample,
    /// Positions at which the robot is held, rad or m.
    reference: [f64; JOINTS_MAX],
    drives: Drives,
    /// The robot executes what it is sent.
    joined: bool,
    /// The grippers, if the robot shows them.
    gripped: Option<GripperState>,
}

/// A robot that speaks DDS.
pub struct Ros2 {
    /// None once the driver ends.
    commands: Option<Producer<Order>>,
    grippers: Option<GripperMotion>,
    thread: Option<JoinHandle<()>>,
    period_ticks: u64,
    news: Consumer<News>,
    newest: News,
    sent: Sent,
    last_k: u64,
    delay_ns: u64,
    expected_ns: u64,
    stuck: Stuck,
    lag: Lag,
    servo_lag_ms: f64,
}

/// Judges whether an encoder is stuck. The estimate moves between samples, so nobody else could see it.
#[derive(Clone, Copy, Debug)]
struct Stuck {
    q: [f64; JOINTS_MAX],
    sent: [f64; JOINTS_MAX],
    same: [u32; JOINTS_MAX],
    found: bool,
}

impl Stuck {
    fn judge(&mut self, measured: &[f64; JOINTS_MAX], sent: &[f64; JOINTS_MAX]) {
        self.found = false;
        for j in 0..JOINTS_MAX {
            if measured[j] != self.q[j] {
                (self.q[j], self.sent[j], self.same[j]) = (measured[j], sent[j], 0);
            } else {
                self.same[j] = self.same[j].saturating_add(1);
                self.found |= self.same[j] >= STUCK_SAMPLES && (sent[j] - self.sent[j]).abs() > STUCK;
            }
        }
    }
}

impl Ros2 {
    /// Connects to the robot of `loaded`, and judges it. The threads of DDS get `cores`. The error has the sentences of all checks that failed.
    pub fn open(loaded: &Loaded, cores: Option<&[usize]>) -> Result<Self, String> {
        let (model, settings, interface) = (&loaded.model, &loaded.settings.ros2, loaded.settings.ros2.setpoints);
        if let Some(disagreement) = disagreement(&loaded.settings, model) {
            return Err(format!("{}: {disagreement}", loaded.config_name()));
        }
        let (commands, from_loop) = RingBuffer::new(RING);
        let (to_loop, news) = RingBuffer::new(RING);
        let (tell, told) = std::sync::mpsc::channel();
        let (own, named, cores) = (model.clone(), settings.clone(), cores.map(<[usize]>::to_vec));
        let fifo = loaded.settings.realtime.policy == Policy::Fifo;
        let thread = std::thread::Builder::new()
            .name("ros2-link".into())
            .spawn(move || {
                // The threads of DDS are started from here. On the loops' core they would wait for the loops. Without
                // rights, or on one core, they take what is left.
                if let Some(cores) = cores {
                    let _ = rt::Realtime::keep_to(&cores);
                }
                if fifo {
                    let _ = rt::Realtime::fifo_with_children(PRIORITY);
                }
                let ready = ready(&own, &named, interface);
                let (link, first) = match ready {
                    Ok((link, first)) => (Some(link), Ok(first)),
                    Err(cause) => (None, Err(cause)),
                };
                // The opener waits for this.
                let _ = tell.send(first);
                if let Some(link) = link {
                    serve(link, from_loop, to_loop);
                }
            })
            .map_err(|error| format!("the thread of DDS cannot start: {error}"))?;
        let newest: News = told.recv().map_err(|_| "the thread of DDS ended")??;
        let delay_s = loaded.settings.ros2_behind_ms() * 1e-3;
        let expected_s =
            f64::from(loaded.settings.servo_delay_ticks()) * TICK_S + loaded.settings.interface().delay_s();
        let q = newest.sample.q;
        let stuck = Stuck { q, sent: q, same: [0; JOINTS_MAX], found: false };
        Ok(Self {
            commands: Some(commands),
            grippers: None,
            thread: Some(thread),
            period_ticks: period_ticks(interface),
            news,
            newest,
            sent: Sent::default(),
            last_k: 0,
            delay_ns: (delay_s * 1e9) as u64,
            expected_ns: (expected_s * 1e9) as u64,
            stuck,
            lag: Lag::default(),
            servo_lag_ms: settings.servo_lag_ms,
        })
    }
}

/// Connects to the robot and judges it. Returns the connection and the first news.
fn ready(model: &Model, settings: &Ros2Settings, interface: SetpointKind) -> Result<(Link, News), String> {
    let mut link = Link::open(model, settings, interface, true)?;
    let failures = preflight::judge(&mut link, model, settings);
    link.forget_description();
    link.describe_hands();
    if !failures.is_empty() {
        return Err(format!("the robot is not ready:\n  {}", failures.join("\n  ")));
    }
    link.begin()?;
    let heard = link.heard.clone().ok_or("no joint_states arrived")?;
    let gripped = link.gripped(rt::now());
    let first = News { sample: heard.sample, reference: link.held(), drives: Drives::SOUND, joined: true, gripped };
    Ok((link, first))
}

impl Driver for Ros2 {
    fn read(&mut self, now: Stamp) -> Measured {
        while let Ok(news) = self.news.pop() {
            self.newest = news;
            let then = Stamp(news.sample.measured.0.saturating_sub(self.delay_ns));
            if let Some(sent) = self.sent.at(then).filter(|_| news.joined && news.drives.powered) {
                self.stuck.judge(&news.sample.q, &sent.q);
                self.lag.add(&sent, &news.sample.q);
            }
        }
        let News { sample, reference, drives, joined, .. } = self.newest;
        let Sample { measured, mut q, dq } = match drives.powered && joined {
            true => self.sent.estimate(&sample, now, self.delay_ns, self.expected_ns),
            false => sample,
        };
        // Where the driver begins, the controllers already hold the robot. Their setpoint is not the measurement: the
        // servos' steady error lies between.
        let near = (0..JOINTS_MAX).all(|j| (reference[j] - sample.q[j]).abs() <= HELD);
        if drives.powered && near && !(joined && self.sent.has_any()) {
            q = reference;
        }
        let drives = Drives { fault: drives.fault || self.stuck.found, ..drives };
        Measured { stamp: measured, q, dq, drives, unanswered: false, refused: !joined }
    }

    fn write(&mut self, _now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        let &Setpoint { k, q, v, a } = setpoint;
        let motion = JointMotion { q, v, a, plan: *plan };
        // A robot that does not follow is where it measures.
        let follows = self.newest.drives.powered && self.newest.joined;
        if !follows {
            self.sent.forget();
        }
        self.sent.note(&Executed::of(k, &motion));
        if k / self.period_ticks == self.last_k / self.period_ticks {
            return follows;
        }
        self.last_k = k;
        let order = (Command { k, motion }, self.grippers);
        self.commands.as_mut().is_some_and(|commands| commands.push(order).is_ok()) && follows
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.grippers = Some(*grippers);
    }

    fn gripped(&self) -> Option<GripperState> {
        self.newest.gripped
    }
}

impl Drop for Ros2 {
    fn drop(&mut self) {
        // The thread stops a robot that cannot stop by itself, and ends.
        self.commands = None;
        let give_up = Instant::now() + END_WITHIN;
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < give_up {
            std::thread::sleep(Duration::from_millis(1));
        }
        if let Some(advice) = self.lag.advice(self.servo_lag_ms) {
            tracing::warn!("{advice}");
        }
    }
}

/// Says when the log gets a line on the robot's state. A state that comes and goes gets one line a second. A fault that ends
/// before its line is due gets it all the same.
#[derive(Debug, Default)]
struct Complaints {
    told: Option<String>,
    told_at: Option<Stamp>,
    newest: Option<String>,
    /// The first sentence since the last line, if it was another one.
    missed: Option<String>,
    changes: u32,
}

impl Complaints {
    /// Takes the state of now. `None` is a sound robot. Returns the number of changes since the last line if a line is due.
    fn due(&mut self, sentence: &Option<String>, now: Stamp) -> Option<u32> {
        if *sentence != self.newest {
            self.newest.clone_from(sentence);
            self.changes += 1;
            if self.missed.is_none() && *sentence != self.told {
                self.missed.clone_from(sentence);
            }
        }
        let waits = self.told_at.is_some_and(|told_at| now.since(told_at) < LINE_NS);
        if waits || (self.newest == self.told && self.missed.is_none()) {
            return None;
        }
        (self.told, self.told_at) = (self.missed.take().or_else(|| self.newest.clone()), Some(now));
        Some(std::mem::take(&mut self.changes))
    }

    /// The state that the line is about. `None` is a sound robot.
    fn told(&self) -> Option<&str> {
        self.told.as_deref()
    }
}

/// The thread: sends the newest command, and passes on what the robot says.
fn serve(mut link: Link, mut commands: Consumer<Order>, mut news: Producer<News>) {
    let (mut complaints, mut hands, mut due) = (Complaints::default(), Idle::default(), Vec::with_capacity(RING));
    loop {
        let now = rt::now();
        let heard = link.hear(now);
        due.clear();
        let mut grippers = None;
        while let Ok((command, motion)) = commands.pop() {
            due.push(command);
            grippers = motion;
        }
        link.mind_silence(now);
        let joined = link.send(&due, rt::now());
        if let Some(command) = due.last() {
            link.grip(command.k, grippers.as_ref(), joined, now);
            hands.tell(&link, now);
        }
        let fault = complaint(&link, now);
        let sentence = fault.clone().or_else(|| link.departed().map(str::to_owned));
        if let Some(changes) = complaints.due(&sentence, now) {
            let often = if changes > 1 { format!(" ({changes} changes in between)") } else { String::new() };
            match complaints.told() {
                Some(sentence) => tracing::error!("{}: {sentence}{often}", link.consequence()),
                None => tracing::warn!("the robot executes again what it is sent{often}"),
            }
        }
        if (heard || !joined)
            && let Some(heard) = &link.heard
        {
            let emergency_stop = link.pressed == Some(true);
            let drives = Drives { emergency_stop, fault: fault.is_some(), powered: !emergency_stop };
            // A full ring means that the loop stands. It then reads an old sample, and notices.
            let gripped = link.gripped(now);
            let _ = news.push(News { sample: heard.sample, reference: link.held(), drives, joined, gripped });
        }
        if commands.is_abandoned() {
            return link.end();
        }
        rt::sleep_until(now.plus_ns(LOOK_NS));
    }
}

/// Returns a sentence on a controller of the arms that can no longer be driven.
fn complaint(link: &Link, now: Stamp) -> Option<String> {
    link.controllers(now).iter().find_map(|seen| seen.fault(!link.has_states()))
}

impl Seen {
    /// Returns a sentence if it cannot be driven. With `needs_reader`, somebody must read its commands.
    pub(crate) fn fault(&self, needs_reader: bool) -> Option<String> {
        let (name, topic) = (&self.name, &self.topic);
        if !self.active {
            Some(format!("controller `{name}` fell silent: it was switched off, or the network is cut"))
        } else if self.other_joints {
            Some(format!("controller `{name}` has other joints now"))
        } else if self.publishers > 0 {
            Some(format!("another program may send to {topic}"))
        } else if self.readers == 0 && needs_reader {
            Some(format!("nobody reads {topic} any more"))
        } else if self.readers > 1 {
            Some(format!("{} robots read {topic}", self.readers))
        } else {
            None
        }
    }
}

/// Says in the log when a hand is sent nothing, and when it is again.
#[derive(Debug, Default)]
struct Idle([Complaints; 2]);

impl Idle {
    fn tell(&mut self, link: &Link, now: Stamp) {
        for ((name, why), complaints) in link.hands().zip(&mut self.0) {
            if complaints.due(&why.map(str::to_owned), now).is_some() {
                match complaints.told() {
                    Some(why) => tracing::warn!("nothing is sent to `{name}`: {why}"),
                    None => tracing::info!("`{name}` executes what it is sent"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robot_that_falls_silent_every_20_ms_gets_one_line_a_second() {
        let mut complaints = Complaints::default();
        let silent = Some("the robot fell silent".to_owned());
        let lines: Vec<(u64, u32)> = (0..2_500)
            .filter_map(|ms| {
                let state = if (ms / 20) % 2 == 0 { None } else { silent.clone() };
                complaints.due(&state, Stamp(1 + ms * 1_000_000)).map(|changes| (ms, changes))
            })
            .collect();
        assert!(lines.len() == 3 && lines.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 1_000), "{lines:?}");
        assert_eq!(lines.iter().map(|(_, changes)| changes).sum::<u32>(), lines[2].0 as u32 / 20, "none is lost");
        // A state that lasts is always told, however short it is after the line before.
        let told = |complaints: &mut Complaints, state: &Option<String>, s: u64| {
            complaints.due(state, Stamp(s * 1_000_000_000)).map(|_| complaints.told().map(str::to_owned))
        };
        for s in 10..20 {
            told(&mut complaints, &None, s);
        }
        assert_eq!(complaints.told(), None);
        assert_eq!(told(&mut complaints, &None, 30), None, "nothing is new");
    }

    #[test]
    fn fault_that_ends_before_its_line_is_due_is_told() {
        let mut complaints = Complaints::default();
        let mut say = |state: Option<&str>, ms: u64| {
            let state = state.map(str::to_owned);
            complaints.due(&state, Stamp(ms * 1_000_000)).map(|_| complaints.told().map(str::to_owned))
        };
        assert_eq!(say(Some("first"), 1_000), Some(Some("first".into())));
        assert_eq!(say(None, 2_500), Some(None));
        assert_eq!((say(Some("second"), 2_600), say(None, 2_700)), (None, None));
        assert_eq!(say(None, 3_600), Some(Some("second".into())));
        assert_eq!(say(None, 4_700), Some(None), "and then that it is over");
        assert_eq!(say(None, 9_000), None);
    }
}
