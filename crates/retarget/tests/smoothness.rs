//! How noise, limits and the gaps between skeletons show in the output of the shipped weights.

use crate::support;

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::{Path, PathBuf};

use messages::{Skeleton, Stamp, TICK_S, deadline};
use motion::CalibrationMode;
use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{
    ArmModel, ArmQ, Config, Input, Limbs, Network, Options, PRIOR_WEIGHT, Resample, State, Weights, features,
    limb_error_deg, mirror, oracle, refine, rotation_from_xyzw, tick, xyzw_from_rotation,
};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn model() -> robot::Model {
    let text = |name: &str| std::fs::read_to_string(root().join("config/robots").join(name)).expect("a robot file");
    robot::Model::from_text("toml", &text("tiago_dual.toml"), "urdf", &text("tiago_dual.urdf")).expect("the robot")
}

fn shipped(model: &robot::Model) -> Weights {
    let file = |end: &str| std::fs::read(root().join("weights").join(format!("tiago_dual.{end}"))).expect("weights");
    let manifest = String::from_utf8(file("toml")).expect("text");
    Weights::from_bytes(&manifest, &file("safetensors"), model).expect("they fit the robot")
}

/// Most that 0.1 degrees of the human may become in a joint, in multiples: 30 degrees at once. (From one end of joint 3 to
/// the other, 2677, is what keeping the posture prevents.)
const WORST_AMPLIFICATION: f64 = 300.0;

/// What the stage shows for a human who stands still.
fn retargeted(arm: &ArmModel, network: &Network, human: &Limbs, steps: u32) -> ArmQ {
    let [start] = network.decode(&network.encode_human(&[features(human)]));
    refine(arm, human, &start, &start, PRIOR_WEIGHT, steps).q
}

fn turned(rng: &mut Pcg64, rotation: &UnitQuaternion<f64>, degrees: f64) -> UnitQuaternion<f64> {
    let axis = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize();
    UnitQuaternion::from_scaled_axis(axis * degrees.to_radians()) * rotation
}

fn largest_deg(a: &ArmQ, b: &ArmQ) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs().to_degrees()).fold(0.0, f64::max)
}

/// Arms that hang (q2 near 90 degrees, where joints 1 and 3 turn about one line) and half a degree of noise on each limb.
#[test]
fn noise_at_the_gimbal_stays_noise() {
    let model = model();
    let (arm, network) = (ArmModel::of(&model), shipped(&model).network);
    let mut rng = Pcg64::seed_from_u64(41);
    let mut figures = Vec::new();
    for steps in [0, 2] {
        let (mut squares, mut count, mut worst) = (0.0, 0, 0.0_f64);
        for _ in 0..3000 {
            let q = [
                rng.random_range(-0.4..0.8),
                FRAC_PI_2 + rng.random_range(-0.1..0.0),
                FRAC_PI_2 + rng.random_range(-0.6..0.6),
                rng.random_range(0.1..1.6),
                rng.random_range(-0.8..0.8),
            ];
            let human = arm.forward(&q);
            let noisy = Limbs { upper: turned(&mut rng, &human.upper, 0.5), fore: turned(&mut rng, &human.fore, 0.5) };
            let (clean, noisy) = [human, noisy].map(|limbs| retargeted(&arm, &network, &limbs, steps)).into();
            squares += clean.iter().zip(&noisy).map(|(a, b)| (a - b).to_degrees().powi(2)).sum::<f64>();
            count += clean.len();
            worst = worst.max(largest_deg(&clean, &noisy));
        }
        let rms = (squares / count as f64).sqrt();
        println!("K = {steps}: 0.5 degrees of noise move joints by {rms:.2} degrees RMS, {worst:.1} at most");
        figures.push((rms, worst));
    }
    let (rms, worst) = figures[1];
    assert!(rms <= 2.0 && worst <= 21.0, "K = 2: RMS {rms:.2}, worst {worst:.1} degrees");
}

