//! Hazards from the person's side.

use crate::{Hazard, does};

/// Effect of dropped frames if there are several in a row.
const DROPPED: &str = "dropped and counted; after 100 ms the robot stops and needs a new enable";
/// Bound on that effect.
const STALE: &str = "the frame at once; 100 ms + B";

pub(crate) const CONTENT: &[Hazard] = &[
    does("f001", "a field is NaN", DROPPED, STALE),
    does("f002", "a field is infinite", DROPPED, STALE),
    does("f003", "denormal, negative zero, absurdly large", "small ones count as zero, large ones are dropped", STALE),
    does("f004", "a rotation that is not of unit length", "normalised up to 1e-3, dropped beyond", STALE),
    does("f005", "a rotation comes with the other sign", "means the same rotation", "step of 0"),
    does(
        "f006",
        "limbs change their length",
        "the arm is dropped and counted, or the frame if both arms change; then as f001",
        STALE,
    ),
    does(
        "f007",
        "a joint jumps",
        "dropped: its arm, or the frame if both arms or the trunk jump, until it returns or 5 frames in a row agree",
        "the frame at once; 100 ms + B, or 100 ms after the first one or two outliers",
    ),
    does("f008", "the person walks away", "targets are relative to the torso: nothing moves", "step of 0"),
    does("f009", "left and right are swapped", DROPPED, STALE),
    does("f010", "mirrored, other axes, other units", "dropped, or correct", "every frame"),
    does(
        "f011",
        "the tracker is unsure of a joint",
        "both arms stop and hold; they go on once it is seen",
        "100 ms + B",
    ),
    does("f012", "the tracker reports old data with high confidence", "as f013", "200 ms + B"),
    does(
        "f013",
        "the tracker repeats one body with new stamps",
        "dropped after 100 ms; the robot stops and needs a new enable",
        "200 ms + B",
    ),
    does("f014", "old frames are sent again", "dropped: stamps and sequence must grow", "at once"),
    does("f015", "joints are missing", "as f011; an arm that was never seen stays at home", "100 ms + B"),
    does("f016", "another person is tracked", "the robot is released and needs a new enable", "1 tick + B"),
    does("f017", "the tracker shakes", "smoothed; limits hold for every input", "every tick"),
    does("f018", "wrong size, version or number", "refused, or dropped", "at once"),
    does("f019", "a frame changes while it is read", "copied once, then only the copy is used", "at once"),
];

pub(crate) const TIMING: &[Hazard] = &[
    does("f020", "skeletons arrive late", "slower, to a standstill", "50 to 100 ms"),
    does("f021", "skeletons stop arriving", "stop, hold; the robot is released after hold_timeout_ms", "100 ms + B"),
    does("f022", "skeletons resume at another posture", "approached under all limits", "every tick"),
    does("f023", "a client floods", "250 Hz per client pass, the newest first", "every frame"),
    does("f024", "5 skeletons a second", "cannot engage below 20 Hz; gaps count as f021", "0.5 s of steady input"),
    does("f025", "skeletons arrive in bursts", "each gap counts by the clock, as f021", "100 ms + B"),
    does("f026", "stamps run backwards", "dropped", STALE),
    does("f027", "stamps in the future", "dropped beyond 2 ms", STALE),
    does("f028", "the same stamp or number twice", "dropped", "at once"),
    does(
        "f029",
        "the sender's clock drifts",
        "followed up to 1000 ppm; frames with a faster drift are dropped",
        "0 dropped in a day of 500 ppm",
    ),
    does("f030", "the wall clock is set", "no effect: only the monotonic clock is read", "0 missed ticks"),
    does("f031", "the machine sleeps", "stop, latched", "4 ticks after it wakes + B"),
    does("f032", "a counter wraps", "no effect: numbers are compared modulo 2^64", "0 frames lost"),
];

pub(crate) const WEBCAM: &[Hazard] = &[
    does(
        "f123",
        "an image waits in the browser or on its way, and its message says that it is new",
        "the wait is measured against the fastest message and added to the age; then as f020 and f013",
        "500 ms, beyond it refused and counted",
    ),
    does(
        "f124",
        "the page is hidden or closed, the camera stalls, or the page sends only invalid images",
        "as f021; the page is no client any more, and only its button starts it again",
        "100 ms + B; 500 ms",
    ),
];

pub(crate) const HEADSET: &[Hazard] = &[
    does(
        "f131",
        "a passing pinch or squeeze, or one from before the session, presses the enable of a headset",
        "it counts only after the hand was seen open, and then closed for 0.5 s",
        "0.5 s",
    ),
    does(
        "f132",
        "the headset is taken off, its session ends, the page is hidden or silent, or head or left hand are lost",
        "the enable is released; only another press from an open hand engages",
        "one frame + B where the page still sends; 500 ms + B",
    ),
    does(
        "f133",
        "a headset does not see a hand or its own place, or guesses them",
        "confidence 0 for that arm, or no frame; then as f011 and f021",
        "100 ms + B",
    ),
    does(
        "f134",
        "a message of a headset is malformed, out of bounds, too old, or one of too many",
        "refused and counted; it holds no press, and other pages go on",
        "1 message",
    ),
];
