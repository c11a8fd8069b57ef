//! Hazards between the network and the robot.

use crate::{Hazard, does, struck};

pub(crate) const NUMBERS: &[Hazard] = &[
    does("f033", "the network gives NaN", "its joints play their stop; stop, hold", "3 ticks + B"),
    does(
        "f034",
        "the network jumps",
        "a quarter of the speed after 250 ms of jumps; after 1 s stop, hold",
        "every tick",
    ),
    does("f035", "the network is late", "slower from the third missing tick; then stop, hold", "10 ms + B"),
    does("f036", "retarget hangs", "control, another process, stops the robot", "10 ms + B"),
    struck(
        "f037",
        "a pose unlike any in training",
        "the network's answer is only the start of a refinement on the robot's model: an unfamiliar pose costs accuracy, which the limb error shows, and never a limit",
    ),
    struck("f038", "an accelerator is lost", "no process uses one: inference is on the CPU"),
    does(
        "f039",
        "left and right come from different frames",
        "impossible: one skeleton gives both arms' target",
        "every tick",
    ),
];

pub(crate) const LIMITS: &[Hazard] = &[
    does("f040", "a target beyond a joint's limits", "approached up to the limit", "overshoot of 0"),
    does("f041", "a target that asks for too much speed", "followed at the limits", "every tick"),
    struck(
        "f042",
        "a limit is tightened while moving",
        "limits are read at start and cannot change while a process runs; a process with other limits cannot engage",
    ),
    does(
        "f043",
        "a joint starts outside its limits",
        "cannot engage; recovery moves it inward, 0.1 rad/s at most",
        "at once",
    ),
    does("f044", "the robot starts too close to itself", "cannot engage; recovery only opens", "at once"),
    does("f045", "arms come close to each other, the body, the base", "certified stop before d_min", "every instant"),
    struck(
        "f046",
        "the distance is not known in time",
        "distances are part of the tick: without them there is no command, and the plan plays; a late tick is f078",
    ),
    does(
        "f047",
        "the optimisation finds no solution",
        "the certified plan plays; the number of steps is fixed",
        "160 steps",
    ),
    does("f048", "an elbow would flip", "followed under all limits", "every tick"),
    does(
        "f049",
        "the torso moves the arms into the table",
        "obstacles stand in the base's frame, checked as f045",
        "every instant",
    ),
    does("f050", "the stop itself jumps", "the stop is the plan of the last command", "every tick"),
];

pub(crate) const DRIVER: &[Hazard] = &[
    does("f051", "the robot's state arrives late", "5 ms: stop, hold; 20 ms: stop, latched", "5 or 20 ms + B"),
    does(
        "f052",
        "the state is frozen while the robot is commanded",
        "stop, latched",
        "the later of 50 ms and 0.02 rad, + B",
    ),
    does("f053", "an encoder jumps", "one sample is ignored; the second in a row stops, latched", "2 samples + B"),
    does(
        "f054",
        "the state is NaN or infinite, or has other joints",
        "NaN or infinite: stop, latched; other joints: another configuration, cannot engage",
        "3 ticks + B",
    ),
    does(
        "f055",
        "the robot does not follow, swings, runs away or sinks",
        "stop, latched; only a robot that is measured at rest is enabled or reset",
        "100 ms beyond 5 mrad (simulated 35), at once beyond 7 (49); 0.3 s for a swing of 0.145 rad, + B",
    ),
    does("f056", "a joint turns the wrong way", "stop, latched", "0.02 rad of travel"),
    does("f057", "a command is not executed", "the driver latches; nothing is sent again", "4 ticks"),
    does(
        "f058",
        "commands stop arriving",
        "the driver plays the plan from the first missing one, and latches",
        "1 tick; 15 ticks",
    ),
    does("f059", "commands out of order, twice, too old", "refused", "0 executed"),
    does("f060", "the robot's emergency stop is pressed", "stop, latched; no reset while it is pressed", "3 ticks + B"),
    does(
        "f061",
        "an emergency stop while engaging",
        "stop, latched, in each of 3000 ticks of the blend",
        "3 ticks + B",
    ),
    does("f062", "an emergency stop bounces", "one stop, no restart", "1 event"),
    does("f063", "one arm's drive fails", "all joints play one plan, latched", "next tick + B"),
    does(
        "f064",
        "motor power returns",
        "the measured posture is held; no motion before reset and a new enable",
        "3 ticks",
    ),
];

pub(crate) const AUTHORITY: &[Hazard] = &[
    does(
        "f065",
        "engaging far from the person's pose",
        "motion is blended in; the first second at 5 % of each velocity limit",
        "every tick",
    ),
    does("f066", "the enable is held at start", "no effect: it must be released first", "0 engagements"),
    does("f067", "the enable is released", "stop; the robot is released", "the same tick + B"),
    does(
        "f068",
        "two clients publish",
        "the first holds the lease, on bus and socket; the socket tells the other client that it has none",
        "0.5 s",
    ),
    does(
        "f069",
        "the holder of the lease dies",
        "as f021; the lease ends by silence, and the next one needs a new enable edge",
        "1 s, at rest before",
    ),
    does(
        "f070",
        "a client returns",
        "it counts as a new client: the robot is released and needs a new enable",
        "0 motion",
    ),
    does("f071", "requests contradict each other", "a stop wins in every combination", "same tick"),
    does("f072", "reset is held", "counts once", "1 reset"),
];

pub(crate) const ROS2: &[Hazard] = &[
    does(
        "f114",
        "the network to a robot on ROS 2 is cut, or its driver dies",
        "every message carries the certified stop, and the robot's controllers play it",
        "B and the controllers' delay",
    ),
    does(
        "f115",
        "a robot on ROS 2 is not ready: a controller is inactive, another program commands it, its emergency stop is pressed",
        "the driver does not start, and says what to do",
        "at start",
    ),
    does(
        "f116",
        "the clock of a robot on ROS 2 jumps",
        "its stamps are not believed, nothing more is sent, and the driver latches",
        "20 ms",
    ),
    does(
        "f117",
        "a robot on ROS 2 executes something else than it was sent: messages were lost, it stopped by itself, or was started again",
        "it plays its certified stop; nothing is sent until it was seen to stand where the driver begins, for 0.2 s after the last message",
        "2 mrad and 4 ms of motion",
    ),
    does(
        "f118",
        "the loop of the driver falls silent before a robot that plays no stop",
        "the driver's thread plays the certified stop",
        "10 ms + B",
    ),
];

pub(crate) const CLUTCH: &[Hazard] = &[does(
    "f119",
    "a person lets go of the clutch far from the robot's pose, or the clutch's client dies",
    "as f065; without a client to let go, the enable is released",
    "every tick",
)];

pub(crate) const GRIPPERS: &[Hazard] = &[
    does(
        "f120",
        "the person's hand is open at engaging while the robot holds something, or is seen no more",
        "hold; a hand takes its gripper over where their closures meet",
        "every tick",
    ),
    does(
        "f121",
        "a command moves a gripper too fast or with a jump, or is NaN",
        "the gate denies it, brakes the grippers and stops the robot; the driver limits the speed, and ignores NaN",
        "1 tick + B",
    ),
    does(
        "f122",
        "the fingers of a robot on ROS 2 are not where the driver begins or sends them, or its driver dies",
        "the fingers rest soon after the last message and hold; they get the next one where they stand, and keep their speed",
        "0.2 s",
    ),
];
