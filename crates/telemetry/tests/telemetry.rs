//! The ring between a loop and its collector: every loss is counted, and the loop's end does not allocate.

use messages::{Mode, Stamp, Transition};
use std::io::{Read, Write};
use std::net::TcpStream;
use telemetry::{Collector, Counter, Event, Exposition, Metric, Probe, RING_CAPACITY, channel};

fn second(s: u64) -> Stamp {
    Stamp(s * 1_000_000_000)
}

#[test]
fn samples_become_histograms_and_one_row_per_second() {
    let (mut probe, collector) = channel("control");
    for ns in 1..=1000_u64 {
        probe.record(Metric::ControlWork, second(5), second(5).plus_ns(ns * 1000));
    }
    probe.record_ns(Metric::ControlWork, second(7), 3_000_000);
    let json = collector.into_json();
    let work = &json["metrics"]["control_work"];
    assert_eq!((work["count"].as_u64(), work["max_us"].as_f64()), (Some(1001), Some(3000.0)));
    assert!((work["p50_us"].as_f64().unwrap() - 501.0).abs() < 1.5, "{}", work["p50_us"]);
    let counted: u64 = work["buckets"].as_array().unwrap().iter().map(|bucket| bucket[1].as_u64().unwrap()).sum();
    assert_eq!(counted, 1001);
    let seconds: Vec<[f64; 2]> =
        work["seconds"].as_array().unwrap().iter().map(|line| [0, 1].map(|i| line[i].as_f64().unwrap())).collect();
    assert_eq!(seconds, [[5.0, 1000.0], [7.0, 1.0]], "a second without samples has no line");
    assert!(json["metrics"].get("wake_up").is_none(), "what was never measured is absent, not zero");
}

#[test]
fn full_ring_drops_samples_and_counts_them() {
    let (mut probe, mut collector) = channel("driver");
    for _ in 0..RING_CAPACITY + 10 {
        probe.record_ns(Metric::WakeUp, second(1), 1);
    }
    assert_eq!(probe.counters().get(Counter::RingDropped), 10);
    assert_eq!(collector.drain(), RING_CAPACITY);
    probe.record_ns(Metric::WakeUp, second(2), 1);
    let json = collector.into_json();
    assert_eq!(
        (&json["ring_dropped"], &json["metrics"]["wake_up"]["count"]),
        (&10.into(), &(RING_CAPACITY + 1).into())
    );
}

#[test]
fn probe_allocates_nothing() {
    let (mut probe, _collector) = channel("retarget");
    let transition = Transition { k: 1, from: 0, to: 1, why: Transition::ENABLED, about: 0 };
    let ((), count) = rt::count_allocations(|| {
        for k in 0..2 * RING_CAPACITY as u64 {
            probe.record_ns(Metric::WakeUp, Stamp(k), k);
            probe.missed(1);
            probe.event(Event::Transition(transition));
            probe.counters().add(Counter::Ticks, 1);
        }
    });
    assert_eq!(count, rt::Allocations::default());
}

#[test]
fn probe_and_collector_on_two_threads_count_every_lost_sample() {
    let (mut probe, mut collector) = channel("ingest");
    let sent = 400_000_u64;
    let collected = std::thread::scope(|scope| {
        let collecting = scope.spawn(move || {
            let mut taken = 0;
            while collector.counters().get(Counter::Ticks) == 0 {
                taken += collector.drain();
            }
            taken + collector.drain()
        });
        for k in 0..sent {
            probe.record_ns(Metric::IngestWork, Stamp(k), k);
        }
        probe.counters().set(Counter::Ticks, 1);
        collecting.join().expect("the collector does not panic") as u64
    });
    assert_eq!(collected + probe.counters().get(Counter::RingDropped), sent);
}

fn scraped(exposition: &Exposition, collector: &Collector, request: &str) -> String {
    let mut stream = TcpStream::connect(("127.0.0.1", exposition.port().expect("a port"))).expect("it listens");
    stream.write_all(request.as_bytes()).expect("it reads");
    exposition.serve(collector);
    let mut answer = String::new();
    // A connection that was cut gives no text.
    let _ = stream.read_to_string(&mut answer);
    answer
}

fn control() -> (Probe, Collector) {
    let (mut probe, mut collector) = channel("control");
    probe.record_ns(Metric::ControlWork, second(1), 50_000);
    probe.counters().set(Counter::MissedDeadlines, 3);
    probe.counters().set(Counter::Mode, Mode::Engaged as u64);
    probe.counters().set(Counter::Faults, 1 << messages::Fault::InputStale as u64);
    collector.drain();
    (probe, collector)
}

#[test]
fn metrics_request_gets_counters_modes_faults_and_summaries() {
    let (_probe, collector) = control();
    let exposition = Exposition::bind(0).expect("a free port");
    let answer = scraped(&exposition, &collector, "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head and a body");
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains(&format!("Content-Length: {}", body.len())), "{head}");
    for line in [
        "teleop_missed_deadlines_total{process=\"control\"} 3",
        "teleop_mode{mode=\"Engaged\"} 1",
        "teleop_fault_active{fault=\"InputStale\"} 1",
        "teleop_fault_active{fault=\"EmergencyStop\"} 0",
        "teleop_control_work_seconds{process=\"control\",quantile=\"0.5\"} 0.000050000",
        "teleop_control_work_seconds_count{process=\"control\"} 1",
    ] {
        assert!(body.lines().any(|found| found == line), "no line {line} in\n{body}");
    }
    for line in body.lines().filter(|line| !line.starts_with('#')) {
        let (name, value) = line.rsplit_once(' ').expect("a name and a value");
        assert!(name.starts_with("teleop_") && value.parse::<f64>().is_ok(), "{line}");
    }
}

#[test]
fn metrics_server_refuses_other_and_incomplete_requests() {
    let (_probe, collector) = control();
    let exposition = Exposition::bind(0).expect("a free port");
    assert!(scraped(&exposition, &collector, "POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
    assert_eq!(scraped(&exposition, &collector, "GET"), "", "no empty line: no answer");
    assert_eq!(scraped(&exposition, &collector, &"x".repeat(5000)), "");
    exposition.serve(&collector);
}
