//! A page as a client. Its person is the mix of three key poses, sent through the skeleton socket like any
//! client's. A page only sets shares. The lease, validation, the enable and the gate treat it like every client.

use crate::operator_worker::HOLD_FOR;
use crate::session::Session;
use crate::shares::Shares;
use crate::worker::Worker;
use instance::Instance;
use messages::RawSkeleton;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvError, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Time between two frames of the person: 60 Hz, like the key poses' motions.
const PERIOD: Duration = Duration::from_nanos(16_666_667);
/// Shortest time from one key pose to another, s. Between the default key poses the arms need 3.7 s at the speed
/// limits of their joints (`tests/key_poses.rs`). At this slower speed the arms keep up with the mix, and do not
/// lag on the way.
pub const EDGE_S: f64 = 4.0;
/// Largest change of a share per frame. It counts frames and not time, so there is no jump after a pause.
const STEP: f64 = 1.0 / (60.0 * EDGE_S);
/// The page receives its person's shares after this many frames: ten times a second.
const REPORT_STEPS: u64 = 6;

/// Returns the person for shares (none negative, sum 1) at a time in s since the mix began. The mixer fills in
/// header, session and operator of the frame later.
pub type PersonOf = dyn Fn(&[f64; 3], f64) -> RawSkeleton + Send + Sync;

