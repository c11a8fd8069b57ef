//! Hazards from the machine, its files and other users.

use crate::{Hazard, does};

pub(crate) const PROCESSES: &[Hazard] = &[
    does(
        "f073",
        "a process is killed at any moment",
        "the next one stops the robot; nothing engages by itself",
        "its stale time + B",
    ),
    does("f074", "a process is suspended and goes on", "sends nothing older than 2 ticks", "its stale time + B"),
    does("f075", "a process panics", "aborts, as f073", "its stale time + B"),
    does("f076", "memory runs out", "locked and allocated before READY; the loops allocate nothing", "0 allocations"),
    does("f077", "the cores are busy", "SCHED_FIFO; missed ticks play the plan", "1 tick"),
    does("f078", "deadlines are missed", "one counts, some in a row stop", "deadlines_missed_max + B"),
    does(
        "f079",
        "page faults, slow cores, long interrupts",
        "measured and told: histograms of every loop",
        "every tick",
    ),
    does("f080", "a lock in the loop waits", "there is none; the ring beside it loses and counts", "0 waits"),
    does("f081", "descriptors or threads run out", "all are opened before READY", "0 opened later"),
    does(
        "f082",
        "a process fails again and again",
        "systemd gives up after 3 in 60 s; nothing engages",
        "0 engagements",
    ),
    does("f083", "a process starts without its peers", "waits, and cannot engage", "at once"),
    does("f084", "the daemon is asked to end", "releases, comes to rest, then ends, the driver last", "B + 5 s"),
];

pub(crate) const MEMORY: &[Hazard] = &[
    does("f085", "/dev/shm is full", "does not start, or as f073", "B"),
    does("f086", "segments of a dead process are left", "cleaned up at the next start", "READY within 20 s"),
    does("f087", "a folder or segment belongs to others", "does not start, and names it", "at start"),
    does(
        "f088",
        "clients take every place",
        "the holder keeps its place; the socket tells every client beyond the eighth",
        "every frame",
    ),
    does(
        "f089",
        "a client corrupts shared memory",
        "ingest may die; the core opens nothing of the input domain",
        "100 ms + B",
    ),
    does("f090", "a client holds samples for ever", "the newest overwrite the oldest", "flat memory"),
    does("f091", "a client truncates a segment", "SIGBUS in ingest alone, as f073", "100 ms + B"),
    does("f092", "two daemons in one folder", "the second ends with 75", "at start"),
];

pub(crate) const FILES: &[Hazard] = &[
    does(
        "f093",
        "weights are cut, changed, not those of the manifest",
        "does not start; the manifest carries the hash, it is not signed",
        "every bit",
    ),
    does("f094", "weights of another robot", "does not start; 64 fixed inputs are tried at every start", "at start"),
    does("f095", "weights change while running", "nothing: read once, hashed as read", "0 effect"),
    does(
        "f096",
        "an archive bomb, an absurd header",
        "refused within bounds, before more is unpacked",
        "a recording 64 MiB and 128 times its length, arrays 19.8 million numbers; 512 MB of memory",
    ),
    does(
        "f097",
        "a key is unknown or missing, a value is not a number, bounds are swapped",
        "does not start; file, key, value, bound",
        "at start",
    ),
    does("f098", "settings looser than the ceilings", "does not start", "at start"),
    does("f099", "a URDF with loops, two roots, entities", "does not start", "at start"),
    does("f100", "a URDF with absurd limits", "does not start", "at start"),
    does(
        "f101",
        "the URDF is not the one of the weights",
        "does not start: the manifest names the arm that it was trained for",
        "at start",
    ),
    does(
        "f102",
        "the disk is full while recording",
        "record, a process of its own, loses and counts; the file is good up to there",
        "every sample written or counted; the daemon untouched",
    ),
    does(
        "f103",
        "the disk hangs while recording",
        "a bounded queue loses and counts; who reads the instance never waits",
        "4,096 messages, 0 waits",
    ),
    does("f104", "a motion file is malformed", "refused with the file, within 120,000 frames and 512 MB", "at once"),
    does("f105", "an event repeats a million times", "10 lines a second of a kind, the rest is counted", "every kind"),
];

pub(crate) const INTRUDERS: &[Hazard] = &[
    does(
        "f106",
        "another user publishes",
        "refused by the kernel (0600, 0660), and by the door, which asks it who calls",
        "0 admitted",
    ),
    does("f107", "another user reads", "refused by the kernel", "0 read"),
    does(
        "f108",
        "a client of the same user writes for another",
        "another port is another client, and refused; a user can always write what is its own",
        "at once",
    ),
    does("f109", "ingest lies", "whatever the target, no command breaks a limit", "every tick"),
    does("f110", "links are planted in the run folder", "not followed", "at start"),
    does("f111", "an operator's request is forged", "another socket, another group", "0 taken"),
    does(
        "f112",
        "a debugger attaches, a core is dumped",
        "no core file; other users cannot look in; doctor names ptrace_scope",
        "at start",
    ),
    does(
        "f113",
        "a dependency is not what it was",
        "locked by hash, licences and sources checked in CI",
        "every build",
    ),
];