/// A human who turns one joint of the robot across its limit, 0.1 degrees a tick, with the other joints anywhere, through
/// the stage itself.
#[test]
fn across_a_limit_the_output_is_continuous() {
    const STEP_DEG: f64 = 0.1;
    let model = model();
    let arm = ArmModel::of(&model);
    let options = Options { resample: Resample::Latest, ..Options::default() };
    let config = Config::new(&model, Some(shipped(&model)), &options).expect("a configuration");
    let mut rng = Pcg64::seed_from_u64(42);
    let mut amplifications = Vec::new();
    let mut worst = [0.0_f64; 5];
    for sweep in 0..600 {
        let (joint, upwards) = (sweep % 5, sweep % 2 == 0);
        let mut q: ArmQ = std::array::from_fn(|j| arm.mid()[j] + rng.random_range(-0.7..0.7) * arm.half()[j]);
        // The shoulder away from its gimbal: what is amplified there is the other test's.
        q[1] = q[1].min(1.0);
        let (limit, sign) = if upwards { (arm.q_max[joint], 1.0) } else { (arm.q_min[joint], -1.0) };
        let (mut state, mut before) = (State::default(), None);
        for i in 0..400 {
            q[joint] = limit + sign * (f64::from(i) - 200.0) * STEP_DEG.to_radians();
            let k = 7_500_000 + i as u64;
            let now = deadline(k);
            let skeleton = skeleton_of(i as u64 + 1, now.0, &arm.forward(&q));
            let target = tick(&config, &mut state, now, Input { k, skeleton: Some(&skeleton) }).target;
            let shown: ArmQ = std::array::from_fn(|j| target.q[3 + j]);
            if let Some(before) = before.replace(shown) {
                let amplification = largest_deg(&before, &shown) / STEP_DEG;
                worst[joint] = worst[joint].max(amplification);
                amplifications.push(amplification);
            }
        }
    }
    amplifications.sort_by(f64::total_cmp);
    let share = |share: f64| amplifications[((amplifications.len() - 1) as f64 * share) as usize];
    println!(
        "across limits a step of {STEP_DEG} degrees moves joints by {:.2} (median), {:.1} (99 %), {:.1} (99.9 %) times as \
         much; worst by the joint that crosses: {worst:.1?}",
        share(0.5),
        share(0.99),
        share(0.999)
    );
    assert!(share(0.99) < 12.0 && share(0.999) < 25.0, "99 %: {:.1}, 99.9 %: {:.1}", share(0.99), share(0.999));
    assert!(share(1.0) < WORST_AMPLIFICATION, "worst: {:.1}", share(1.0));
}

/// Both arms with these limbs (of a left arm), captured and received at `at_ns`.
fn skeleton_of(sequence: u64, at_ns: u64, limbs: &Limbs) -> Skeleton {
    let mut skeleton = support::skeleton(sequence, at_ns, at_ns, &[[0.0; 5]; 2]);
    for (i, rotation) in [limbs.upper, limbs.fore].iter().enumerate() {
        let left = xyzw_from_rotation(rotation);
        skeleton.limbs[i] = left.map(|x| x as f32);
        skeleton.limbs[2 + i] = mirror(left).map(|x| x as f32);
    }
    skeleton
}

const START_NS: u64 = 5_000_000_000;

/// Joints of both arms at every tick, from skeletons that arrive as given (arrival, skeleton).
fn run(config: &Config, arrivals: &[(u64, Skeleton)], seconds: f64) -> Vec<[ArmQ; 2]> {
    let first = messages::tick_at(Stamp(START_NS));
    let (mut state, mut next, mut out) = (State::default(), 0, Vec::new());
    for k in first..first + (seconds * 1500.0) as u64 {
        let now = deadline(k);
        while next < arrivals.len() && arrivals[next].0 <= now.0 {
            next += 1;
        }
        let skeleton = next.checked_sub(1).map(|i| &arrivals[i].1);
        let target = tick(config, &mut state, now, Input { k, skeleton }).target;
        if target.valid_mask != 0 {
            out.push([3, 10].map(|first| std::array::from_fn(|j| target.q[first + j])));
        }
    }
    out
}

/// Second difference of one joint over one tick, rad/s^2.
fn acceleration(w: &[[ArmQ; 2]], arm: usize, j: usize) -> f64 {
    ((w[2][arm][j] - 2.0 * w[1][arm][j] + w[0][arm][j]) / (TICK_S * TICK_S)).abs()
}

fn acceleration_max(model: &robot::Model) -> ArmQ {
    std::array::from_fn(|j| model.limits[model.arms[0].joints[j]].a_max)
}

/// Share of ticks in which every joint is within `max`.
fn share_within(q: &[[ArmQ; 2]], max: impl Fn(usize, usize, usize) -> f64) -> f64 {
    let within = |(k, w): (usize, &[[ArmQ; 2]])| (0..2).all(|a| (0..5).all(|j| acceleration(w, a, j) <= max(k, a, j)));
    let count = q.windows(3).enumerate().filter(|window| within(*window)).count();
    count as f64 / (q.len() - 2) as f64
}

fn smoothed(model: &robot::Model, smoothing_ms: f64) -> Config {
    Config::new(model, Some(shipped(model)), &Options { smoothing_ms, ..Options::default() }).expect("a configuration")
}