/// Three key poses, and the person for every mix of them.
pub struct KeyPoses {
    /// Names of the corners.
    pub names: [String; 3],
    /// Returns the person for a mix.
    pub person: Box<PersonOf>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MixRequest {
    /// Become the client whose person the robot follows.
    Join,
    /// Move toward these shares. Also shows that the page is still open. Does nothing before a join.
    Mix(Shares),
    /// Stop being the client.
    Leave,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Mixed {
    pub on: bool,
    pub shares: Shares,
    pub text: Option<String>,
}

/// The mixer. Dropping it ends the person.
pub type Mixer = Worker<MixRequest, Mixed>;

impl Mixer {
    pub fn new(instance: &Instance, key_poses: &Arc<KeyPoses>) -> std::io::Result<Self> {
        let (instance, key_poses) = (instance.clone(), key_poses.clone());
        Self::start("mixer", |asked, answer| {
            let person = Person {
                session: Session::new(instance, HELD),
                key_poses,
                on: None,
                at: Shares::FIRST,
                asked: Shares::FIRST,
                begun: Instant::now(),
                answer,
            };
            person.work(asked);
        })
    }
}

/// State while the person is published.
#[derive(Clone, Copy)]
struct On {
    /// Time at which the page's silence ends the person.
    until: Instant,
    /// Time at which the next frame is due.
    due: Instant,
}

struct Person {
    key_poses: Arc<KeyPoses>,
    session: Session,
    on: Option<On>,
    at: Shares,
    asked: Shares,
    begun: Instant,
    answer: Sender<Mixed>,
}

impl Person {
    fn work(mut self, asked: &Receiver<MixRequest>) {
        loop {
            let turn = match self.on {
                None => asked.recv().map_err(|RecvError| RecvTimeoutError::Disconnected),
                Some(on) => asked.recv_timeout(on.due.saturating_duration_since(Instant::now())),
            };
            match turn {
                Ok(turn) => self.obey(turn),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // Runs after every request, whatever it is and however many arrive.
            self.advance();
        }
    }

    fn obey(&mut self, turn: MixRequest) {
        match turn {
            MixRequest::Join if self.on.is_some() => {}
            MixRequest::Join => match self.session.connect() {
                Ok(()) => {
                    let now = Instant::now();
                    // Continues from the last shares, so that a robot that still follows sees no jump.
                    (self.on, self.asked) = (Some(On { until: now + HOLD_FOR, due: now }), self.at);
                    self.send_report(None);
                }
                Err(why) => self.end(Some(why)),
            },
            MixRequest::Mix(shares) => {
                if let Some(on) = &mut self.on {
                    on.until = Instant::now() + HOLD_FOR;
                    self.asked = shares;
                }
            }
            MixRequest::Leave => self.end(None),
        }
    }

    fn advance(&mut self) {
        let now = Instant::now();
        let Some(on) = &mut self.on else { return };
        if on.until < now {
            return self.end(Some("The page stopped answering, so it no longer moves the robot.".to_owned()));
        }
        if now < on.due {
            return;
        }
        // A thread that stood still does not catch up.
        on.due = (on.due + PERIOD).max(now);
        let before = self.at;
        self.at = self.at.toward(self.asked, STEP);
        let at_s = now.saturating_duration_since(self.begun).as_secs_f64();
        let frame = (self.key_poses.person)(&self.at.get(), at_s);
        if let Err(why) = self.session.publish(frame, rt::now()) {
            return self.end(Some(why));
        }
        let arrives = self.at == self.asked && before != self.at;
        let moves = before != self.at && self.session.sequence.is_multiple_of(REPORT_STEPS);
        if arrives || moves {
            self.send_report(None);
        }
    }

    fn end(&mut self, text: Option<String>) {
        self.on = None;
        self.send_report(text);
    }

    fn send_report(&self, text: Option<String>) {
        let _ = self.answer.send(Mixed { on: self.on.is_some(), shares: self.at, text });
    }
}

/// Message to a page whose person cannot move the robot.
const HELD: &str = "Another client holds the lease, or held it a moment ago. Switch on again after it has \
    disconnected.";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ingest_double::{Ingest, await_some};
    use doors::LeaseState;
    use messages::{Layout, Stamp};
    use std::path::PathBuf;

    fn mixer() -> (tempfile::TempDir, PathBuf, Mixer) {
        let folder = tempfile::tempdir().expect("a folder");
        let instance = Instance::new(folder.path()).expect("an instance");
        let person = |shares: &[f64; 3], _: f64| {
            let mut frame = RawSkeleton::ZERO;
            frame.positions[0] = shares.map(|share| share as f32);
            frame
        };
        let key_poses = KeyPoses { names: ["a", "b", "c"].map(str::to_owned), person: Box::new(person) };
        let mixer = Mixer::new(&instance, &Arc::new(key_poses)).expect("a thread");
        (folder, instance.skeleton_socket(), mixer)
    }

    fn corner(n: usize) -> MixRequest {
        MixRequest::Mix(Shares::nearest(std::array::from_fn(|i| if i == n { 1.0 } else { 0.0 })).expect("numbers"))
    }

    /// Moves to a corner until so many more frames have come.
    fn move_for(ingest: &mut Ingest, more: usize, mixer: &Mixer, n: usize) {
        let enough = ingest.frames.len() + more;
        ingest.until(|ingest| {
            mixer.ask(corner(n));
            (ingest.frames.len() >= enough).then_some(())
        });
    }

    fn report(ingest: &mut Ingest, mixer: &Mixer, what: impl Fn(&Mixed) -> bool) -> Mixed {
        ingest.until(|_| mixer.answer().filter(&what))
    }

    fn assert_no_leap(frames: &[RawSkeleton]) {
        for pair in frames.windows(2) {
            let [a, b] = pair else { continue };
            assert!(b.header.sequence > a.header.sequence && b.header.origin > a.header.origin);
            let between = (b.header.sequence - a.header.sequence) as f32;
            for (x, y) in a.positions[0].iter().zip(b.positions[0]) {
                assert!((x - y).abs() <= STEP as f32 * between + 1e-6, "{:?} to {:?}", a.positions[0], b.positions[0]);
            }
        }
    }

    #[test]
    fn shares_never_jump_and_silent_page_ends_publishing() {
        let (_folder, path, mixer) = mixer();
        let ingest = &mut Ingest::at(&path);
        // A mix request before a join does nothing.
        mixer.ask(corner(2));
        mixer.ask(MixRequest::Join);
        assert_eq!(report(ingest, &mixer, |_| true), Mixed { on: true, shares: Shares::FIRST, text: None });
        move_for(ingest, 3, &mixer, 0);
        assert_eq!(ingest.frames[2].positions[0], [1.0, 0.0, 0.0]);
        for n in 0..40 {
            move_for(ingest, 1 + n % 9, &mixer, 1 + n / 2 % 2);
        }
        let silent = report(ingest, &mixer, |mixed| !mixed.on);
        assert!(silent.text.is_some_and(|text| text.contains("stopped answering")));
        mixer.ask(corner(0));
        std::thread::sleep(Duration::from_millis(200));
        // The person continues where it was, in the same session.
        mixer.ask(MixRequest::Join);
        move_for(ingest, 30, &mixer, 2);
        mixer.ask(MixRequest::Leave);
        report(ingest, &mixer, |mixed| !mixed.on && mixed.text.is_none());
        let frames = &ingest.frames;
        assert_no_leap(frames);
        let (first, last) = (frames[0], frames[frames.len() - 1]);
        assert!(first.session_nonce != 0 && frames.iter().all(|frame| frame.session_nonce == first.session_nonce));
        let pause = |a: &RawSkeleton, b: &RawSkeleton| {
            b.header.origin.since(a.header.origin) >= 200_000_000 && b.header.sequence == a.header.sequence + 1
        };
        assert!(frames.windows(2).any(|pair| pause(&pair[0], &pair[1])), "nothing is published in between");
        assert!(first.header.stamp > Stamp::NONE && first.header.incarnation == last.header.incarnation);
        assert!(last.positions[0][2] > 0.1, "it has moved");
    }

    #[test]
    fn lease_of_another_client_is_reported_and_session_replaced() {
        let (_folder, path, other) = mixer();
        let ingest = &mut Ingest::at(&path);
        ingest.held = true;
        other.ask(MixRequest::Join);
        assert_eq!(report(ingest, &other, |_| true).text.as_deref(), Some(HELD));
        assert!(ingest.frames.is_empty(), "nothing was published");
        ingest.held = false;
        other.ask(MixRequest::Join);
        assert!(report(ingest, &other, |_| true).on);
        move_for(ingest, 2, &other, 0);
        ingest.holds = LeaseState::NotHolder;
        let lost = ingest.until(|_| {
            other.ask(corner(0));
            other.answer().filter(|mixed| !mixed.on)
        });
        assert_eq!(lost.text.as_deref(), Some(HELD));
        ingest.holds = LeaseState::Holder;
        other.ask(MixRequest::Join);
        move_for(ingest, 2, &other, 0);
        let frames = &ingest.frames;
        assert!(frames[0].session_nonce != frames[frames.len() - 1].session_nonce);
    }

    #[test]
    fn page_without_ingest_gets_error() {
        let (_folder, path, mixer) = mixer();
        mixer.ask(MixRequest::Join);
        assert!(await_some(|| mixer.answer()).text.is_some_and(|text| text.contains("skeleton.sock")));
        let mut ingest = Ingest::at(&path);
        mixer.ask(MixRequest::Join);
        move_for(&mut ingest, 2, &mixer, 0);
        drop(ingest);
        let lost = await_some(|| {
            mixer.ask(corner(0));
            mixer.answer().filter(|mixed| !mixed.on)
        });
        assert!(lost.text.as_ref().is_some_and(|text| text.contains("lost")), "{lost:?}");
    }
}
