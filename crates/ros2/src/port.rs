//! The driver's port: wait-free on the loop's side, DDS in a thread of its own.

use crate::estimate::{Sample, Sent};
use crate::link::Link;
use crate::preflight;
use crate::trajectory::{Command, Executed, PERIOD_TICKS};
use config::Loaded;
use driver::{Driver, Drives, Measured, Motion, Setpoint};
use messages::{JOINTS_MAX, Stamp, StopPlan, TICK_S};
use rtrb::{Consumer, Producer, RingBuffer};

/// Time between two looks of the thread at DDS, ns.
const LOOK_NS: u64 = 1_000_000;
/// Commands and samples in flight. The thread looks once a millisecond, so more than a few means that it stands.
const RING: usize = 64;
/// A measurement that stays exactly the same while the joint is commanded to move by more than this counts as stuck,
/// rad or m. `safety` uses the same distance.
const STUCK: f64 = 0.02;
/// Samples in a row that must be the same. At 50 Hz it is 0.1 s.
const STUCK_SAMPLES: u32 = 5;

/// Message from the thread to the loop.
#[derive(Clone, Copy, Debug)]
struct News {
    sample: Sample,
    drives: Drives,
    refused: bool,
}

/// A robot behind trajectory controllers.
pub struct Ros2 {
    commands: Producer<Command>,
    news: Consumer<News>,
    newest: News,
    sent: Sent,
    last_k: u64,
    delay_ns: u64,
    expected_ns: u64,
    stuck: Stuck,
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
    /// Connects to the robot of `loaded`, and judges it. The error has the sentences of all checks that failed.
    pub fn open(loaded: &Loaded) -> Result<Self, String> {
        let (model, settings) = (&loaded.model, &loaded.settings.ros2);
        if loaded.settings.sim.interface != config::RobotInterface::Jtc100 {
            return Err(
                "sim.interface must be \"jtc100\": trajectory controllers are what whole-body control must certify"
                    .into(),
            );
        }
        let mut link = Link::open(model, settings)?;
        let failures = preflight::judge(&mut link, model, !settings.emergency_stop_topic.is_empty());
        if !failures.is_empty() {
            return Err(format!("the robot is not ready:\n  {}", failures.join("\n  ")));
        }
        let heard = link.heard.clone().ok_or("no joint_states arrived")?;
        let newest = News { sample: heard.sample, drives: Drives::SOUND, refused: false };
        let (commands, from_loop) = RingBuffer::new(RING);
        let (to_loop, news) = RingBuffer::new(RING);
        std::thread::Builder::new()
            .name("ros2-link".into())
            .spawn(move || serve(link, from_loop, to_loop))
            .map_err(|error| format!("the thread of DDS cannot start: {error}"))?;
        let delay_s = (settings.delay_ms + settings.servo_lag_ms) * 1e-3;
        let expected_s =
            f64::from(loaded.settings.servo_delay_ticks()) * TICK_S + loaded.settings.sim.interface.delay_s();
        let stuck = Stuck { q: heard.sample.q, sent: heard.sample.q, same: [0; JOINTS_MAX], found: false };
        Ok(Self {
            commands,
            news,
            newest,
            sent: Sent::default(),
            last_k: 0,
            delay_ns: (delay_s * 1e9) as u64,
            expected_ns: (expected_s * 1e9) as u64,
            stuck,
        })
    }
}

impl Driver for Ros2 {
    fn read(&mut self, now: Stamp) -> Measured {
        while let Ok(news) = self.news.pop() {
            self.newest = news;
            let then = Stamp(news.sample.measured.0.saturating_sub(self.delay_ns));
            if let Some(sent) = self.sent.at(then) {
                self.stuck.judge(&news.sample.q, &sent.q);
            }
        }
        let News { sample, drives, refused } = self.newest;
        let Sample { measured, q, dq } = self.sent.estimate(&sample, now, self.delay_ns, self.expected_ns);
        let drives = Drives { fault: drives.fault || self.stuck.found, ..drives };
        Measured { stamp: measured, q, dq, drives, unanswered: false, refused }
    }

    fn write(&mut self, _now: Stamp, setpoint: &Setpoint, plan: &StopPlan) -> bool {
        let &Setpoint { k, q, v, a } = setpoint;
        let motion = Motion { q, v, a, plan: *plan };
        // A robot that does not follow is where it measures.
        let follows = self.newest.drives.powered && !self.newest.refused;
        if !follows {
            self.sent.forget();
        }
        self.sent.note(&Executed::of(k, &motion));
        if k / PERIOD_TICKS == self.last_k / PERIOD_TICKS {
            return follows;
        }
        self.last_k = k;
        self.commands.push(Command { k, motion }).is_ok() && follows
    }
}

/// The thread: sends the newest command, and passes on what the robot says.
fn serve(mut link: Link, mut commands: Consumer<Command>, mut news: Producer<News>) {
    let (mut told, mut due) = (None, Vec::with_capacity(RING));
    loop {
        let now = rt::now();
        let heard = link.hear(now);
        due.clear();
        due.extend(std::iter::from_fn(|| commands.pop().ok()));
        let refused = !link.send(&due, rt::now());
        let fault = complaint(&link, now);
        if fault != told {
            if let Some(sentence) = &fault {
                tracing::error!("{sentence}");
            }
            told.clone_from(&fault);
        }
        if (heard || refused)
            && let Some(heard) = &link.heard
        {
            let emergency_stop = link.pressed == Some(true);
            let drives = Drives { emergency_stop, fault: fault.is_some(), powered: !emergency_stop };
            // A full ring means that the loop stands. It then reads an old sample, and notices.
            let _ = news.push(News { sample: heard.sample, drives, refused });
        }
        if commands.is_abandoned() {
            return;
        }
        rt::sleep_until(now.plus_ns(LOOK_NS));
    }
}

/// Returns a sentence on a controller that can no longer be driven.
fn complaint(link: &Link, now: Stamp) -> Option<String> {
    link.controllers(now).iter().find_map(|seen| {
        let name = &seen.name;
        if !seen.active {
            Some(format!("controller `{name}` fell silent: it was switched off, or the network is cut"))
        } else if seen.other_joints {
            Some(format!("controller `{name}` has other joints now"))
        } else if seen.publishers > 0 {
            Some(format!("another program may send to {}", seen.topic))
        } else {
            None
        }
    })
}