/// A person whose own acceleration stays below the robot's: 0.3 rad at 0.24 to 0.41 Hz, at most 2 rad/s^2.
#[test]
fn a_calm_person_at_30_hz_stays_within_the_acceleration_limits() {
    let model = model();
    let max = acceleration_max(&model);
    let mut rng = Pcg64::seed_from_u64(43);
    let arrivals: Vec<(u64, Skeleton)> = (0..300)
        .map(|i| {
            let captured = START_NS + (f64::from(i) * 1e9 / 30.0) as u64;
            let t_s = f64::from(i) / 30.0;
            let wave = |j: usize| 0.3 * (TAU * t_s * (0.24 + 0.042 * j as f64) + j as f64).sin();
            let q: ArmQ = std::array::from_fn(|j| [0.3, 0.3, 1.5, 1.0, 0.0][j] + wave(j));
            let arrival = captured + rng.random_range(0..5_000_000);
            (arrival, support::skeleton(i as u64 + 1, arrival, captured, &[q, q]))
        })
        .collect();
    let share = |smoothing_ms: f64| {
        let q = run(&smoothed(&model, smoothing_ms), &arrivals, 9.9);
        share_within(&q[600..], |_, _, j| max[j])
    };
    let (with, without) = (share(33.3), share(0.0));
    println!(
        "within the acceleration limits: {:.3} % of ticks, {:.3} % without smoothing",
        100.0 * with,
        100.0 * without
    );
    assert!(with > 0.999 && without < 0.99, "{with} of the ticks with, {without} without");
}

#[test]
fn an_average_of_more_than_50_ms_is_refused() {
    let model = model();
    for (smoothing_ms, allowed) in [(0.0, true), (50.0, true), (50.1, false), (-1.0, false), (f64::NAN, false)] {
        let made = Config::new(&model, Some(shipped(&model)), &Options { smoothing_ms, ..Options::default() });
        let refused = made.err().map(|error| error.to_string());
        assert_eq!(refused.is_none(), allowed, "{smoothing_ms} ms: {refused:?}");
        assert!(refused.is_none_or(|text| text.contains("smoothing_ms") && text.contains("0 to 50")));
    }
}

struct Clip {
    name: String,
    rate_hz: f64,
    limbs: Vec<[[f32; 4]; 4]>,
}

impl Clip {
    /// The limbs of an arm in frame `i`, as those of a left arm.
    fn arm(&self, i: usize, arm: usize) -> Limbs {
        let limb = |limb: usize| {
            let limb = self.limbs[i][2 * arm + limb].map(f64::from);
            rotation_from_xyzw(if arm == 0 { limb } else { mirror(limb) }).expect("a rotation")
        };
        Limbs { upper: limb(0), fore: limb(1) }
    }

    fn at(&self, t_s: f64, arm: usize) -> Limbs {
        let x = (t_s * self.rate_hz).clamp(0.0, (self.limbs.len() - 2) as f64);
        self.arm(x as usize, arm).slerp(&self.arm(x as usize + 1, arm), x.fract())
    }

    /// Every second frame, delivered at once.
    fn arrivals(&self) -> Vec<(u64, Skeleton)> {
        let skeleton = |(i, limbs): (usize, &[[f32; 4]; 4])| {
            let at = START_NS + (i as f64 * 2e9 / self.rate_hz) as u64;
            let mut skeleton = support::skeleton(i as u64 + 1, at, at, &[[0.0; 5]; 2]);
            skeleton.limbs = *limbs;
            (at, skeleton)
        };
        self.limbs.iter().step_by(2).enumerate().map(skeleton).collect()
    }
}

/// The validation clips: of all sorted by name every fifth, starting with the third.
fn validation_clips() -> Option<Vec<Clip>> {
    let folder = root().join("../shared/motions/cmu");
    let mut files: Vec<_> = std::fs::read_dir(&folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "bvh"));
    files.sort();
    let read = |file: &PathBuf| {
        let motion = motion::load(file).expect("a motion");
        let limbs = motion::limbs(&motion, &motion::calibrate(&motion, CalibrationMode::First10s));
        Clip { name: motion.name, rate_hz: motion.frame_rate_hz, limbs }
    };
    Some(files.iter().skip(2).step_by(5).map(read).collect())
}

/// RMS of the third difference at 60 Hz, rad/s^3.
fn jerk(q: impl Iterator<Item = [ArmQ; 2]>) -> f64 {
    let q: Vec<[f64; 10]> = q.map(|q| std::array::from_fn(|j| q[j / 5][j % 5])).collect();
    let third =
        |w: &[[f64; 10]]| (0..10).map(|j| (w[3][j] - 3.0 * w[2][j] + 3.0 * w[1][j] - w[0][j]).powi(2)).sum::<f64>();
    let sum: f64 = q.windows(4).map(third).sum();
    (sum / (10 * q.len()) as f64).sqrt() * 60_f64.powi(3)
}

