//! Hazards from the machine, its files and other users.

use crate::{Hazard, does};

pub(crate) const PROCESSES: &[Hazard] = &[
    does(
        "f073",
        "a process is killed at any moment",
        "the next one stops the robot; nothing engages by itself",
        "its stale time + B",
    ),
    does("f074", "a process is suspended and resumes", "sends nothing older than 2 ticks", "its stale time + B"),
    does("f075", "a process panics", "aborts, as f073", "its stale time + B"),
    does("f076", "memory runs out", "locked and allocated before READY; the loops allocate nothing", "0 allocations"),
    does("f077", "the cores are busy", "SCHED_FIFO; missed ticks play the plan", "1 tick"),
    does("f078", "deadlines are missed", "one counts, some in a row stop", "deadlines_missed_max + B"),
    does(
        "f079",
        "page faults, slow cores, long interrupts",
        "measured and reported as histograms of every loop",
        "every tick",
    ),
    does("f080", "a lock in the loop waits", "the loop has no lock; its ring drops samples and counts them", "0 waits"),
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
    does("f085", "/dev/shm is full", "the daemon does not start, or as f073", "B"),
    does("f086", "segments of a dead process are left", "cleaned up at the next start", "READY within 20 s"),
    does("f087", "a folder or segment belongs to others", "does not start, and names it", "at start"),
    does(
        "f088",
        "clients use all connections",
        "the lease holder stays connected; every client beyond the eighth is refused with a reason",
        "every frame",
    ),
    does(
        "f089",
        "a client corrupts shared memory",
        "ingest may die; the core opens nothing of the input domain",
        "100 ms + B",
    ),
    does("f090", "a client never releases samples", "the newest overwrite the oldest", "flat memory"),
    does("f091", "a client truncates a segment", "SIGBUS in ingest alone, as f073", "100 ms + B"),
    does("f092", "two daemons in one folder", "the second exits with code 75", "at start"),
];

pub(crate) const FILES: &[Hazard] = &[
    does(
        "f093",
        "weights are cut, changed, not those of the manifest",
        "does not start; the manifest carries the hash, it is not signed",
        "every bit",
    ),
    does(
        "f094",
        "weights are those of another robot",
        "does not start; 64 fixed inputs are tried at every start",
        "at start",
    ),
    does("f095", "weights change while running", "no effect: read once, hashed as read", "0 effect"),
    does(
        "f096",
        "a decompression bomb, an absurd header",
        "refused at the bound, before more is decompressed",
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
        "record, a separate process, drops messages and counts them; the file is valid up to there",
        "every sample written or counted; the daemon untouched",
    ),
    does(
        "f103",
        "the disk hangs while recording",
        "a bounded queue drops messages and counts them; the reader of the instance never waits",
        "4,096 messages, 0 waits",
    ),
    does("f104", "a motion file is malformed", "refused with the file, within 120,000 frames and 512 MB", "at once"),
    does(
        "f105",
        "an event repeats a million times",
        "10 lines of a kind a second; the others are counted",
        "every kind",
    ),
];

pub(crate) const INTRUDERS: &[Hazard] = &[
    does(
        "f106",
        "another user publishes",
        "refused by the kernel (0600, 0660), and by the socket's server, which asks the kernel for the user",
        "0 admitted",
    ),
    does("f107", "another user reads", "refused by the kernel", "0 read"),
    does(
        "f108",
        "a client of the same user writes for another client",
        "another port counts as another client and is refused; a user can always write its own files",
        "at once",
    ),
    does("f109", "ingest sends wrong data", "no target makes a command break a limit", "every tick"),
    does("f110", "links are planted in the run folder", "not followed", "at start"),
    does("f111", "an operator's request is forged", "another socket, another group", "0 taken"),
    does(
        "f112",
        "a debugger attaches, a core is dumped",
        "no core file; other users cannot read the memory; doctor reports ptrace_scope",
        "at start",
    ),
    does("f113", "a dependency was changed", "locked by hash, licences and sources checked in CI", "every build"),
];

pub(crate) const LINK: &[Hazard] = &[
    does(
        "f125",
        "the link to an operator's machine is cut, or its end is killed",
        "a release; the level that is held over it engages nothing in the next session",
        "100 ms + B; session over after 200 ms",
    ),
    does(
        "f126",
        "datagrams of a link come late, twice, in another order, or from an earlier session",
        "refused and counted; ages are judged on the robot's clock and never under-estimated",
        "100 ms",
    ),
    does(
        "f127",
        "the operator's clock is not synchronised, too uncertain, or jumps",
        "nothing is engaged, the enable counts as released and must be pressed again; the emergency stop counts",
        "1 datagram; uncertainty above 20 ms",
    ),
    does(
        "f128",
        "an operator's machine floods the link, or sends what is no datagram",
        "refused and counted; the newest packet alone waits, and 250 a second are read",
        "0 queued; others undisturbed",
    ),
    does(
        "f129",
        "a second program uses an operator's certificate",
        "refused while the first one is heard",
        "200 ms after the last heartbeat",
    ),
    does(
        "f130",
        "a stranger without a certificate, or an operator in another one's name, reaches the port",
        "TLS refuses the first, access control the second",
        "0 datagrams read",
    ),
];

pub(crate) const PAGE: &[Hazard] = &[
    does(
        "f135",
        "another machine of the network listens to the page, or tries to operate the robot without its address",
        "TLS 1.3, the host's name, the page's origin and a token of 128 bits; without --https the page stays on the loopback",
        "every connection",
    ),
    does(
        "f136",
        "machines of the network open connections and send slowly, or nothing",
        "each is closed, and the oldest makes room for the next; open pages go on",
        "2 s; 32 connections",
    ),
];
