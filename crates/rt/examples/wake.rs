//! Prints how late the periodic loop wakes at 1.5 kHz:
//! `cargo run --release -p rt --example wake -- [seconds=5] [priority=80] [spin_us=100] [core=1] [awake]`. To
//! judge the result, run cyclictest in turns with it: `cyclictest -m -p <priority> -i 667 -t 1`.

use rt::{PeriodicLoop, Policy, Realtime, RealtimeConfig, Shutdown};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (mut seconds, mut spin_us) = (5, 0.0);
    let mut config = RealtimeConfig { policy: Policy::Other, cores: None, lock_memory: true, cpu_dma_latency: false };
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("seconds", text)) => seconds = text.parse()?,
            Some(("priority", text)) => config.policy = Policy::Fifo { priority: text.parse()? },
            Some(("spin_us", text)) => spin_us = text.parse()?,
            Some(("core", text)) => config.cores = Some(vec![text.parse()?]),
            None if argument == "awake" => config.cpu_dma_latency = true,
            _ => return Err(format!("{argument}: no such argument").into()),
        }
    }
    println!("{}", Realtime::apply(&config));
    let (shutdown, mut periodic) = (Shutdown::on_signals()?, PeriodicLoop::start().spinning_us(spin_us));
    let mut late = rt::Histogram::default();
    while periodic.grid().elapsed() < seconds * messages::TICK_HZ {
        let Some(tick) = periodic.next(&shutdown) else { break };
        late.record_ns(tick.late_ns);
    }
    println!("late: {late}");
    println!("ticks {}, missed {}", periodic.grid().ticks(), periodic.grid().missed());
    Ok(())
}