/// For each joint of each 30 Hz skeleton: the largest second difference of it and its four neighbours, rad/s^2.
fn accelerations_of_skeletons(clip: &Clip, arm: &ArmModel, network: &Network) -> Vec<[ArmQ; 2]> {
    let q: Vec<[ArmQ; 2]> = (0..clip.limbs.len())
        .step_by(2)
        .map(|i| [0, 1].map(|side| retargeted(arm, network, &clip.arm(i, side), 2)))
        .collect();
    let period_s = 2.0 / clip.rate_hz;
    let at = |i: usize, side: usize, j: usize| {
        let (a, b, c) = (q[i.saturating_sub(1)], q[i], q[(i + 1).min(q.len() - 1)]);
        ((c[side][j] - 2.0 * b[side][j] + a[side][j]) / (period_s * period_s)).abs()
    };
    let near = |i: usize| i.saturating_sub(2)..(i + 3).min(q.len());
    let largest = |i: usize, side: usize, j: usize| near(i).map(|n| at(n, side, j)).fold(0.0, f64::max);
    (0..q.len()).map(|i| std::array::from_fn(|side| std::array::from_fn(|j| largest(i, side, j)))).collect()
}

/// Mean limb error against the human `delay_s` before, degrees.
fn limb_error(clip: &Clip, arm: &ArmModel, q: &[[ArmQ; 2]], delay_s: f64) -> f64 {
    let errors: Vec<f64> = (300..q.len())
        .step_by(10)
        .flat_map(|k| [0, 1].map(|side| (k, side)))
        .flat_map(|(k, side)| limb_error_deg(&arm.forward(&q[k][side]), &clip.at(k as f64 * TICK_S - delay_s, side)))
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// Recorded people of full speed, at 30 Hz. Their own acceleration is far beyond the robot's (control deals with that);
/// what is asked here is that the path between skeletons adds none: per tick at most twice that of the skeletons nearby.
#[test]
fn between_recorded_skeletons_no_step_is_added() {
    let Some(clips) = validation_clips().filter(|_| !cfg!(debug_assertions)) else {
        println!("skipped: no recorded clips in ../shared/motions/cmu, or not a release build");
        return;
    };
    let model = model();
    let (arm, network, max) = (ArmModel::of(&model), shipped(&model).network, acceleration_max(&model));
    let delay_s = 0.040;
    println!(
        "clip     | straight: no added step, in limits, error, jerk | smoothed: the same, error at the same delay, worst joint"
    );
    let mut sums = [[0.0; 5]; 2];
    let mut total = 0.0;
    for clip in &clips {
        let own = accelerations_of_skeletons(clip, &arm, &network);
        let seconds = clip.limbs.len() as f64 / clip.rate_hz;
        let mut previous = [arm.mid(); 2];
        let best = jerk((0..clip.limbs.len()).map(|i| {
            previous = std::array::from_fn(|side| oracle(&arm, &clip.arm(i, side), &previous[side], 2, 7).q);
            previous
        }));
        print!("{:<8}", clip.name);
        for (row, smoothing_ms) in [0.0, 33.3].into_iter().enumerate() {
            let added_s = if row == 0 { 0.0 } else { 24.5 * TICK_S };
            let q = run(&smoothed(&model, smoothing_ms), &clip.arrivals(), seconds);
            let at = |k: usize| (((k as f64) * TICK_S - delay_s - added_s) / 2.0 * clip.rate_hz).max(0.0) as usize;
            let bound = |k: usize, side: usize, j: usize| max[j].max(2.0 * own[at(k).min(own.len() - 1)][side][j]);
            let mut over = [0; 10];
            for (k, w) in q.windows(3).enumerate() {
                (0..10).filter(|i| acceleration(w, i / 5, i % 5) > bound(k, i / 5, i % 5)).for_each(|i| over[i] += 1);
            }
            let worst = (0..10).max_by_key(|i| over[*i]).unwrap_or(0);
            let figures = [
                share_within(&q, bound),
                share_within(&q, |_, _, j| max[j]),
                limb_error(clip, &arm, &q, delay_s + added_s),
                limb_error(clip, &arm, &q, delay_s),
                jerk(q.iter().step_by(25).copied()) / best,
            ];
            let [clean, inside, error, late, jerk] = figures;
            print!(
                " | {:7.3} % {:7.3} % {error:5.2} {late:5.2} {jerk:6.3} q{}{}",
                100.0 * clean,
                100.0 * inside,
                worst % 5 + 1,
                ["l", "r"][worst / 5]
            );
            for (sum, figure) in sums[row].iter_mut().zip(figures) {
                *sum += figure * seconds;
            }
        }
        println!();
        total += seconds;
    }
    let [straight, smooth] = sums.map(|row| row.map(|sum| sum / total));
    println!("all      | {straight:.4?} | {smooth:.4?}");
    assert!(smooth[0] > 0.99 && straight[0] < 0.96, "{} with smoothing, {} without", smooth[0], straight[0]);
    assert!(smooth[2] < straight[2] + 0.2, "{} degrees against {}", smooth[2], straight[2]);
}
