//! Judges the instance's folders and shared memory, and detects another instance that uses them.

use super::Finding;
use super::facts::{Facts, PlaceFacts};
use super::places::{Folder, Segment};
use std::collections::BTreeSet;

/// Number of domains of one instance: `core` and `input`.
const DOMAINS: u64 = 2;
/// Docker's default size of /dev/shm, bytes. It is enough for one instance but not for several.
const SMALL_BYTES: u64 = 64 << 20;

pub fn place(facts: &Facts) -> Vec<Finding> {
    let place = &facts.place;
    let mut all: Vec<_> = place
        .folders
        .iter()
        .filter_map(|(path, folder)| {
            let is_run_dir = *path == place.run_dir;
            let name = if is_run_dir { "run folder" } else { "bus folder" };
            let finding = one_folder(name, &path.display().to_string(), folder, facts.rights.uid);
            // The bus creates its folders in the run folder itself.
            (is_run_dir || !matches!(folder, Folder::Missing { .. })).then_some(finding)
        })
        .collect();
    all.extend(
        place
            .refused
            .as_ref()
            .map(|why| Finding::problem("bus paths", why.clone(), "use a shorter --run-dir, such as /run/teleop")),
    );
    all.push(instance(place));
    all.push(room(facts));
    all.push(segments(place));
    all.extend(strangers(place));
    all
}

fn one_folder(check: &'static str, path: &str, folder: &Folder, own_uid: u32) -> Finding {
    // Users of other groups reach the sockets through the instance's folder. The bus belongs to this user only.
    let right = if check == "run folder" { "0751" } else { "0700" };
    match *folder {
        Folder::Missing { can_be_made: true } => Finding::ok(check, format!("{path}: will be made, mode {right}")),
        Folder::Missing { can_be_made: false } => Finding::problem(
            check,
            format!("{path}: missing, and this user cannot make it"),
            format!(
                "sudo install -d -m {right} -o \"$USER\" {path}, or another --run-dir (the units make /run/teleop \
                 themselves when they start)"
            ),
        ),
        Folder::Other(ref why) => {
            Finding::problem(check, format!("{path}: {why}"), "give another folder with --run-dir")
        }
        Folder::Is { uid, .. } if uid != own_uid => Finding::problem(
            check,
            format!("{path}: belongs to uid {uid}, not to {own_uid}; the bus admits only one user"),
            format!("run this as uid {uid} (sudo -u '#{uid}' teleopd doctor ...), or use another --run-dir"),
        ),
        Folder::Is { usable: false, mode, .. } => Finding::problem(
            check,
            format!("{path}: mode {mode:04o} denies access to its own user"),
            format!("chmod {right} {path}"),
        ),
        Folder::Is { mode, .. } if mode & 0o002 != 0 => Finding::problem(
            check,
            format!("{path}: mode {mode:04o}, any user of the machine may replace the operator's socket in it"),
            format!("chmod {right} {path}"),
        ),
        Folder::Is { mode, .. } if mode & 0o020 != 0 => Finding::note(
            check,
            format!("{path}: mode {mode:04o}, its group may replace the operator's socket in it"),
            format!("chmod {right} {path}"),
        ),
        Folder::Is { mode, .. } => Finding::ok(check, format!("{path}, mode {mode:04o}")),
    }
}

fn instance(place: &PlaceFacts) -> Finding {
    let Some(pid) = place.holder else {
        return Finding::ok("instance", "none visible to this user runs in this run folder");
    };
    let path = place.run_dir.display();
    Finding::note(
        "instance",
        format!("process {pid} holds the operator's socket: an instance runs, so a second one would be refused"),
        format!("teleopctl --run-dir {path} status; a second instance needs another --run-dir"),
    )
}

fn room(facts: &Facts) -> Finding {
    let needed = DOMAINS * bus::SHARED_MEMORY_NEEDED_BYTES;
    let advice =
        "mount -o remount,size=256M /dev/shm (Docker: --shm-size=256m), or remove files that ended programs left there";
    let mib = |bytes: u64| bytes >> 20;
    match &facts.memory.shared {
        Err(why) => Finding::problem("/dev/shm", why.clone(), "mount -t tmpfs tmpfs /dev/shm"),
        Ok((size, free)) if *free < needed => Finding::problem(
            "/dev/shm",
            format!("{} of {} MiB are free, {} are needed", mib(*free), mib(*size), mib(needed)),
            advice,
        ),
        Ok((size, free)) if *size <= SMALL_BYTES => {
            Finding::note("/dev/shm", format!("{} of {} MiB are free: little room", mib(*free), mib(*size)), advice)
        }
        Ok((size, free)) => Finding::ok("/dev/shm", format!("{} of {} MiB are free", mib(*free), mib(*size))),
    }
}

fn segments(place: &PlaceFacts) -> Finding {
    let stale: Vec<_> = place.segments.iter().filter(|segment| !segment.in_use).collect();
    let Some(first) = stale.first() else {
        let count = place.segments.len();
        let found = if count == 0 { "nothing is left behind".into() } else { format!("{count} segments, all in use") };
        return Finding::ok("shared memory", found);
    };
    let (count, kib) = (stale.len(), stale.iter().map(|segment| segment.bytes).sum::<u64>() >> 10);
    let living = stale.len() < place.segments.len();
    let whose = if living { "processes of this instance that died" } else { "a dead instance" };
    let others = if count > 1 { format!(" and {} more", count - 1) } else { String::new() };
    let advice = if living {
        String::from("nothing to do: the running processes remove them when the next one starts")
    } else {
        let globs = globs(stale.iter().copied());
        format!("the next start removes them; by hand, while this instance does not run: rm {globs}")
    };
    Finding::note("shared memory", format!("/dev/shm/{}{others} ({kib} KiB) left by {whose}", first.name), advice)
}

/// Judges the leftovers of other instances that may never start again. A start cleans up only its own run folder.
fn strangers(place: &PlaceFacts) -> Option<Finding> {
    let tags: BTreeSet<_> = place.strangers.iter().filter_map(|segment| segment.name.split('_').nth(2)).collect();
    let (count, kib) = (tags.len(), place.strangers.iter().map(|segment| segment.bytes).sum::<u64>() >> 10);
    let plural = if count == 1 { "" } else { "s" };
    (count > 0).then(|| {
        let found = format!("{count} dead instance{plural} of other run folders left {kib} KiB in /dev/shm");
        let globs = globs(place.strangers.iter());
        Finding::note(
            "other instances",
            found,
            format!("a start in the same run folder removes them; by hand: rm {globs}"),
        )
    })
}

/// Returns patterns that match all names of the domains to which these segments belong.
fn globs<'a>(segments: impl Iterator<Item = &'a Segment>) -> String {
    let pattern = |segment: &Segment| {
        // The prefix ends with the third underscore: teleop_core_<tag>_.
        let prefix: Vec<_> = segment.name.splitn(4, '_').take(3).collect();
        format!("/dev/shm/{}_*", prefix.join("_"))
    };
    segments.map(pattern).collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>().join(" ")
}
