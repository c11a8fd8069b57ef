//! Requests that a process makes to the kernel, derived from the settings and the machine.

use config::{Chooser, Cores, Policy, RealtimeSettings};
use rt::{CoreMap, Placement, RealtimeConfig};

/// Returns the request of a process, and the cores of its threads beside the loop. An expendable process has no
/// `priority`.
pub fn request(settings: &RealtimeSettings, priority: Option<u32>) -> (RealtimeConfig, Option<Vec<usize>>) {
    let policy = match (settings.policy, priority) {
        (Policy::Fifo, Some(priority)) => rt::Policy::Fifo { priority: priority as u8 },
        _ => rt::Policy::Other,
    };
    let placement = placed(settings, priority);
    let config = RealtimeConfig {
        policy,
        cores: if priority.is_some() { placement.realtime } else { placement.others.clone() },
        lock_memory: settings.lock_memory && priority.is_some(),
        cpu_dma_latency: settings.cpu_dma_latency && priority.is_some(),
    };
    (config, placement.others)
}

/// Returns where the instance's processes run on this machine, as seen by a process that asks for real-time rights.
pub fn placement(settings: &RealtimeSettings) -> Placement {
    placed(settings, Some(settings.priority_driver))
}

/// Keeps the calling thread, and the threads and processes it starts, off the cores of the real-time processes.
/// Observers use it.
pub fn keep_off(settings: &RealtimeSettings) {
    if let Some(cores) = placement(settings).others {
        let _ = rt::Realtime::keep_to(&cores);
    }
}

fn placed(settings: &RealtimeSettings, priority: Option<u32>) -> Placement {
    match &settings.cores {
        Cores::Chosen(Chooser::Auto) => {}
        Cores::Chosen(Chooser::Free) => return Placement::free("from the settings"),
        Cores::List(list) => {
            let list: Vec<_> = list.iter().map(|core| *core as usize).collect();
            return Placement::listed(&CoreMap::of_machine(), &list);
        }
    }
    // On one core without real-time rights, the stages would wait for other work on that core. A process that
    // asks for no rights cannot tell if they are granted, and keeps off the core in any case. Such a process is
    // ingest, whose unit grants none.
    let refused = priority.is_some_and(|priority| rt::Realtime::try_fifo(priority as u8).is_err());
    if settings.policy != Policy::Fifo || refused {
        return Placement::free("scheduling is not real-time");
    }
    Placement::auto(&CoreMap::of_machine())
}
