//! One image of a webcam as a page reports it: the landmarks of the person, and the age of the image.

use messages::{Layout, RawSkeleton, SkeletonLayout, raw_flag};

/// Landmarks of a person in MediaPipe's layout.
pub const LANDMARKS: usize = 33;
/// Numbers of a landmark: x, y and z, m, its visibility, and its place in the image, in heights of the image.
const NUMBERS: usize = 6;
/// Bytes of a message: two numbers of double precision, the mirrored switch, and the numbers of each landmark.
pub const SIGHT_BYTES: usize = 16 + 4 + 4 * NUMBERS * LANDMARKS;
/// Bytes of a message about an image that shows nobody.
pub const NOBODY_BYTES: usize = 16;
/// Largest age of an image, ms. `ingest` drops what is older than 100 ms. A larger age than this one is an error.
pub const AGE_MS_MAX: f64 = 500.0;
/// Largest coordinate of a landmark, m or heights of the image. Landmarks are relative to the hips. Assumption: a person is smaller.
const REACH_M_MAX: f32 = 5.0;

/// Reasons for which a message is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts describe the variants")]
pub enum Refusal {
    #[error("the message has the wrong length")]
    Length,
    #[error("a number is not finite, or out of its bounds")]
    Number,
    #[error("it is older than 500 ms, or its age is negative")]
    Age,
    #[error("there were too many within a second")]
    Flood,
}

/// Sight of a page at one moment: an image of a webcam, or the poses of a headset.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// Time at which the page sent the message, on the page's own clock, ms.
    pub sent_ms: f64,
    /// Its age at that time, ms.
    pub age_ms: f64,
    /// The frame for `ingest`, without its header. `None` if nobody was seen.
    pub person: Option<Box<RawSkeleton>>,
}

/// A person in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    /// The image itself was mirrored.
    pub mirrored: bool,
    /// x, y and z of each landmark, m, its visibility, and its place in the image: heights of the image from its middle, y
    /// down.
    pub landmarks: [[f32; NUMBERS]; LANDMARKS],
}

impl Sight {
    /// Reads a message. All numbers have the little end first.
    pub fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        if bytes.len() != SIGHT_BYTES && bytes.len() != NOBODY_BYTES {
            return Err(Refusal::Length);
        }
        let (head, rest) = bytes.split_at(NOBODY_BYTES);
        let [sent_ms, age_ms] = times(head)?;
        let (numbers, _) = rest.as_chunks::<4>();
        let person = numbers.split_first().map(|(mirrored, marks)| person(f32::from_le_bytes(*mirrored), marks));
        Ok(Self { sent_ms, age_ms, person: person.transpose()?.map(|person| Box::new(person.frame())) })
    }
}

/// Reads the two numbers of double precision at the beginning of a message: when it was sent, and its age.
pub(crate) fn times(bytes: &[u8]) -> Result<[f64; 2], Refusal> {
    let ([sent, age, ..], _) = bytes.as_chunks::<8>() else { return Err(Refusal::Length) };
    let [sent_ms, age_ms] = [sent, age].map(|number| f64::from_le_bytes(*number));
    if !sent_ms.is_finite() {
        return Err(Refusal::Number);
    }
    if (0.0..=AGE_MS_MAX).contains(&age_ms) { Ok([sent_ms, age_ms]) } else { Err(Refusal::Age) }
}

fn person(mirrored: f32, marks: &[[u8; 4]]) -> Result<Person, Refusal> {
    let (marks, _) = marks.as_chunks::<NUMBERS>();
    let landmarks = std::array::from_fn(|n| marks[n].map(f32::from_le_bytes));
    let is_near = |x: &f32| x.abs() <= REACH_M_MAX;
    let is_valid = |[x, y, z, visibility, u, v]: &[f32; NUMBERS]| {
        [x, y, z, u, v].into_iter().all(is_near) && (0.0..=1.0).contains(visibility)
    };
    if ![0.0, 1.0].contains(&mirrored) || !landmarks.iter().all(is_valid) {
        return Err(Refusal::Number);
    }
    Ok(Person { mirrored: mirrored > 0.0, landmarks })
}

impl Person {
    /// Returns the frame for `ingest`, without its header.
    pub fn frame(&self) -> RawSkeleton {
        let mut frame = RawSkeleton::ZERO;
        frame.layout = SkeletonLayout::MediaPipe66 as u32;
        frame.joint_count = 2 * LANDMARKS as u32;
        frame.flags = if self.mirrored { raw_flag::MIRRORED } else { 0 };
        for (n, [x, y, z, visibility, u, v]) in self.landmarks.into_iter().enumerate() {
            (frame.positions[n], frame.positions[LANDMARKS + n]) = ([x, y, z], [u, v, 0.0]);
            (frame.confidence[n], frame.confidence[LANDMARKS + n]) = (visibility, visibility);
        }
        frame
    }
}
