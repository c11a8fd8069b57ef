//! Assigns the cores to processes. Stages that wake each other do so fastest on one core. A wake-up across the
//! cores of a virtual machine takes several times as long as one on the same core.

use crate::realtime::allowed_cores;

/// The cores of the machine, each list ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CoreMap {
    /// Cores that this thread may run on.
    pub allowed: Vec<usize>,
    /// Cores that the scheduler leaves alone (kernel command line, isolcpus=).
    pub isolated: Vec<usize>,
    /// Cores that are online.
    pub online: Vec<usize>,
}

impl CoreMap {
    /// Reads the cores from the kernel.
    pub fn of_machine() -> Self {
        let list = |name: &str| {
            let text = std::fs::read_to_string(format!("/sys/devices/system/cpu/{name}")).unwrap_or_default();
            core_list(&text).unwrap_or_default()
        };
        Self { allowed: allowed_cores(), isolated: list("isolated"), online: list("online") }
    }
}

/// Cores of the threads of an instance. `None` leaves the choice to the kernel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Cores of retarget, control and driver.
    pub realtime: Option<Vec<usize>>,
    /// Cores of ingest, the threads beside the loops, and clients.
    pub others: Option<Vec<usize>>,
    /// The reason for this placement.
    pub reason: &'static str,
}

/// Largest number of allowed cores at which one of them is set aside: a small computer on the robot. Assumption:
/// with more cores the kernel finds an idle one.
const SMALL_MAX: usize = 4;

impl Placement {
    /// Leaves all cores to the kernel.
    pub const fn free(reason: &'static str) -> Self {
        Self { realtime: None, others: None, reason }
    }

    /// Puts the real-time processes on `list`, and everything else on the other cores of `map` if there are any.
    pub fn listed(map: &CoreMap, list: &[usize]) -> Self {
        let rest: Vec<_> = map.allowed.iter().copied().filter(|core| !list.contains(core)).collect();
        let others = (!rest.is_empty() && rest != map.allowed).then_some(rest);
        Self { realtime: Some(list.to_vec()), others, reason: "from the settings" }
    }

    /// Puts everything real-time on the first isolated core, or else on the last core of a small machine.
    /// Otherwise leaves all free.
    pub fn auto(map: &CoreMap) -> Self {
        // Threads start on the cores that are not isolated. Someone set a narrower mask on purpose, so stay
        // inside it.
        let mut untouched = map.online.iter().filter(|core| !map.isolated.contains(core));
        let untouched = !map.online.is_empty() && untouched.all(|core| map.allowed.contains(core));
        let usable = |core: &&usize| map.allowed.contains(core) || (untouched && map.online.contains(core));
        if let Some(&core) = map.isolated.iter().find(usable) {
            let rest: Vec<_> = map.allowed.iter().copied().filter(|core| !map.isolated.contains(core)).collect();
            let others = (!rest.is_empty() && rest != map.allowed).then_some(rest);
            return Self { realtime: Some(vec![core]), others, reason: "the first isolated core" };
        }
        match map.allowed.as_slice() {
            [rest @ .., last] if (2..=SMALL_MAX).contains(&map.allowed.len()) => Self {
                realtime: Some(vec![*last]),
                others: Some(rest.to_vec()),
                reason: "no core is isolated; the last core",
            },
            [_] => Self::free("there is only one core"),
            _ => Self::free("no core is isolated, and there are more than 4"),
        }
    }
}

/// Returns the cores in a list of the kernel, such as `0-3,8`. Returns `None` if the text is not such a list.
pub fn core_list(text: &str) -> Option<Vec<usize>> {
    let mut cores = Vec::new();
    for part in text.trim().split(',').filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (usize, usize) = (first.parse().ok()?, last.parse().ok()?);
        if last < first || last >= 1 << 16 {
            return None;
        }
        cores.extend(first..=last);
    }
    cores.sort_unstable();
    cores.dedup();
    Some(cores)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(allowed: &str, isolated: &str, online: &str) -> (Option<Vec<usize>>, Option<Vec<usize>>) {
        let list = |text| core_list(text).expect("a list");
        let map = CoreMap { allowed: list(allowed), isolated: list(isolated), online: list(online) };
        let placement = Placement::auto(&map);
        (placement.realtime, placement.others)
    }

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
    fn auto_placement_takes_last_core_of_two_to_four() {
        assert_eq!(auto("0", "", "0"), (None, None));
        assert_eq!(auto("0-1", "", "0-1"), (Some(vec![1]), Some(vec![0])));
        assert_eq!(auto("1,3,6", "", "0-7"), (Some(vec![6]), Some(vec![1, 3])));
        assert_eq!(auto("0-3", "", "0-3"), (Some(vec![3]), Some(vec![0, 1, 2])));
        assert_eq!(auto("0-4", "", "0-4"), (None, None));
        assert_eq!(auto("", "", ""), (None, None));
    }

    #[test]
    fn cores_not_listed_are_left_to_other_threads() {
        let map = CoreMap { allowed: vec![0, 1, 2, 3], isolated: vec![], online: vec![0, 1, 2, 3] };
        let listed = |list: &[usize]| Placement::listed(&map, list).others;
        assert_eq!(listed(&[2, 3]), Some(vec![0, 1]));
        assert_eq!(listed(&[0, 1, 2, 3]), None, "nothing is left: anywhere");
        assert_eq!(listed(&[7]), None, "a core outside the mask takes nothing from it");
    }

    #[test]
    fn auto_placement_prefers_isolated_core_within_mask() {
        // After a boot with isolcpus=2,3 the mask leaves them out.
        assert_eq!(auto("0-1", "2-3", "0-3"), (Some(vec![2]), None));
        // The mask names the isolated cores, so the other threads must keep off them.
        assert_eq!(auto("0-7", "6-7", "0-7"), (Some(vec![6]), Some(vec![0, 1, 2, 3, 4, 5])));
        assert_eq!(auto("6-7", "6-7", "0-7"), (Some(vec![6]), None));
        // A container with one of many cores must not leave it.
        assert_eq!(auto("0", "6-7", "0-7"), (None, None));
        assert_eq!(auto("1-2", "6-7", "0-7"), (Some(vec![2]), Some(vec![1])));
        // The core is isolated, but not online.
        assert_eq!(auto("0-1", "3", "0-2"), (Some(vec![1]), Some(vec![0])));
    }

    #[test]
    fn core_map_of_machine_has_an_allowed_core() {
        let map = CoreMap::of_machine();
        assert!(!map.allowed.is_empty() && map.allowed.is_sorted(), "{map:?}");
    }
}
