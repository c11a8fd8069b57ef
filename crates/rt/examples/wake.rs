//! How late the periodic loop wakes at 1.5 kHz: `cargo run --release -p rt --example wake [seconds] [priority]`.
//! To judge it, run cyclictest beside it with the same priority: `cyclictest -p <priority> -i 667 -t 1`.

use rt::{PeriodicLoop, Policy, Realtime, RealtimeConfig, Shutdown};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let seconds: u64 = arguments.next().map_or(Ok(5), |text| text.parse())?;
    let policy = match arguments.next() {
        Some(text) => Policy::Fifo { priority: text.parse()? },
        None => Policy::Other,
    };
    let report = Realtime::apply(&RealtimeConfig { policy, cores: None, lock_memory: true });
    println!("{report}");
    let (shutdown, mut periodic) = (Shutdown::on_signals()?, PeriodicLoop::start());
    while periodic.grid().elapsed() < seconds * messages::TICK_HZ && periodic.next(&shutdown).is_some() {}
    println!("late: {}", periodic.lateness());
    println!("ticks {}, missed {}", periodic.grid().ticks(), periodic.grid().missed());
    Ok(())
}
