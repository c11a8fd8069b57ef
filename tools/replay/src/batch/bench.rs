//! Measures poses per second on synthetic motion. Reads no files except the robot's and its weights, and writes none.

use super::cli::Cli;
use super::run::{in_parallel, load};
use messages::JOINTS_MAX;
use nalgebra::{UnitQuaternion, Vector3};
use poses::postures::Postures;
use retarget::{ARMS, Limbs};
use rt::Failure;
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;
use std::time::Instant;

/// Rounds on one core and on all cores, in turns. So other load of the machine affects both alike. The medians
/// are reported.
const ROUNDS: usize = 5;
/// Number of poses of the pool, which is retargeted repeatedly. They are 15 minutes of motion, more than the
/// caches close to a core hold.
const POOL: usize = 1 << 16;
/// Number of poses that a thread takes at once.
const CHUNK: usize = 1024;

#[derive(Clone, Copy, Debug)]
pub struct BenchReport {
    pub poses: u64,
    pub threads: usize,
    pub one_core_hz: f64,
    pub all_cores_hz: f64,
    /// Median processor time of a pose on one core, us. It excludes the time of other processes.
    pub one_core_cpu_us: f64,
    pub all_cores_cpu_us: f64,
}

impl BenchReport {
    pub fn minutes(&self, poses: f64) -> f64 {
        poses / self.all_cores_hz / 60.0
    }
}

/// Retargets `poses` poses of [`synthetic`], in rounds of one thread and of all threads.
pub fn bench(cli: &Cli, poses: u64) -> Result<BenchReport, Failure> {
    let (_, postures) = load(cli)?;
    let pool: Vec<[Limbs; ARMS]> = (0..POOL).map(synthetic).collect();
    let threads = cli.threads();
    let each = (poses as usize).div_ceil(2 * ROUNDS);
    // Warm up caches, frequency and pages outside of the figures.
    time(&postures, &pool, threads, each.min(20_000));
    let (mut one, mut all) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        one.push(time(&postures, &pool, 1, each));
        all.push(time(&postures, &pool, threads, each));
    }
    let hz = |timings: &[Timing]| median(timings.iter().map(|f| f.hz).collect());
    let cpu_us = |timings: &[Timing]| median(timings.iter().map(|f| f.cpu_us).collect());
    Ok(BenchReport {
        poses: (2 * ROUNDS * each) as u64,
        threads,
        one_core_hz: hz(&one),
        all_cores_hz: hz(&all),
        one_core_cpu_us: cpu_us(&one),
        all_cores_cpu_us: cpu_us(&all),
    })
}

struct Timing {
    hz: f64,
    cpu_us: f64,
}

fn cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn time(postures: &Postures, pool: &[[Limbs; ARMS]], threads: usize, poses: usize) -> Timing {
    let (begun, cpu_begun_s) = (Instant::now(), cpu_s());
    let sums = in_parallel(threads, poses.div_ceil(CHUNK), |chunk| {
        let poses = (chunk * CHUNK..poses.min((chunk + 1) * CHUNK)).map(|i| &pool[i % pool.len()]);
        let mut previous = None;
        let mut sum = [0.0; JOINTS_MAX];
        for arms in poses {
            let samples = postures.encode(black_box(arms));
            previous = postures.posture(&samples, previous.as_ref());
            if let Some(q) = &previous {
                let joints = postures.joints(q);
                sum.iter_mut().zip(joints).for_each(|(sum, q)| *sum += q);
            }
        }
        sum
    });
    black_box(sums);
    let poses = poses as f64;
    Timing { hz: poses / begun.elapsed().as_secs_f64(), cpu_us: 1e6 * (cpu_s() - cpu_begun_s) / poses }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Returns pose `i` of a synthetic motion of both arms at 60 Hz. Every angle of a human arm covers most of its
/// range. The periods have no common multiple.
pub fn synthetic(i: usize) -> [Limbs; ARMS] {
    let time_s = i as f64 / 60.0;
    // Middle, half range (degrees) and period (s) of five angles: swing and lowering of the upper arm, its
    // roll, flexion, pronation.
    const ANGLES: [[f64; 3]; 5] =
        [[25.0, 60.0, 3.1], [20.0, 60.0, 4.3], [-10.0, 70.0, 5.9], [70.0, 65.0, 2.3], [0.0, 60.0, 7.1]];
    std::array::from_fn(|arm| {
        let phase = arm as f64 * 0.37;
        let [swing, lower, roll, flex, twist] = ANGLES.map(|[middle, half, period]| {
            (middle + half * (std::f64::consts::TAU * (time_s / period + phase)).sin()).to_radians()
        });
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let upper = about(z, -swing) * about(x, -lower) * about(y, roll);
        Limbs { upper, fore: upper * about(z, -flex) * about(y, -twist) }
    })
}
