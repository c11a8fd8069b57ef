//! A page with a webcam or a headset as a client. The page sends what it sees, and this thread publishes the person
//! through the skeleton socket like any client. The lease, validation, the enable and the gate treat it like every client.

use crate::operator_worker::HOLD_FOR;
use crate::session::Session;
use crate::sight::{AGE_MS_MAX, Refusal, Sight};
use crate::worker::Worker;
use instance::Instance;
use messages::{RawSkeleton, Stamp};
use std::sync::mpsc::{Receiver, RecvError, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Most images of a page within a second. Webcams make 30 or 60.
pub const IMAGES_PER_S_MAX: u32 = 120;
/// Most frames of a headset within a second. The fastest ones draw 120, and frames come in bursts.
const POSES_PER_S_MAX: u32 = 180;
/// Time after the end of a lease until the next one is asked for. Assumption: `ingest` reads its sockets far more often.
const LEASE_MARGIN: Duration = Duration::from_millis(500);
/// Time between two reports to the page.
const REPORT_PERIOD: Duration = Duration::from_millis(200);

#[derive(Debug)]
pub enum CameraRequest {
    /// Become the client whose person the robot follows. `ingest` knows the person by this number.
    Start(u32),
    /// The person has this number now. Another one is another person.
    Person(u32),
    /// An image that arrived at this time, or the reason for which it is refused. Does nothing before a start.
    Image(Stamp, Result<Sight, Refusal>),
    /// Become a new client, if this page is one. `ingest` reads the operators' files as a lease begins.
    Renew,
    Stop,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CameraReport {
    pub on: bool,
    /// Persons that were published since the start.
    pub published: u64,
    /// Images that were refused since the page opened.
    pub refused: u64,
    /// Age of the newest published image, ms, with the time that its message waited.
    pub age_ms: f64,
    /// Time at which the page sent the newest image, on its own clock, ms. So the page knows how long its messages need.
    pub heard_ms: Option<f64>,
    pub text: Option<String>,
}

/// The webcam or the headset of a page. Dropping it ends the person.
pub type Webcam = Worker<CameraRequest, CameraReport>;

impl Webcam {
    /// Creates a webcam that connects at the first start. A lease ends after `lease` of silence.
    pub fn new(instance: &Instance, lease: Duration) -> std::io::Result<Self> {
        Self::open(instance, "webcam", lease, IMAGES_PER_S_MAX, SILENT)
    }

    pub fn headset(instance: &Instance) -> std::io::Result<Self> {
        Self::open(instance, "headset", Duration::ZERO, POSES_PER_S_MAX, HEADSET_SILENT)
    }

    fn open(
        instance: &Instance,
        name: &str,
        lease: Duration,
        per_s_max: u32,
        silent: &'static str,
    ) -> std::io::Result<Self> {
        let instance = instance.clone();
        Self::start(name, move |asked, answer| {
            let now = Instant::now();
            let watcher = Watcher {
                per_s_max,
                silent,
                session: Session::new(instance, HELD),
                until: None,
                renewed: None,
                lease,
                person: 0,
                delay: TransitDelay::default(),
                second: (now, 0),
                reported: now,
                report: CameraReport { on: false, published: 0, refused: 0, age_ms: 0.0, heard_ms: None, text: None },
                answer,
            };
            watcher.work(asked);
        })
    }
}

/// How long messages wait on their way. The fastest message of a session is the measure for the others, because the
/// clocks of the page and of this process differ by a constant.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TransitDelay {
    fastest_ms: Option<f64>,
}

impl TransitDelay {
    /// Returns the time that a message waited, ms.
    pub(crate) fn waited_ms(&mut self, sent_ms: f64, arrived: Stamp) -> f64 {
        let took_ms = arrived.0 as f64 * 1e-6 - sent_ms;
        let fastest_ms = self.fastest_ms.map_or(took_ms, |fastest| fastest.min(took_ms));
        self.fastest_ms = Some(fastest_ms);
        took_ms - fastest_ms
    }
}

struct Watcher {
    /// Most images within a second.
    per_s_max: u32,
    /// Text for a page that was silent.
    silent: &'static str,
    session: Session,
    /// Time at which the page's silence ends the person. `None` while the page is not the client.
    until: Option<Instant>,
    /// Time at which a new session begins in place of the one before.
    renewed: Option<Instant>,
    /// Silence after which a lease ends.
    lease: Duration,
    /// Number of the person.
    person: u32,
    delay: TransitDelay,
    /// Start of the current second, and the images in it.
    second: (Instant, u32),
    reported: Instant,
    report: CameraReport,
    answer: Sender<CameraReport>,
}

impl Watcher {
    fn work(mut self, asked: &Receiver<CameraRequest>) {
        loop {
            let turn = match self.until {
                None => asked.recv().map_err(|RecvError| RecvTimeoutError::Disconnected),
                Some(until) => asked.recv_timeout(until.saturating_duration_since(Instant::now())),
            };
            match turn {
                Ok(CameraRequest::Start(person)) => self.begin(person),
                Ok(CameraRequest::Person(person)) if person == self.person => {}
                Ok(CameraRequest::Person(person)) => {
                    self.person = person;
                    self.renew();
                }
                Ok(CameraRequest::Image(arrived, image)) => self.receive(arrived, image),
                Ok(CameraRequest::Renew) => self.renew(),
                Ok(CameraRequest::Stop) => self.end(None),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            // Runs after every request, because a flood of invalid images is silence too.
            if self.until.is_some_and(|until| until <= Instant::now()) {
                self.end(Some(self.silent.to_owned()));
            }
        }
    }

    fn begin(&mut self, person: u32) {
        if self.until.is_some() {
            return;
        }
        if self.person != person {
            // Another person is another client.
            self.session.leave();
            self.person = person;
        }
        match self.session.connect() {
            Ok(()) => {
                self.until = Some(Instant::now() + HOLD_FOR);
                (self.delay, self.report.published, self.report.heard_ms) = (TransitDelay::default(), 0, None);
                self.send_report(None);
            }
            Err(why) => self.end(Some(why)),
        }
    }

    fn renew(&mut self) {
        if self.until.is_some() {
            self.session.leave();
            self.renewed = Some(Instant::now() + self.lease + LEASE_MARGIN);
        }
    }

    fn receive(&mut self, arrived: Stamp, image: Result<Sight, Refusal>) {
        let image = self.within_rate().and(image);
        self.report.heard_ms = image.as_ref().ok().map(|image| image.sent_ms);
        let refused = match (image, self.until) {
            (Err(refusal), _) => Some(refusal),
            // An image before the start, or after the end, moves nothing. It begins nothing either.
            (Ok(_), None) => None,
            (Ok(image), Some(_)) => self.see(arrived, &image).err(),
        };
        if let Some(refusal) = refused {
            self.report.refused += 1;
            self.report_at_intervals(Some(format!("A message was refused: {refusal}.")));
        } else {
            self.report_at_intervals(None);
        }
    }

    fn within_rate(&mut self) -> Result<(), Refusal> {
        if self.second.0.elapsed() > Duration::from_secs(1) {
            self.second = (Instant::now(), 0);
        }
        self.second.1 = self.second.1.saturating_add(1);
        if self.second.1 > self.per_s_max { Err(Refusal::Flood) } else { Ok(()) }
    }

    fn see(&mut self, arrived: Stamp, image: &Sight) -> Result<(), Refusal> {
        let age_ms = image.age_ms + self.delay.waited_ms(image.sent_ms, arrived);
        if age_ms > AGE_MS_MAX {
            return Err(Refusal::Age);
        }
        self.until = Some(Instant::now() + HOLD_FOR);
        self.report.age_ms = age_ms;
        match self.renewed {
            Some(at) if at > Instant::now() => return Ok(()),
            Some(_) => {
                self.renewed = None;
                if let Err(why) = self.session.connect() {
                    self.end(Some(why));
                    return Ok(());
                }
            }
            None => {}
        }
        // Nothing is published for an image without a person, so `ingest` judges the silence.
        if let Some(person) = &image.person {
            let origin = Stamp(arrived.0.saturating_sub((age_ms * 1e6) as u64));
            match self.session.publish(RawSkeleton { operator_id: self.person, ..**person }, origin) {
                Ok(()) => self.report.published += 1,
                Err(why) => self.end(Some(why)),
            }
        }
        Ok(())
    }

    fn end(&mut self, text: Option<String>) {
        (self.until, self.renewed) = (None, None);
        self.send_report(text);
    }

    fn report_at_intervals(&mut self, text: Option<String>) {
        if self.reported.elapsed() >= REPORT_PERIOD {
            self.send_report(text);
        }
    }

    fn send_report(&mut self, text: Option<String>) {
        self.reported = Instant::now();
        let _ = self.answer.send(CameraReport { on: self.until.is_some(), text, ..self.report.clone() });
    }
}

/// Message to a page whose person cannot move the robot.
const HELD: &str = "This page is not the client: another one holds the lease, or held it a moment ago. Start again after \
    it has disconnected.";
/// Message to a page that sent no valid image for too long.
const SILENT: &str = "No image came for half a second, so this page no longer moves the robot. Start the camera again.";
/// The same for a headset.
const HEADSET_SILENT: &str = "No pose came for half a second, so this page no longer moves the robot. Start the headset \
    again.";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ingest_double::{Ingest, await_some};
    use crate::sight::Person;
    use doors::LeaseState;

    fn report(ingest: &mut Ingest, webcam: &Webcam, what: impl Fn(&CameraReport) -> bool) -> CameraReport {
        ingest.until(|_| webcam.answer().filter(&what))
    }

    fn await_frames(ingest: &mut Ingest, count: usize) {
        ingest.until(|ingest| (ingest.frames.len() >= count).then_some(()));
    }

    fn webcam() -> (tempfile::TempDir, Ingest, Webcam) {
        let folder = tempfile::tempdir().expect("a folder");
        let instance = Instance::new(folder.path()).expect("an instance");
        let ingest = Ingest::at(&instance.skeleton_socket());
        let webcam = Webcam::new(&instance, Duration::from_secs(1)).expect("a thread");
        (folder, ingest, webcam)
    }

    /// An image that the page sent at `sent_ms`, and that arrived `arrived_ms` after an arbitrary time.
    fn image(sent_ms: f64, age_ms: f64, arrived_ms: u64) -> CameraRequest {
        let person = Some(Box::new(Person { mirrored: false, landmarks: [[0.5; 6]; 33] }.frame()));
        CameraRequest::Image(Stamp(arrived_ms * 1_000_000), Ok(Sight { sent_ms, age_ms, person }))
    }

    #[test]
    fn f123_image_that_waited_gets_its_true_age() {
        let (_folder, mut ingest, webcam) = webcam();
        webcam.ask(CameraRequest::Start(0));
        assert!(report(&mut ingest, &webcam, |_| true).on);
        // The page's clock is 9 s behind. The second message waited 80 ms on its way, and the third one 600 ms.
        for one in [image(1000.0, 30.0, 10_000), image(1033.0, 30.0, 10_113), image(1066.0, 30.0, 10_666)] {
            webcam.ask(one);
        }
        webcam.ask(image(1700.0, 40.0, 10_700));
        await_frames(&mut ingest, 3);
        let origins: Vec<_> = ingest.frames.iter().map(|frame| frame.header.origin.0 / 1_000_000).collect();
        assert_eq!(origins, [9970, 10_003, 10_660]);
        assert!(ingest.frames.iter().all(|frame| frame.layout == 8 && frame.header.incarnation != 0));
        assert_eq!(ingest.frames.iter().map(|frame| frame.header.sequence).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(report(&mut ingest, &webcam, |report| !report.on).refused, 1);
    }

    #[test]
    fn flood_or_empty_images_publish_no_more_than_allowed() {
        let (_folder, mut ingest, webcam) = webcam();
        webcam.ask(CameraRequest::Start(0));
        assert!(report(&mut ingest, &webcam, |_| true).on);
        for n in 0..2 * u64::from(IMAGES_PER_S_MAX) {
            webcam.ask(image(n as f64, 1.0, 10_000 + n));
        }
        let after = report(&mut ingest, &webcam, |report| !report.on);
        assert!(after.refused >= u64::from(IMAGES_PER_S_MAX) && after.text.as_deref() == Some(SILENT), "{after:?}");
        assert!(ingest.frames.len() <= IMAGES_PER_S_MAX as usize, "{}", ingest.frames.len());
    }

    #[test]
    fn f124_invalid_or_late_images_keep_no_page_as_the_client() {
        let (_folder, mut ingest, webcam) = webcam();
        webcam.ask(image(0.0, 1.0, 10_000));
        webcam.ask(CameraRequest::Start(0));
        assert!(report(&mut ingest, &webcam, |_| true).on);
        let ended = ingest.until(|_| {
            webcam.ask(CameraRequest::Image(rt::now(), Err(Refusal::Number)));
            webcam.answer().filter(|report| !report.on)
        });
        assert_eq!(ended.text.as_deref(), Some(SILENT));
        webcam.ask(image(1.0, 1.0, 10_001));
        (0..50).for_each(|_| ingest.poll());
        assert!(ingest.frames.is_empty(), "nothing begins without a start");
    }

    #[test]
    fn page_that_lost_the_lease_is_told_and_gets_a_new_session() {
        let (_folder, mut ingest, webcam) = webcam();
        webcam.ask(CameraRequest::Start(0));
        assert!(report(&mut ingest, &webcam, |_| true).on);
        ingest.holds = LeaseState::NotHolder;
        let mut n = 0;
        let lost = await_some(|| {
            n += 1;
            webcam.ask(image(n as f64, 1.0, 10_000 + n));
            (0..20).for_each(|_| ingest.poll());
            webcam.answer().filter(|report| !report.on)
        });
        assert_eq!(lost.text.as_deref(), Some(HELD));
        ingest.holds = LeaseState::Holder;
        webcam.ask(CameraRequest::Start(0));
        assert!(report(&mut ingest, &webcam, |report| report.on).on);
        let before = ingest.frames.len();
        webcam.ask(image(1e4, 1.0, 20_000));
        await_frames(&mut ingest, before + 1);
        assert!(ingest.frames[before].session_nonce != ingest.frames[before - 1].session_nonce);
    }
}
