//! The Prometheus text format (version 0.0.4), served on the loopback interface.

use crate::collector::Collector;
use crate::counter::Counter;
use messages::{FAULTS, Mode};
use std::fmt::Write as _;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Quantiles of every summary.
const QUANTILES: [f64; 4] = [0.5, 0.99, 0.999, 0.9999];
/// Longest time for one scraper. A slower one is dropped, because the collector must drain a ring that holds two
/// seconds.
const PATIENCE: Duration = Duration::from_millis(100);
/// Bytes of a request that are read: its first line, and the headers, which are not used.
const REQUEST_BYTES: usize = 4096;

/// Counters as they are exposed: name, help, counter or gauge.
const EXPOSED: [(Counter, &str, &str); 13] = [
    (Counter::Ticks, "ticks_total", "Iterations of the loop."),
    (Counter::MissedDeadlines, "missed_deadlines_total", "Ticks that were skipped."),
    (Counter::PublishFailures, "publish_failures_total", "Messages that the bus did not accept."),
    (Counter::Gaps, "gaps_total", "Ticks dropped because the process had not run."),
    (Counter::Allocations, "loop_allocations_total", "Allocations of the loop since READY, without the transport's."),
    (Counter::TransportAllocations, "transport_allocations_total", "Allocations of the transport in the loop."),
    (Counter::RingDropped, "telemetry_dropped_total", "Samples dropped because the ring was full."),
    (Counter::WithoutAuthority, "frames_without_authority_total", "Frames and chunks of clients without the lease."),
    (Counter::OverQuota, "frames_over_quota_total", "Frames and chunks beyond 250 Hz of one publisher."),
    (Counter::Refused, "connections_refused_total", "Connections refused at the socket."),
    (Counter::Outliers, "joint_outliers_total", "Outliers: positions of single joints that were held for a frame."),
    (Counter::Faults, "faults_active", "Active faults, as bits."),
    (Counter::Latched, "faults_latched", "Latched faults, as bits."),
];

/// A listener on 127.0.0.1 that replies to `GET /metrics`.
#[derive(Debug)]
pub struct Exposition {
    listener: TcpListener,
}

impl Exposition {
    /// Listens on the loopback interface only.
    pub fn bind(port: u16) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener })
    }

    /// Returns the port that it listens on.
    pub fn port(&self) -> std::io::Result<u16> {
        Ok(self.listener.local_addr()?.port())
    }

    /// Replies to one scraper, if one waits.
    pub fn serve(&self, collector: &Collector) {
        let Ok((stream, _)) = self.listener.accept() else { return };
        // A scraper that disconnects early harms only itself.
        let _ = answer(stream, collector);
    }
}

fn answer(mut stream: TcpStream, collector: &Collector) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    let head = request_head(&mut stream)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let (status, body) = if head.starts_with(b"GET /metrics ") || head.starts_with(b"GET / ") {
        ("200 OK", text(collector))
    } else {
        ("404 Not Found", String::from("only GET /metrics is answered\n"))
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: text/plain; version=0.0.4\r\nContent-Length: {length}\r\nConnection: \
         close\r\n\r\n{body}"
    )
}

/// Reads until the empty line, within the time limit of one scraper.
fn request_head(stream: &mut TcpStream) -> std::io::Result<Vec<u8>> {
    let give_up = Instant::now() + PATIENCE;
    let mut head = Vec::with_capacity(REQUEST_BYTES);
    while !head.windows(4).any(|end| end == b"\r\n\r\n") {
        let left = give_up.saturating_duration_since(Instant::now());
        if left.is_zero() || head.len() >= REQUEST_BYTES {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
        let mut part = [0; 512];
        match stream.read(&mut part)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            length => head.extend_from_slice(&part[..length]),
        }
    }
    Ok(head)
}

/// Returns all metrics of the process as text. Writing to a `String` cannot fail, so the result of `write!` is ignored.
fn text(collector: &Collector) -> String {
    let (mut out, process, counters) = (String::with_capacity(8192), collector.process(), collector.counters());
    for (counter, name, help) in EXPOSED {
        let kind = if name.ends_with("_total") { "counter" } else { "gauge" };
        let value = counters.get(counter);
        let _ = writeln!(out, "# HELP teleop_{name} {help}\n# TYPE teleop_{name} {kind}");
        let _ = writeln!(out, "teleop_{name}{{process=\"{process}\"}} {value}");
    }
    if let Some(mode) = Mode::from_u32(counters.get(Counter::Mode) as u32).filter(|_| process == "control") {
        let _ = writeln!(out, "# HELP teleop_mode 1 for the current mode.\n# TYPE teleop_mode gauge");
        let _ = writeln!(out, "teleop_mode{{mode=\"{}\"}} 1", mode.name());
        let _ =
            writeln!(out, "# HELP teleop_fault_active 1 while the fault is active.\n# TYPE teleop_fault_active gauge");
        let faults = counters.get(Counter::Faults);
        for row in &FAULTS {
            let active = faults >> row.fault as u32 & 1;
            let _ = writeln!(out, "teleop_fault_active{{fault=\"{}\"}} {active}", row.name);
        }
    }
    for (metric, series) in collector.measured() {
        let (name, whole) = (metric.name(), series.whole());
        let _ = writeln!(out, "# TYPE teleop_{name}_seconds summary");
        for quantile in QUANTILES {
            let value = whole.quantile_us(quantile) * 1e-6;
            let _ = writeln!(out, "teleop_{name}_seconds{{process=\"{process}\",quantile=\"{quantile}\"}} {value:.9}");
        }
        let _ = writeln!(out, "teleop_{name}_seconds_sum{{process=\"{process}\"}} {:.9}", series.sum_s());
        let _ = writeln!(out, "teleop_{name}_seconds_count{{process=\"{process}\"}} {}", whole.count());
    }
    out
}
