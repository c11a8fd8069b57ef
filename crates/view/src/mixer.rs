//! A page as a client: the person that is the mix of three key poses, published through the skeleton socket like any
//! client's. A page asks for shares alone; the lease, validation, the enable and the gate are those of every client.

use crate::operator_worker::HOLD_FOR;
use crate::shares::Shares;
use crate::worker::Worker;
use doors::{Client, DoorError, Reply};
use messages::RawSkeleton;
use pipeline::Instance;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvError, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Time between two frames of the person: 60 Hz, as the key poses' motions have.
const PERIOD: Duration = Duration::from_nanos(16_666_667);
/// From one key pose to another at the fastest, s. Between ours the arms need 3.7 s at the speed limits of their joints
/// (`tests/key_poses.rs`): so much slower, they are where the mix is, and not somewhere on the way to it.
pub const EDGE_S: f64 = 4.0;
/// Largest change of a share from frame to frame. It is counted in frames and not in time: after a pause there is no leap.
const STEP: f64 = 1.0 / (60.0 * EDGE_S);
/// A page is told where its person is after so many frames: ten times a second.
const TELL_EVERY: u64 = 6;

/// The person of these shares (none negative, sum 1), so many s after it began to stand there. Header, session and
/// operator of the frame are filled in later.
pub type PersonOf = dyn Fn(&[f64; 3], f64) -> RawSkeleton + Send + Sync;

/// Three key poses, and the person of every mix of them.
pub struct KeyPoses {
    /// What their corners are called.
    pub names: [String; 3],
    /// The person of every mix.
    pub person: Box<PersonOf>,
}

impl std::fmt::Debug for KeyPoses {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KeyPoses").field("names", &self.names).finish_non_exhaustive()
    }
}

/// What a page asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MixRequest {
    /// Be the client whose person the robot follows.
    Join,
    /// Go there; also that the page is still there. Nothing unless it has joined.
    Mix(Shares),
    /// Be it no longer.
    Leave,
}

/// What became of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixed {
    /// Whether the person is published.
    pub on: bool,
    /// Where it is.
    pub shares: Shares,
    /// What there is to say.
    pub text: Option<String>,
}

/// The mixer. Dropping it ends the person.
pub type Mixer = Worker<MixRequest, Mixed>;

impl Mixer {
    /// A mixer that connects when it is first asked to join.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn new(instance: &Instance, key_poses: &Arc<KeyPoses>) -> std::io::Result<Self> {
        let (instance, key_poses) = (instance.clone(), key_poses.clone());
        Self::start("mixer", |asked, answer| {
            let person = Person {
                instance,
                key_poses,
                client: None,
                on: None,
                at: Shares::FIRST,
                asked: Shares::FIRST,
                begun: Instant::now(),
                sequence: 0,
                incarnation: rt::incarnation(),
                answer,
            };
            person.work(asked);
        })
    }
}

/// A person that is published.
#[derive(Clone, Copy)]
struct On {
    /// Until when the page may be silent.
    until: Instant,
    /// When the next frame is due.
    due: Instant,
}

