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

    /// Returns the allowed cores that are not in `list`. `None` if that leaves none or all.
    fn allowed_without(&self, list: &[usize]) -> Option<Vec<usize>> {
        let rest: Vec<_> = self.allowed.iter().copied().filter(|core| !list.contains(core)).collect();
        (!rest.is_empty() && rest != self.allowed).then_some(rest)
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
        Self { realtime: Some(list.to_vec()), others: map.allowed_without(list), reason: "from the settings" }
    }

    /// Puts everything real-time on the first isolated core, or else on the last core of a small machine.
    /// Otherwise leaves all free.
    pub fn auto(map: &CoreMap) -> Self {
        // Threads start on the cores that are not isolated. Someone set a narrower mask on purpose, so stay inside it.
        let mut untouched = map.online.iter().filter(|core| !map.isolated.contains(core));
        let untouched = !map.online.is_empty() && untouched.all(|core| map.allowed.contains(core));
        let usable = |core: &&usize| map.allowed.contains(core) || (untouched && map.online.contains(core));
        if let Some(&core) = map.isolated.iter().find(usable) {
            let others = map.allowed_without(&map.isolated);
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
