//! What a process asks of the kernel, from the settings and from the machine it finds.

use pipeline::{Cores, Policy, RealtimeSettings};
use rt::{CoreMap, Placement, RealtimeConfig};

/// The request of a process that has `priority`, or of an expendable one that has none, and the cores of its threads beside
/// the loop.
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

/// Where the processes of the instance run on this machine, as one that asks for real-time rights finds it.
pub fn placement(settings: &RealtimeSettings) -> Placement {
    placed(settings, Some(settings.priority_driver))
}

/// Keeps the calling thread, and whatever it starts, off the cores of the real-time processes: for what only looks on.
pub fn keep_off(settings: &RealtimeSettings) {
    if let Some(cores) = placement(settings).others {
        let _ = rt::Realtime::keep_to(&cores);
    }
}

fn placed(settings: &RealtimeSettings, priority: Option<u32>) -> Placement {
    match &settings.cores {
        Cores::Auto => {}
        Cores::Free => return Placement::free("so the settings say"),
        Cores::List(list) => {
            let list: Vec<_> = list.iter().map(|core| *core as usize).collect();
            return Placement::listed(&CoreMap::of_machine(), &list);
        }
    }
    // On one core without real-time rights, the stages would wait for whatever else runs there. A process that asks for none
    // (ingest, whose unit grants none) cannot tell, and keeps off the core in any case.
    let refused = priority.is_some_and(|priority| rt::Realtime::try_fifo(priority as u8).is_err());
    if settings.policy != Policy::Fifo || refused {
        return Placement::free("scheduling is not real-time");
    }
    Placement::auto(&CoreMap::of_machine())
}