struct Person {
    instance: Instance,
    key_poses: Arc<KeyPoses>,
    /// The session; it outlives a pause, as that of any client that returns to its lease.
    client: Option<Client>,
    on: Option<On>,
    at: Shares,
    asked: Shares,
    begun: Instant,
    sequence: u64,
    incarnation: u32,
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
            // Whatever is asked meanwhile, and however much of it.
            self.advance();
        }
    }

    fn obey(&mut self, turn: MixRequest) {
        match turn {
            MixRequest::Join if self.on.is_some() => {}
            MixRequest::Join => match self.join() {
                Ok(()) => {
                    let now = Instant::now();
                    // It goes on from where it was: there is no leap for whoever still follows.
                    (self.on, self.asked) = (Some(On { until: now + HOLD_FOR, due: now }), self.at);
                    self.tell(None);
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

    /// A session that may move the robot, or why there is none. One that lost its lease to another never gets it back.
    fn join(&mut self) -> Result<(), String> {
        let usable = |client: &mut Client| client.listen().is_ok() && client.told() != Reply::NotHolder;
        self.client = self.client.take().and_then(|mut client| usable(&mut client).then_some(client));
        if self.client.is_none() {
            let client = Client::attach(self.instance.skeleton_socket()).map_err(|error| error.to_string())?;
            if client.told() == Reply::GrantedButHeld {
                return Err(HELD.to_owned());
            }
            self.client = Some(client);
        }
        Ok(())
    }

    /// Publishes what is due.
    fn advance(&mut self) {
        let now = Instant::now();
        let Some(on) = &mut self.on else { return };
        if on.until < now {
            return self.end(Some("The page fell silent: it moves the robot no longer.".to_owned()));
        }
        if now < on.due {
            return;
        }
        // A thread that stood still does not catch up.
        on.due = (on.due + PERIOD).max(now);
        let before = self.at;
        self.at = self.at.toward(self.asked, STEP);
        match self.publish(now) {
            Ok(Reply::NotHolder) => {
                self.client = None;
                self.end(Some(HELD.to_owned()));
            }
            // A frame that `ingest` did not read in time is lost; whether there were too many, it judges.
            Ok(_) | Err(DoorError::Timeout { .. }) => {
                let arrives = self.at == self.asked && before != self.at;
                let moves = before != self.at && self.sequence.is_multiple_of(TELL_EVERY);
                if arrives || moves {
                    self.tell(None);
                }
            }
            Err(error) => {
                self.client = None;
                self.end(Some(format!("The connection to ingest is lost: {error}")));
            }
        }
    }

    /// What `ingest` has said by then.
    fn publish(&mut self, now: Instant) -> Result<Reply, DoorError> {
        let Some(client) = &mut self.client else { return Ok(Reply::NotHolder) };
        let at_s = now.saturating_duration_since(self.begun).as_secs_f64();
        let mut frame = (self.key_poses.person)(&self.at.get(), at_s);
        self.sequence += 1;
        let stamp = rt::now();
        frame.header.sequence = self.sequence;
        (frame.header.stamp, frame.header.origin) = (stamp, stamp);
        frame.header.incarnation = self.incarnation;
        client.publish(&frame)?;
        Ok(client.told())
    }

    fn end(&mut self, text: Option<String>) {
        self.on = None;
        self.tell(text);
    }

    fn tell(&self, text: Option<String>) {
        let _ = self.answer.send(Mixed { on: self.on.is_some(), shares: self.at, text });
    }
}

/// What a page is told whose person goes nowhere.
const HELD: &str = "Another client moves the robot, or did a moment ago: switch on again after it has left.";

#[cfg(test)]
mod tests {
    use super::*;
    use doors::{FrameSource, LeaseState, Server};
    use messages::{Layout, Stamp};
    use std::path::PathBuf;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Mutex, MutexGuard};
    use std::thread::JoinHandle;

    /// Longest time for anything that must happen; only a hang comes near.
    const SOON: Duration = Duration::from_secs(20);

    /// What stands for `ingest`: gives the lease to whom it is told, and keeps what the holder sends.
    struct Ingest {
        frames: Arc<Mutex<Vec<(u64, RawSkeleton)>>>,
        refuses: Arc<AtomicBool>,
        ended: Arc<AtomicBool>,
        thread: Option<JoinHandle<()>>,
    }

    impl Ingest {
        fn at(path: PathBuf, held: bool) -> Self {
            let (frames, refuses, ended) = (Arc::default(), Arc::default(), Arc::default());
            let mut ingest = Self { frames, refuses, ended, thread: None };
            let (frames, refuses, ended) = (ingest.frames.clone(), ingest.refuses.clone(), ingest.ended.clone());
            let mut server = Server::bind(&path, None).expect("a socket");
            ingest.thread = Some(std::thread::spawn(move || {
                while !ended.load(Ordering::Relaxed) {
                    server.poll(rt::now(), held, |from: FrameSource, frame| {
                        frames.lock().unwrap().push((from.connection, *frame));
                        if refuses.load(Ordering::Relaxed) { LeaseState::NotHolder } else { LeaseState::Holder }
                    });
                    std::thread::sleep(Duration::from_millis(1));
                }
            }));
            ingest
        }

        fn frames(&self) -> MutexGuard<'_, Vec<(u64, RawSkeleton)>> {
            self.frames.lock().unwrap()
        }

        /// Waits for more frames of a page that asks for a corner meanwhile.
        fn wait(&self, more: usize, mixer: &Mixer, n: usize) {
            let (before, give_up) = (self.frames().len(), Instant::now() + SOON);
            while self.frames().len() < before + more {
                assert!(Instant::now() < give_up, "no more frames than {before}");
                mixer.ask(corner(n));
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    }

    impl Drop for Ingest {
        fn drop(&mut self) {
            self.ended.store(true, Ordering::Relaxed);
            let _ = self.thread.take().map(JoinHandle::join);
        }
    }

    /// A mixer whose person carries its shares in the place of the first joint.
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

    /// The next answer of this kind to a page that is silent.
    fn told(mixer: &Mixer, what: impl Fn(&Mixed) -> bool) -> Mixed {
        told_meanwhile(mixer, what, || {})
    }

    fn told_meanwhile(mixer: &Mixer, what: impl Fn(&Mixed) -> bool, meanwhile: impl Fn()) -> Mixed {
        let give_up = Instant::now() + SOON;
        loop {
            meanwhile();
            if let Some(mixed) = mixer.answer().filter(&what) {
                return mixed;
            }
            assert!(Instant::now() < give_up, "never told");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// From each frame to the next the shares change by a step at most, for each frame between.
    fn assert_no_leap(frames: &[(u64, RawSkeleton)]) {
        for pair in frames.windows(2) {
            let [(_, a), (_, b)] = pair else { continue };
            assert!(b.header.sequence > a.header.sequence && b.header.origin > a.header.origin);
            let between = (b.header.sequence - a.header.sequence) as f32;
            for (x, y) in a.positions[0].iter().zip(b.positions[0]) {
                assert!((x - y).abs() <= STEP as f32 * between + 1e-6, "{:?} to {:?}", a.positions[0], b.positions[0]);
            }
        }
    }

    #[test]
    fn whatever_a_page_asks_no_share_leaps_and_silence_ends_the_person() {
        let (_folder, path, mixer) = mixer();
        let ingest = Ingest::at(path, false);
        // To go somewhere without being there is nothing.
        mixer.ask(corner(2));
        mixer.ask(MixRequest::Join);
        assert_eq!(told(&mixer, |_| true), Mixed { on: true, shares: Shares::FIRST, text: None });
        ingest.wait(3, &mixer, 0);
        assert_eq!(ingest.frames()[2].1.positions[0], [1.0, 0.0, 0.0]);
        for n in 0..40 {
            ingest.wait(1 + n % 9, &mixer, 1 + n / 2 % 2);
        }
        let silent = told(&mixer, |mixed| !mixed.on);
        assert!(silent.text.is_some_and(|text| text.contains("silent")));
        mixer.ask(corner(0));
        std::thread::sleep(Duration::from_millis(200));
        // It goes on where it was, in the same session.
        mixer.ask(MixRequest::Join);
        ingest.wait(30, &mixer, 2);
        mixer.ask(MixRequest::Leave);
        told(&mixer, |mixed| !mixed.on && mixed.text.is_none());
        let frames = ingest.frames();
        assert_no_leap(&frames);
        assert!(frames.iter().all(|(connection, _)| *connection == 1));
        let pause = |a: &RawSkeleton, b: &RawSkeleton| {
            b.header.origin.since(a.header.origin) >= 200_000_000 && b.header.sequence == a.header.sequence + 1
        };
        assert!(frames.windows(2).any(|pair| pause(&pair[0].1, &pair[1].1)), "nothing is published in between");
        let (first, last) = (frames[0].1, frames[frames.len() - 1].1);
        assert!(first.header.stamp > Stamp::NONE && first.header.incarnation == last.header.incarnation);
        assert!(last.positions[0][2] > 0.1, "it has moved");
    }

    #[test]
    fn a_corner_is_arrived_at_in_steps_and_told() {
        let (_folder, path, mixer) = mixer();
        let ingest = Ingest::at(path, false);
        mixer.ask(MixRequest::Join);
        loop {
            ingest.wait(1, &mixer, 1);
            if mixer.answer().is_some_and(|mixed| mixed.shares.get() == [0.0, 1.0, 0.0]) {
                break;
            }
        }
        assert_no_leap(&ingest.frames());
        assert!(ingest.frames().len() as f64 >= 60.0 * EDGE_S);
    }

    #[test]
    fn a_lease_that_another_holds_is_told_and_a_lost_session_is_not_used_again() {
        let (_folder, path, other) = mixer();
        let held = Ingest::at(path.clone(), true);
        other.ask(MixRequest::Join);
        assert_eq!(told(&other, |_| true).text.as_deref(), Some(HELD));
        assert!(held.frames().is_empty(), "nothing was published");
        drop(held);
        let ingest = Ingest::at(path, false);
        other.ask(MixRequest::Join);
        assert!(told(&other, |_| true).on);
        ingest.wait(2, &other, 0);
        ingest.refuses.store(true, Ordering::Relaxed);
        let lost = told_meanwhile(&other, |mixed| !mixed.on, || other.ask(corner(0)));
        assert_eq!(lost.text.as_deref(), Some(HELD));
        ingest.refuses.store(false, Ordering::Relaxed);
        other.ask(MixRequest::Join);
        ingest.wait(2, &other, 0);
        let frames = ingest.frames();
        let (before, after) = (&frames[0], &frames[frames.len() - 1]);
        assert!(before.0 != after.0 && before.1.session_nonce != after.1.session_nonce);
    }

    #[test]
    fn without_ingest_the_page_is_told() {
        let (_folder, path, mixer) = mixer();
        mixer.ask(MixRequest::Join);
        assert!(told(&mixer, |_| true).text.is_some_and(|text| text.contains("skeleton.sock")));
        let ingest = Ingest::at(path, false);
        mixer.ask(MixRequest::Join);
        ingest.wait(2, &mixer, 0);
        drop(ingest);
        let lost = told_meanwhile(&mixer, |mixed| !mixed.on, || mixer.ask(corner(0)));
        assert!(lost.text.as_ref().is_some_and(|text| text.contains("lost")), "{lost:?}");
    }
}
