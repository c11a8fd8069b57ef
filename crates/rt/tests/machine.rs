//! Facts of the machine: cores, time, page faults, peers and errors of files.

use rt::{
    CoreMap, PageFaults, Peer, Placement, core_list, cpu_features, cpu_time_ns, incarnation, port_refused, unreadable,
    unwritable,
};
use std::fs::{File, OpenOptions};
use std::io::Error;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::Path;

#[test]
fn kernel_core_list_is_parsed_or_refused() {
    assert_eq!(core_list("\n"), Some(vec![]));
    assert_eq!(core_list("0-3,8,10-11\n"), Some(vec![0, 1, 2, 3, 8, 10, 11]));
    assert_eq!(core_list("5"), Some(vec![5]));
    for bad in ["x", "3-1", "1-", "-1", "0-99999999"] {
        assert_eq!(core_list(bad), None, "{bad}");
    }
}

#[test]
fn cores_not_listed_are_left_to_other_threads() {
    let map = CoreMap { allowed: vec![0, 1, 2, 3], isolated: vec![], online: vec![0, 1, 2, 3] };
    let listed = |list: &[usize]| Placement::listed(&map, list).others;
    assert_eq!(listed(&[2, 3]), Some(vec![0, 1]));
    assert_eq!(listed(&[0, 1, 2, 3]), None, "nothing is left: anywhere");
    assert_eq!(listed(&[7]), None, "a core outside the mask takes nothing from it");
}

/// Allowed, isolated and online cores, the core of the real-time loops, and the cores of other threads.
type Row = (&'static str, &'static str, &'static str, Option<usize>, &'static [usize]);

#[test]
fn auto_placement_takes_isolated_core_within_mask_or_last_of_two_to_four() {
    let rows: [Row; 12] = [
        ("0", "", "0", None, &[]),
        ("0-1", "", "0-1", Some(1), &[0]),
        ("1,3,6", "", "0-7", Some(6), &[1, 3]),
        ("0-3", "", "0-3", Some(3), &[0, 1, 2]),
        ("0-4", "", "0-4", None, &[]),
        ("", "", "", None, &[]),
        // After a boot with isolcpus=2,3 the mask leaves them out.
        ("0-1", "2-3", "0-3", Some(2), &[]),
        // The mask names the isolated cores, so the other threads must keep off them.
        ("0-7", "6-7", "0-7", Some(6), &[0, 1, 2, 3, 4, 5]),
        ("6-7", "6-7", "0-7", Some(6), &[]),
        // A container with one of many cores must not leave it.
        ("0", "6-7", "0-7", None, &[]),
        ("1-2", "6-7", "0-7", Some(2), &[1]),
        // The core is isolated, but not online.
        ("0-1", "3", "0-2", Some(1), &[0]),
    ];
    let list = |text| core_list(text).expect("a list");
    for (allowed, isolated, online, realtime, others) in rows {
        let map = CoreMap { allowed: list(allowed), isolated: list(isolated), online: list(online) };
        let placement = Placement::auto(&map);
        assert_eq!(placement.realtime, realtime.map(|core| vec![core]), "{map:?}");
        assert_eq!(placement.others.unwrap_or_default(), others, "{map:?}");
    }
    let map = CoreMap::of_machine();
    assert!(!map.allowed.is_empty() && map.allowed.is_sorted(), "{map:?}");
}

#[test]
fn cpu_features_match_proc_cpuinfo() {
    let features = cpu_features();
    let shown = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let flags = shown.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
    for (ours, theirs) in [("avx2", "avx2"), ("fma", "fma"), ("avx512f", "avx512f"), ("sse4.2", "sse4_2")] {
        let has = |text: &str, name: &str| text.split([' ', ')']).any(|word| word == name);
        if !flags.is_empty() {
            assert_eq!(has(&features, ours), has(flags, theirs), "{ours}: {features}");
        }
    }
}

#[test]
fn cpu_time_rises_with_work() {
    let before = cpu_time_ns();
    let mut sum = 0_u64;
    for i in 0..20_000_000_u64 {
        sum = std::hint::black_box(sum ^ i);
    }
    assert!(cpu_time_ns() > before, "{sum}");
}

#[test]
fn new_pages_are_counted_as_page_faults() {
    let before = PageFaults::of_thread();
    // 64 MiB is far more than one allocation can find already mapped. Even 2 MiB pages need 32 faults.
    let pages = vec![1u8; 64 << 20];
    std::hint::black_box(&pages);
    let faults = PageFaults::of_thread().since(before);
    assert!(faults.minor >= 16, "{faults:?}");
    assert!(PageFaults::of_process().minor >= faults.minor);
}

#[test]
fn incarnations_differ_and_are_never_zero() {
    let mut seen: Vec<u32> = (0..1_000).map(|_| incarnation()).collect();
    assert!(seen.iter().all(|&number| number != 0));
    seen.sort_unstable();
    seen.dedup();
    // The chance of one repetition among 1,000 draws of 32 bits is 1.2e-4. For two repetitions it is 1e-8.
    assert!(seen.len() >= 999, "{} of 1000 are distinct", seen.len());
}

#[test]
fn peer_of_socket_pair_is_this_process() {
    let (one, _other) = UnixStream::pair().unwrap();
    let peer = Peer::from_socket(one.as_fd()).unwrap();
    assert_eq!(peer.pid, std::process::id());
    assert!(peer.is_member(one.as_fd(), peer.gid));
    assert!(!peer.is_member(one.as_fd(), u32::MAX - 1));
    assert!(Peer::from_socket(File::open("/dev/null").unwrap().as_fd()).is_err(), "no socket");
}

fn refused(result: std::io::Result<File>) -> Error {
    result.expect_err("it is refused")
}

#[test]
fn taken_port_error_names_option_for_another_port() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("its address");
    let error = std::net::TcpListener::bind(address).expect_err("it is taken");
    let text = port_refused(address.port(), "--view-port", &error);
    assert!(text.contains(&address.port().to_string()) && text.contains("--view-port 0"), "{text}");
    assert!(!text.contains("os error"), "{text}");
}

#[test]
fn file_error_gives_advice_without_error_number() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("there.mcap");
    File::create(&file).expect("a file");
    let create = |path: &Path| refused(OpenOptions::new().write(true).create_new(true).open(path));
    let below = file.join("x.csv");
    let nowhere = folder.path().join("no/x.csv");
    for (path, error, advice) in [
        (file.as_path(), create(&file), "Remove it, or give another name"),
        (&nowhere, create(&nowhere), "mkdir -p "),
        (&below, create(&below), "not a folder"),
        (folder.path(), refused(File::create(folder.path())), "the name of a file"),
    ] {
        let text = unwritable(path, &error);
        assert!(text.contains(advice) && text.contains(&path.display().to_string()), "{text}");
        assert!(!text.contains("os error"), "{text}");
    }
    let text = unreadable(&nowhere, &refused(File::open(&nowhere)));
    assert!(text.contains("no such file") && text.contains("Check the path") && !text.contains("os error"), "{text}");
    let ours = Error::other("the folder belongs to user 7");
    assert!(unwritable(&file, &ours).ends_with("the folder belongs to user 7"), "our own words stay");
    let other = Error::from_raw_os_error(5);
    assert!(unwritable(&file, &other).contains("os error 5"), "what is not known is printed as it is");
}
