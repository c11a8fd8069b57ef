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
    let placement = placement(settings);
    let config = RealtimeConfig {
        policy,
        cores: if priority.is_some() { placement.realtime } else { placement.others.clone() },
        lock_memory: settings.lock_memory && priority.is_some(),
        cpu_dma_latency: settings.cpu_dma_latency && priority.is_some(),
    };
    (config, placement.others)
}

/// Where the processes of the instance run on this machine.
pub fn placement(settings: &RealtimeSettings) -> Placement {
    match &settings.cores {
        Cores::Auto => {}
        Cores::Free => return Placement::free("so the settings say"),
        Cores::List(list) => {
            let list: Vec<_> = list.iter().map(|core| *core as usize).collect();
            return Placement::listed(&CoreMap::of_machine(), &list);
        }
    }
    // On one core without real-time rights, the stages would wait for whatever else runs there.
    let lowest = settings.priority_retarget.min(settings.priority_control).min(settings.priority_driver);
    if settings.policy != Policy::Fifo || rt::Realtime::try_fifo(lowest as u8).is_err() {
        return Placement::free("scheduling is not real-time");
    }
    Placement::auto(&CoreMap::of_machine())
}
